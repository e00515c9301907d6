"""Cases 24r to 24u: ambient occlusion inside closed boxes, in planes, far away, on slivers and by rays of any length."""

from __future__ import annotations

from . import lit, shadows
from .bench import Bench, Case, Outcome, all_against_oracle, different_bits, worst

_AMBIENT = (1.0, 0.9, 0.8)


def closed_boxes(bench: Bench) -> Outcome:
    """Closed boxes with rays as long as their diagonals: all pixels are black, also on edges."""
    around = {"lights": (), "ambient": 1.0}
    boxes = [shadows.in_box(turn, center, lit.MATERIAL, **around) for turn, center in shadows.rooms(9)]
    frames = [bench.draw(scene, ambient_occlusion=16, ao_distance=8.0) for scene in boxes]
    return shadows.black(frames)


def open_planes(bench: Bench) -> Outcome:
    """Sheets of triangles in one plane, across the view and steep, at the origin, at 1e9 and 1e20 times as large: all of
    their ambient light arrives."""
    outcomes = []
    for mesh in shadows.planes():
        scene = lit.scene_of(lit.on_a_grid(mesh, 12), lights=(), ambient=1.0)
        for scale, shift in ((1.0, 0.0), (1.0, 1e9), (1e20, 0.0)):
            moved = lit.shifted(scene, scale, shift)
            outcomes.append(different_bits(*(bench.draw(moved, ambient_occlusion=rays) for rays in (5, 0))))
    return worst(outcomes, f"{len(outcomes)} images")


def slivers(bench: Bench) -> Outcome:
    """Triangles 1e-2 to 1e-12 wide and 3 long, as casters and as receivers, and some without area."""
    scene = lit.scene_of(shadows.sliver_mesh(), shadows.wall(), ambient=_AMBIENT)
    return all_against_oracle(bench, [scene], ambient_occlusion=4)


def lengths(bench: Bench) -> Outcome:
    """Rays of 1e-300 to 1e300 and of the scene's own size; the scene at 1e9 and 1e20 times as large and as small."""
    meshes = lit.on_a_grid(shadows.wall(), 12), lit.on_a_grid(shadows.casters(), 12)
    scene = lit.scene_of(*meshes, lights=lit.LIGHTS[:1], ambient=_AMBIENT)
    moved = [lit.shifted(scene, scale, shift) for scale, shift in ((1.0, 0.0), (1.0, 1e9), (1e-20, 0.0), (1e20, 0.0))]
    outcomes = [all_against_oracle(bench, moved, ambient_occlusion=4)]
    for distance in (1e-300, 1e-9, 1e-3, 1e5, 1e300):
        outcomes.append(all_against_oracle(bench, [scene], ambient_occlusion=4, ao_distance=distance))
    return worst(outcomes, "9 scenes")


CASES = (
    Case("24r", "closed-occlusion", "ambient light in closed boxes", "black", closed_boxes, True),
    Case("24s", "open-planes", "ambient light on planes, far away", "all of it arrives", open_planes, True),
    Case("24t", "sliver-occlusion", "casters and receivers 1e-12 wide", "within the bound", slivers, True),
    Case("24u", "occlusion-length", "rays of 1e-300 to 1e300", "within the bound", lengths, True),
)
