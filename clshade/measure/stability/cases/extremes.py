"""Cases 12 to 15: triangles far larger than the screen or not finite, and the near plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....pipeline.frame import Frame
from ....scene.model import Mesh
from . import flat, lit
from .bench import Bench, Case, Outcome, Outcomes, against_oracle, all_against_oracle, wrong_pixels

PRESETS = ("standard", "course")


def huge_triangle(bench: Bench) -> Outcomes:
    """Counter-clockwise triangles 1e4 times as large as a 48 px screen: one that covers it all, and nine whose edges
    cross it."""
    rng = np.random.default_rng(12)
    size, reach = (48, 48), 48e4
    corners = np.array([[-reach, -reach], [reach, -reach], [24.0, reach]])
    frame = bench.draw(flat.scene_of(corners, flat.ONE, size), **flat.FLAT)
    yield wrong_pixels(frame["id"], np.ones(size, np.uint32))
    for _ in range(9):
        angle = rng.uniform(0, 2 * np.pi)
        along, across = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        near = rng.uniform(14, 34, 2)
        corners = np.stack([near - reach * along, near + reach * along, near + reach * across])
        frame = bench.draw(flat.scene_of(corners, flat.ONE, size), **flat.FLAT)
        yield against_oracle(frame)
        drawn = frame.alpha > 0
        surely, perhaps = (flat.polygon_interior(corners, size, margin) for margin in (1 / 64, -1 / 64))
        yield Outcome(int(((surely & ~drawn) | (drawn & ~perhaps)).sum()), pictures=(drawn, surely))


def far_coordinates(bench: Bench) -> Outcomes:
    """Corners beyond +-32768 px, and up to 1e38 and 1e100, in both projections: all pixels, or the oracle's."""
    size = (40, 30)
    for reach in (32767.5, 32768.0, 40000.0, 2.0**31, 1e12, 1e20, 1e38, 1e100):
        corners = np.array([[-reach, -reach], [reach, -reach], [0.0, reach]])
        frame = bench.draw(flat.scene_of(corners, flat.ONE, size), **flat.FLAT)
        yield wrong_pixels(frame["id"], np.ones(size[::-1], np.uint32))
        # Two triangles share the edge that crosses the image: together they draw each pixel once.
        quad = np.array([[-reach, -reach], [reach, -reach], [reach, reach], [-reach, reach]])
        scene = flat.scene_of(quad + [20.3, 15.2], np.array([[0, 1, 2], [0, 2, 3]]), size)
        yield flat.drawn_once(bench, scene, np.ones(size[::-1], bool))
    for far in (1e20, 1e36, 1e100):
        mesh = lit.triangle((-far, -far, -20.0), (far, -far, -20.0), (0.0, far, -20.0))
        frame = bench.draw(lit.scene_of(lit.blob(), mesh), near=0.1)
        near = Frame(frame.rgba, {"id": frame["id"]}, frame.scene, frame.settings, dict)  # depths may exceed float32
        yield against_oracle(near)


def not_finite(bench: Bench) -> Outcomes:
    """With nonfinite="drop" a triangle with NaN or infinity is dropped and counted, and the rest intact."""
    mesh = lit.patch()
    rng = np.random.default_rng(14)
    for value in (np.nan, np.inf, -np.inf):
        bad = rng.choice(len(mesh.verts), 4, replace=False)
        verts = mesh.verts.copy()
        verts[bad, rng.integers(0, 3, 4)] = value
        broken = Mesh(verts, mesh.faces, colors=mesh.colors, material=mesh.material, nonfinite="drop")
        lost = np.isin(mesh.faces, bad).any(axis=1)
        frame = bench.draw(lit.scene_of(broken))
        rest = bench.draw(lit.scene_of(replace(mesh, faces=mesh.faces[~lost])))
        yield Outcome(int(frame.stats["nonfinite"] != lost.sum()))
        yield from (wrong_pixels(frame.rgba, rest.rgba), against_oracle(frame))


def near_plane(bench: Bench) -> Outcomes:
    """Faces behind the eye, across it, and with a corner exactly at it; a floor that must stay below the horizon."""
    eye = lit.CAMERA.eye
    at_eye = lit.triangle((0.3, 0.2, 5.0), (1.0, -1.0, 0.0), (-1.0, -1.5, 1.0))
    exactly = replace(at_eye, verts=np.concatenate([eye[None], at_eye.verts[1:]]))
    around, behind = (replace(lit.blob(), verts=lit.blob().verts + [0.0, 0.0, z]) for z in (4.5, 15.0))
    scenes = [lit.scene_of(*meshes) for meshes in ((around,), (exactly,), (behind,), (around, exactly, behind))]
    for preset in PRESETS:
        yield from all_against_oracle(bench, scenes, preset=preset)
    empty = bench.draw(lit.scene_of(behind))
    yield Outcome(int((empty["id"] > 0).sum()) + abs(empty.stats["behind"] - 250))
    level = replace(lit.CAMERA, lookat=eye - [0.0, 0.0, 1.0], up=np.array([0.0, 1.0, 0.0]))
    floor = lit.triangle((-900.0, -1.0, 90.0), (900.0, -1.0, 90.0), (0.0, -1.0, -900.0))
    frame = bench.draw(lit.scene_of(floor, camera=level), near=0.5)
    above = frame["id"][:30] > 0  # the upper 30 of 61 rows are above the horizon
    below = frame["id"][-10:] == 0
    yield from [against_oracle(frame), Outcome(int(above.sum() + below.sum()))]


CASES = (
    Case("12", "huge-triangle", "a triangle 1e4 times the screen", "exact at every pixel", huge_triangle),
    Case("13", "far-coordinates", "past +-32768 px, 1e38, 1e100", "clipped, never wrapped", far_coordinates),
    Case("14", "not-finite", "NaN and infinite vertices", "dropped and counted", not_finite),
    Case("15", "near-plane", "behind, across, at the eye", "near-clipped, never mirrored", near_plane),
)
