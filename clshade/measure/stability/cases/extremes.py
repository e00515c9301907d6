"""Cases 12 to 17: triangles far larger than the screen or not finite, the near plane, image and tile sizes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from .... import oracle
from ....base.arrays import Array
from ....errors import InputError
from ....pipeline import struct_layout
from ....pipeline.features import OPTIONAL
from ....pipeline.frame import Frame, same_bits
from ....scene.image_part import MAX_WHOLE, part_of, whole_camera
from ....scene.model import Mesh
from . import flat, lit
from .bench import Bench, Case, Outcome, against_oracle, worst, wrong_pixels

PRESETS = ("standard", "course")


def _exact_edges(corners: Array, resolution: flat.Resolution) -> tuple[Array, Array]:
    """Return (covered, decided), both (M, N) bool, row 0 at the TOP, of a counter-clockwise triangle (3, 2) in
    multiples of 2^-20 px, neither snapped nor clipped, computed in integers of any length. Centers within 1/128 px of
    an edge, which snapping may move, are not decided."""
    columns, rows = resolution
    unit = 1 << 20
    points = [[int(x * unit) for x in corner] for corner in corners]
    x = np.array([column * unit + unit // 2 for column in range(columns)], object)
    y = np.array([row * unit + unit // 2 for row in reversed(range(rows))], object)[:, None]
    covered, decided = np.ones((rows, columns), bool), np.ones((rows, columns), bool)
    for i in range(3):
        (x0, y0), (x1, y1) = points[i], points[(i + 1) % 3]
        area = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
        covered &= (area > 0).astype(bool)
        # |area| / length > unit / 128
        decided &= ((area * 128) ** 2 > ((x1 - x0) ** 2 + (y1 - y0) ** 2) * unit**2).astype(bool)
    return covered, decided


def huge_triangle(bench: Bench) -> Outcome:
    """Counter-clockwise triangles 1e4 times as large as a 48 px screen: one that covers it all, and nine whose edges
    cross it."""
    rng = np.random.default_rng(12)
    size, reach = (48, 48), 48e4
    outcomes = []
    corners = np.array([[-reach, -reach], [reach, -reach], [24.0, reach]])
    frame = bench.draw(flat.scene_of(corners, flat.ONE, size), **flat.FLAT)
    outcomes.append(wrong_pixels(frame["id"], np.ones(size, np.uint32)))
    for _ in range(9):
        angle = rng.uniform(0, 2 * np.pi)
        along, across = (np.array([f(angle), g(angle)]) for f, g in ((np.cos, np.sin), (lambda a: -np.sin(a), np.cos)))
        near = rng.uniform(14, 34, 2)
        corners = np.stack([near - reach * along, near + reach * along, near + reach * across])
        corners = np.round(corners * 2.0**20) / 2.0**20
        scene = flat.scene_of(corners, flat.ONE, size)
        frame = bench.draw(scene, **flat.FLAT)
        outcomes.append(against_oracle(frame, colors=False))
        drawn, (covered, decided) = frame.alpha > 0, _exact_edges(corners, size)
        outcomes.append(Outcome(int((decided & (drawn != covered)).sum()), pictures=(drawn, covered)))
    return worst(outcomes, "10 triangles, also unclipped in whole numbers")


def far_coordinates(bench: Bench) -> Outcome:
    """Corners beyond +-32768 px, and up to 1e38 and 1e100, in both projections: all pixels, or the oracle's."""
    outcomes, size = [], (40, 30)
    for reach in (32767.5, 32768.0, 40000.0, 2.0**31, 1e12, 1e20, 1e38, 1e100):
        corners = np.array([[-reach, -reach], [reach, -reach], [0.0, reach]])
        frame = bench.draw(flat.scene_of(corners, flat.ONE, size), **flat.FLAT)
        outcomes.append(wrong_pixels(frame["id"], np.ones(size[::-1], np.uint32)))
        # Two triangles share the edge that crosses the image: together they draw each pixel once.
        quad = np.array([[-reach, -reach], [reach, -reach], [reach, reach], [-reach, reach]])
        scene = flat.scene_of(quad + [20.3, 15.2], np.array([[0, 1, 2], [0, 2, 3]]), size)
        outcomes.append(flat.drawn_once(bench, scene, np.ones(size[::-1], bool)))
    for far in (1e20, 1e36, 1e100):
        mesh = lit.triangle((-far, -far, -20.0), (far, -far, -20.0), (0.0, far, -20.0))
        frame = bench.draw(lit.scene_of(lit.blob(), mesh), near=0.1)
        outcomes.append(_but_for_depth(frame, 250))
    return worst(outcomes, "32767.5 px to 1e100")


