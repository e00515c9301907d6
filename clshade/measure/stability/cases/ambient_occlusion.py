"""Cases 24r to 24u: ambient occlusion inside closed boxes, in planes, far away, on slivers and by rays of any length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....scene.model import Scene
from . import lit, shadows
from .bench import Bench, Case, Outcome, against_oracle, worst


def _drawn(bench: Bench, scene: Scene, distance: float | None = None) -> Outcome:
    lit_around = replace(scene, ambient=(1.0, 0.9, 0.8))
    return against_oracle(bench.draw(lit_around, ambient_occlusion=4, ao_distance=distance))


def closed_boxes(bench: Bench) -> Outcome:
    """Closed boxes, any way round, seen from inside, with rays as long as their diagonals: all pixels are black, also on
    edges."""
    rng = np.random.default_rng(9)
    leaks, seen = 0, 0
    for k in range(6):
        turn = np.eye(3) if k < 2 else np.linalg.qr(rng.normal(size=(3, 3)))[0]
        center = np.zeros(3) if k % 2 == 0 else np.array([1000.0, -300.0, 50.0])
        camera = replace(lit.CAMERA, eye=center + turn @ [0.3, 0.2, 0.5], lookat=center + turn @ [1.9, 1.3, -2.8])
        box = shadows.box(turn, center, lit.MATERIAL)
        around = {"lights": (), "ambient": 1.0, "background": 0.0, "camera": replace(camera, focal=0.4)}
        frame = bench.draw(lit.scene_of(box, **around), ambient_occlusion=16, ao_distance=8.0)
        lit_ones = frame.rgb.any(axis=-1)
        leaks += int(lit_ones.sum())
        seen += lit_ones.size
    return Outcome(leaks, detail=f"{seen} pixels", pictures=(frame.rgb, np.zeros_like(frame.rgb)))


def open_planes(bench: Bench) -> Outcome:
    """Sheets of triangles in one plane, across the view and steep, at the origin, at 1e9 and 1e20 times as large: all of
    their ambient light arrives."""
    sheet = lit.patch(size=2.0, cells=8, bend=0.0)
    steep = replace(sheet, verts=sheet.verts + sheet.verts[:, :1] * [0.0, 0.0, 0.5])  # heights stay multiples of 2^-k
    different, images = 0, 0
    for mesh in (sheet, steep):
        scene = lit.scene_of(lit.on_a_grid(mesh, 12), lights=(), ambient=1.0)
        for scale, shift in ((1.0, 0.0), (1.0, 1e9), (1e20, 0.0)):
            moved = lit.shifted(scene, scale, shift)
            frames = [bench.draw(moved, ambient_occlusion=rays) for rays in (5, 0)]
            different += int((frames[0].rgb != frames[1].rgb).any(axis=-1).sum())
            images += 1
    return Outcome(different, detail=f"{images} images", pictures=(frames[0].rgb, frames[1].rgb))


def slivers(bench: Bench) -> Outcome:
    """Triangles 1e-2 to 1e-12 wide and 3 long, as casters and as receivers, and some without area."""
    return _drawn(bench, lit.scene_of(shadows.sliver_mesh(), shadows.wall()))


def lengths(bench: Bench) -> Outcome:
    """Rays of 1e-300 to 1e300 and of the scene's own size; the scene at 1e9 and 1e20 times as large and as small."""
    scene = lit.scene_of(lit.on_a_grid(shadows.wall(), 12), lit.on_a_grid(shadows.casters(), 12), lights=lit.LIGHTS[:1])
    outcomes = [_drawn(bench, scene, distance) for distance in (None, 1e-300, 1e-9, 1e-3, 1e5, 1e300)]
    outcomes += [
        _drawn(bench, lit.shifted(scene, scale, shift)) for scale, shift in ((1.0, 1e9), (1e-20, 0.0), (1e20, 0.0))
    ]
    return worst(outcomes, f"{len(outcomes)} scenes")


CASES = (
    Case("24r", "closed-occlusion", "ambient light in closed boxes", "black", closed_boxes, True),
    Case("24s", "open-planes", "ambient light on planes, far away", "all of it arrives", open_planes, True),
    Case("24t", "sliver-occlusion", "casters and receivers 1e-12 wide", "within the bound", slivers, True),
    Case("24u", "occlusion-length", "rays of 1e-300 to 1e300", "within the bound", lengths, True),
)