def _but_for_depth(frame: Frame, first: int) -> Outcome:
    """Compare with the oracle; depths of faces after the first may exceed float32."""
    expected = oracle.render(frame.scene, frame.settings)
    far = (frame["id"] > first) & (expected.id > first)
    depths = np.where(far, np.float32(1.0), frame["Z"])
    expected.Z[far] = 1.0
    near = Frame(frame.rgba, {"Z": depths, "id": frame["id"]}, frame.scene, frame.settings, dict)
    return against_oracle(near, expected)


def not_finite(bench: Bench) -> Outcome:
    """NaN and infinity are refused; with nonfinite="drop" the triangle is dropped and counted, and the rest intact."""
    mesh = lit.patch()
    outcomes = []
    rng = np.random.default_rng(14)
    for value in (np.nan, np.inf, -np.inf):
        bad = rng.choice(len(mesh.verts), 4, replace=False)
        verts = mesh.verts.copy()
        verts[bad, rng.integers(0, 3, 4)] = value
        fields: dict[str, Any] = {"colors": mesh.colors, "material": mesh.material}
        try:
            Mesh(verts, mesh.faces, **fields)
        except InputError:
            refused = 0
        else:
            refused = 1
        lost = np.isin(mesh.faces, bad).any(axis=1)
        frame = bench.draw(lit.scene_of(Mesh(verts, mesh.faces, **fields, nonfinite="drop")))
        rest = bench.draw(lit.scene_of(replace(mesh, faces=mesh.faces[~lost])))
        ids = np.concatenate([[0], np.flatnonzero(~lost) + 1])[rest["id"]].astype(np.uint32)
        wrong = (frame["id"] != ids) | (frame.rgba != rest.rgba).any(axis=-1) | (frame["Z"] != rest["Z"])
        miscounted = int(frame.stats["nonfinite"] != lost.sum())
        pictures = (frame.rgb, rest.rgb)
        outcomes.append(Outcome(int(wrong.sum()) + refused + miscounted, pictures=pictures))
        outcomes.append(against_oracle(frame))
    return worst(outcomes, "NaN, +inf, -inf at four vertices of a sheet")


def near_plane(bench: Bench) -> Outcome:
    """Faces behind the eye, across it, and with a corner exactly at it; a floor that must stay below the horizon."""
    outcomes = []
    eye = lit.CAMERA.eye
    at_eye = lit.triangle((0.3, 0.2, 5.0), (1.0, -1.0, 0.0), (-1.0, -1.5, 1.0))
    exactly = replace(at_eye, verts=np.concatenate([eye[None], at_eye.verts[1:]]))
    around = replace(lit.blob(), verts=lit.blob().verts + [0.0, 0.0, 4.5])
    behind = replace(lit.blob(), verts=lit.blob().verts + [0.0, 0.0, 15.0])
    for meshes in ((around,), (exactly,), (behind,), (around, exactly, behind)):
        for preset in PRESETS:
            frame = bench.draw(lit.scene_of(*meshes), preset=preset)
            outcomes.append(against_oracle(frame))
    empty = bench.draw(lit.scene_of(behind))
    outcomes.append(Outcome(int((empty["id"] > 0).sum()) + abs(empty.stats["behind"] - 250)))
    level = replace(lit.CAMERA, lookat=eye - [0.0, 0.0, 1.0], up=np.array([0.0, 1.0, 0.0]))
    floor = lit.triangle((-900.0, -1.0, 90.0), (900.0, -1.0, 90.0), (0.0, -1.0, -900.0))
    frame = bench.draw(lit.scene_of(floor, camera=level), near=0.5)
    above = frame["id"][:30] > 0  # the upper 30 of 61 rows are above the horizon
    below = frame["id"][-10:] == 0
    outcomes += [against_oracle(frame), Outcome(int(above.sum() + below.sum()))]
    return worst(outcomes, "behind, across, at the eye, a floor")


def image_sizes(bench: Bench) -> Outcome:
    """Images from 1x1 to 16384 wide: the oracle's pixels, bit-identical to the same part of a larger image. Parts of one of
    131072: the oracle's pixels, however they are cut."""
    outcomes = []
    for resolution in ((1, 1), (1, 7), (17, 33), (333, 1), (16384, 2), (3, 16384)):
        camera = replace(lit.CAMERA, resolution=resolution)
        outcomes.append(against_oracle(bench.draw(lit.scene_of(camera=camera))))
    camera = replace(lit.CAMERA, resolution=(64, 64))
    whole = bench.draw(lit.scene_of(camera=camera))
    for left, low, columns, rows in ((0, 0, 1, 1), (31, 17, 1, 7), (5, 9, 17, 33), (1, 30, 63, 1), (17, 3, 32, 48)):
        principal = ((32 - left) / columns, (32 - low) / rows)
        plane = (rows / 64, columns / 64)
        part = bench.draw(
            lit.scene_of(camera=replace(camera, resolution=(columns, rows), plane=plane, principal=principal))
        )
        cut = np.s_[64 - low - rows : 64 - low, left : left + columns]
        wrong = (part.rgba != whole.rgba[cut]).any(axis=-1) | (part["Z"] != whole["Z"][cut])
        wrong |= part["id"] != whole["id"][cut]
        outcomes.append(Outcome(int(wrong.sum()), pictures=(part.rgb, whole.rgb[cut])))
    poster = whole_camera(lit.CAMERA, (MAX_WHOLE, MAX_WHOLE))
    for left, top in ((MAX_WHOLE // 2 - 40, MAX_WHOLE // 2 - 40), (MAX_WHOLE // 2, MAX_WHOLE // 2), (70_000, 61_000)):
        frame = bench.draw(lit.scene_of(camera=part_of(poster, left, top, 40, 40)))
        rest = bench.draw(lit.scene_of(camera=part_of(poster, left + 7, top + 9, 20, 31)))
        cut = np.s_[9:40, 7:27]
        wrong = (rest.rgba != frame.rgba[cut]).any(axis=-1) | (rest["id"] != frame["id"][cut])
        outcomes += [against_oracle(frame), Outcome(int(wrong.sum()), pictures=(rest.rgb, frame.rgb[cut]))]
    return worst(outcomes, "6 sizes, 5 crops, 3 parts of 131072 pixels a side")


@contextlib.contextmanager
def _tile_size(size: int) -> Iterator[None]:
    before = struct_layout.TILE_SIZE
    struct_layout.TILE_SIZE = struct_layout.CONSTANTS["TILE_SIZE"] = size
    try:
        yield
    finally:
        struct_layout.TILE_SIZE = struct_layout.CONSTANTS["TILE_SIZE"] = before


def tiles_and_lanes(bench: Bench) -> Outcome:
    """Tiles of 8, 16 and 32 px, 1, 4, 8 and 16 lanes, every feature on: identical images."""
    scene = lit.scene_of()
    first = bench.draw(scene)
    others = []
    for size in (8, 32):
        with _tile_size(size):
            others.append(bench.draw(scene))
    others += [bench.draw(scene, lanes=lanes) for lanes in (1, 4, 8, 16)]
    others.append(bench.draw(scene, forced=OPTIONAL))
    return worst([different_bits(frame, first) for frame in others], "tiles 8 to 32, lanes 1 to 16, all features")


def different_bits(a: Frame, b: Frame) -> Outcome:
    """Count the pixels that differ in a bit of the image or layers."""
    if same_bits(a, b):
        return Outcome(pictures=(a.rgb, b.rgb))
    wrong = (a.rgba.view(np.uint32) != b.rgba.view(np.uint32)).any(axis=-1)
    for name in a.layers:
        wrong |= a[name].view(np.uint32) != b[name].view(np.uint32)
    return Outcome(max(int(wrong.sum()), 1), pictures=(a.rgb, b.rgb))


CASES = (
    Case("12", "huge-triangle", "a triangle 1e4 times the screen", "exact at every pixel", huge_triangle),
    Case("13", "far-coordinates", "past +-32768 px, 1e38, 1e100", "clipped, never wrapped", far_coordinates),
    Case("14", "not-finite", "NaN and infinite vertices", "refused, or dropped and counted", not_finite),
    Case("15", "near-plane", "behind, across, at the eye", "near-clipped, never mirrored", near_plane),
    Case("16", "image-sizes", "1x1 to 131072 px a side", "the matching crop's pixels", image_sizes, True),
    Case("17", "tiles-and-lanes", "tile size, lanes, features", "same bits", tiles_and_lanes, True),
)
