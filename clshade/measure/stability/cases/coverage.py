"""Cases 1 to 15: pixel ownership where triangles meet, triangles too large or not finite, the near plane."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .... import oracle
from ....base.arrays import Array, Floats
from ....pipeline.frame import Frame
from ....scene.camera import Camera
from ....scene.model import Mesh, Scene
from ...check.oracle_bounds import depth_errors, depth_roundings
from . import flat, lit
from .bench import PRESETS, Bench, Case, Outcome, Outcomes, against_oracle, all_against_oracle, wrong_pixels
from .flat import HALF, SUB

ANGLES = np.radians(np.arange(15) * 6.0 + 0.7)


def grid(cells: int) -> tuple[Array, Array]:
    """Return the vertices (K, 2) of a grid over [-1/2, 1/2]^2 and its faces (2*cells^2, 3), with diagonals in both
    directions."""
    line = np.arange(cells + 1) / cells - 0.5
    points = np.stack(np.meshgrid(line, line, indexing="xy"), axis=-1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    up = cells + 1
    cuts = np.array([[0, 1, up + 1, 0, up + 1, up], [0, 1, up, 1, up + 1, up]])
    odd = (np.arange(cells * cells) + np.arange(cells * cells) // cells) % 2
    return points, (corner[:, None] + cuts[odd]).reshape(-1, 3)


def _turned_grid(angle: float) -> tuple[Floats, Array, Floats]:
    """Return vertices and faces of a grid of 4 x 4 squares, and its corners."""
    points, faces = grid(4)
    c, s = np.cos(angle), np.sin(angle)
    points = points @ np.array([[c, s], [-s, c]])
    return points, faces, points[[0, 4, 24, 20]]


def shared_edges(bench: Bench) -> Outcomes:
    center, size, resolution = np.array([64.5, 64.0]), 90.0, (128, 128)
    for angle in ANGLES:
        points, faces, corners = _turned_grid(angle)
        inside = flat.polygon_interior(corners * size + center, resolution)
        yield flat.drawn_once(bench, flat.scene_of(points * size + center, faces, resolution), inside)


def perspective_edges(bench: Bench) -> Outcomes:
    """The grid of case 1 with depths from 0.1 to 4: each triangle is also drawn alone, and the coverage is summed."""
    rng = np.random.default_rng(3)
    camera = Camera(np.zeros(3), -np.eye(3)[2], np.eye(3)[1], 1.0, (1, 1), (96, 96))
    for angle in ANGLES[::5]:
        points, faces, corners = _turned_grid(angle)
        verts = np.column_stack([points * 0.7, -np.ones(25)]) * rng.uniform(0.1, 4.0, (25, 1))
        scene = Scene((Mesh(verts, faces, material=flat.UNLIT),), camera, background=None)
        options = {**flat.FLAT, "near": 0.05}
        alone = (replace(scene, meshes=(replace(scene.meshes[0], faces=face[None]),)) for face in faces)
        count = np.sum([bench.draw(one, **options).alpha > 0 for one in alone], axis=0)
        inside = flat.polygon_interior((corners * 0.7 + 0.5) * 96, (96, 96))
        wrong = np.where(inside, count != 1, count > 1)
        frame = bench.draw(scene, **options)
        wrong |= (frame.alpha > 0) != (count > 0)
        yield Outcome(int(wrong.sum()), pictures=(count, np.clip(count, inside, 1)))
        yield against_oracle(frame)


def _adversarial(rng: np.random.Generator, xy: Array, size: int) -> Array:
    """Return corners (F, 3, 2) in [0, 256*size], some of them moved to where rounding errors would show."""
    kind, extent = rng.integers(0, 8, len(xy)), SUB * size
    xy = xy.copy()
    xy[kind == 1] = xy[kind == 1] // HALF * HALF  # corners on pixel centers, pixel corners and midpoints of pixel edges
    xy[kind == 2, 1, 1] = xy[kind == 2, 0, 1]  # a horizontal edge
    xy[kind == 3, 2, 0] = xy[kind == 3, 0, 0]  # a vertical edge
    thin = kind == 4  # the third corner one step from the midpoint of the others
    xy[thin, 2] = (xy[thin, 0] + xy[thin, 1]) // 2 + rng.integers(-1, 2, (thin.sum(), 2))
    center = kind == 5  # an edge through a pixel center
    middle = rng.integers(0, max(size, 1), (center.sum(), 2)) * SUB + HALF
    xy[center, 1] = 2 * middle - xy[center, 0]
    xy[kind == 6] = np.clip(xy[kind == 6], extent // 2 - 2, extent // 2 + 2)  # a few steps in size
    return np.clip(xy, 0, extent)


def triangles_of_size(rng: np.random.Generator, size: int, count: int) -> tuple[Array, flat.Resolution]:
    """Return snapped triangles (count, 3, 2) of up to `size` pixels, each in its own cell of an image about 1024 wide;
    the cells are not aligned with tiles."""
    across = max(1024 // size, 1)
    cell = np.stack(np.divmod(np.arange(count), across)[::-1], axis=1)
    xy = _adversarial(rng, rng.integers(0, SUB * size + 1, (count, 3, 2)), size)
    xy = xy + SUB * (size * cell[:, None, :] - min(size // 2, 5))
    rows = max(-(-count // across) * size - 7, 1)
    return xy, (max(across * size - 9, 1), rows)


def random_triangles(bench: Bench) -> Outcomes:
    """Triangles of sizes 2^0 to 2^8 px, half as many of each size as of the previous one, drawn with both
    visibilities."""
    rng = np.random.default_rng(5)
    shares = 2.0 ** -np.arange(9)
    for power, share in reversed(list(enumerate(shares / shares.sum()))):
        size, count = 1 << power, max(1, round(bench.triangles * share))
        many = max(1, (1024 // size) ** 2)
        for start in range(0, count, many):
            xy, resolution = triangles_of_size(rng, size, min(many, count - start))
            frame = flat.draw(bench, xy, resolution, visibility="depth" if (start // many) % 2 else "painter")
            yield wrong_pixels(frame["id"], flat.exact(xy, resolution))


def half_pixel_grid(bench: Bench) -> Outcomes:
    """All 49^3 triangles with corners on a 7 x 7 half-pixel grid, each in a cell of 4 x 4 pixels."""
    corner = HALF * np.stack(np.divmod(np.arange(49), 7), axis=1)
    index = np.stack(np.meshgrid(*[np.arange(49)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cell = np.stack(np.divmod(np.arange(len(index)), 343), axis=1)
    xy = corner[index] + 4 * SUB * cell[:, None, :]
    yield wrong_pixels(flat.draw(bench, xy, (1372, 1372))["id"], flat.exact(xy, (1372, 1372)))


def edges_on_centers(bench: Bench) -> Outcomes:
    """Rectangles with edges through pixel centers own their left column and top row, not the right and bottom ones,
    with either diagonal and winding. Squares rotated by 45 degrees, all edges through centers, are checked in closed
    form too."""
    box = np.array([[3, 4], [11, 4], [11, 9], [3, 9]]) * SUB + HALF
    expected = np.zeros((16, 16), bool)
    expected[5:10, 3:11] = True  # rows from the bottom: 4 (exclusive) to 9 (inclusive)
    for cut in ([[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]):
        for way in ([0, 1, 2], [0, 2, 1]):
            frame = flat.draw(bench, box[np.array(cut)][:, way], (16, 16))
            yield wrong_pixels(frame.alpha[::-1] > 0, expected)
    middle, reach = np.array([8, 8]) * SUB + HALF, 5 * SUB
    tips = middle + reach * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    x, y = np.arange(16) - 8, (np.arange(16) - 8)[:, None]
    # Inside or on a left edge; the top and bottom corners also end a right edge, and are not drawn.
    diamond = (np.abs(x) + np.abs(y) < 5) | ((np.abs(x) + np.abs(y) == 5) & (x < 0))
    covered = flat.draw(bench, tips[np.array([[0, 1, 2], [0, 2, 3]])], (16, 16)).alpha[::-1] > 0
    yield wrong_pixels(covered, diamond)


def slivers(bench: Bench) -> Outcomes:
    """A strip of slivers 0.01 px wide and 4000 px long (4e5 : 1), vertical and horizontal, and a fan of needles 1e5 :
    1."""
    ends = np.stack(np.meshgrid(np.arange(1601) * 0.01 + 2.003, [3.3, 4003.7], indexing="ij"), axis=-1).reshape(-1, 2)
    faces = (2 * np.arange(1600)[:, None] + [0, 2, 1, 1, 2, 3]).reshape(-1, 3)
    corners = ends[[0, -2, -1, 1]]
    for size, way in (((24, 4010), 1), ((4010, 24), -1)):
        inside = flat.polygon_interior(corners[::way, ::way], size)
        yield flat.drawn_once(bench, flat.scene_of(ends[:, ::way], faces, size), inside)
    angle = np.radians(np.linspace(40.0, 40.5, 800))
    rim = np.array([10.1, 20.2]) + 1400.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    fan = np.concatenate([[[10.1, 20.2]], rim])
    faces = np.arange(1, 800)[:, None] * [0, 1, 1] + [0, 0, 1]
    inside = flat.polygon_interior(fan[[0, 1, 800]], (1100, 950))
    yield flat.drawn_once(bench, flat.scene_of(fan, faces, (1100, 950)), inside)


def million_into_64(bench: Bench) -> Outcomes:
    points, faces = grid(895)
    scene = flat.scene_of(points * 70.0 + 32.1, faces, (64, 64))
    yield flat.drawn_once(bench, scene, np.ones((64, 64), bool))


def two_a_pixel(bench: Bench) -> Outcomes:
    """One mesh of two triangles in each pixel, which meet on its center: the one whose left edge that is owns it."""
    columns = math.isqrt(max(bench.triangles // 2, 1))
    rows = -(-bench.triangles // (2 * columns))
    corner = np.arange(rows * (columns + 1), dtype=np.int32).reshape(rows, columns + 1)[:, :-1]
    faces = corner[..., None] + np.array([0, 1, columns + 1, 1, columns + 2, columns + 1], np.int32)
    uv = np.empty((rows + 1, columns + 1, 2))
    uv[..., 0], uv[..., 1] = np.arange(columns + 1), np.arange(rows + 1)[:, None]
    depth = flat.DEPTH + np.random.default_rng(11).random(uv[..., 0].size)
    scene = flat.scene_of(uv.reshape(-1, 2), faces.reshape(-1, 3), (columns, rows), depth)
    owners = np.arange(2, 2 * rows * columns + 1, 2, dtype=np.uint32).reshape(rows, columns)[::-1]
    for visibility in ("painter", "depth"):
        ids = bench.draw(scene, **{**flat.FLAT, "visibility": visibility})["id"]
        yield wrong_pixels(ids, owners)


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
        covered = frame.alpha > 0
        surely, perhaps = (flat.polygon_interior(corners, size, margin) for margin in (1 / 64, -1 / 64))
        yield Outcome(int(((surely & ~covered) | (covered & ~perhaps)).sum()), pictures=(covered, surely))


def far_coordinates(bench: Bench) -> Outcomes:
    """Corners on both sides of the guard band, up to 1e38 and 1e100, in both projections: all pixels, or the oracle's."""
    size = (40, 30)
    for reach in (8191.0, 8191.5, 24575.0, 24575.5, 32768.0, 2.0**31, 1e12, 1e20, 1e38, 1e100):
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
        yield against_oracle(Frame(frame.rgba, {"id": frame["id"]}, frame.scene, frame.settings, dict))
        expected = oracle.render(frame.scene, frame.settings)
        near = (frame["id"] == expected.id) & (
            expected.id <= len(lit.blob().faces)
        )  # depths of the rest exceed float32
        right = ~near | (expected.id == 0) | (depth_errors(frame["Z"], expected) <= depth_roundings(frame["Z"]))
        yield Outcome(int(np.count_nonzero(~right)))


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
        finite = bench.draw(lit.scene_of(replace(mesh, faces=mesh.faces[~lost])))
        yield Outcome(int(frame.stats["nonfinite"] != lost.sum()))
        yield from (wrong_pixels(frame.rgb, finite.rgb), against_oracle(frame))


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
    Case("1", "shared-edges", "4x4 rotated quads share edges", "each pixel once", shared_edges),
    Case("3", "perspective-edges", "shared edges, depths 0.1 to 4", "each pixel once", perspective_edges, True),
    Case("5", "random-triangles", "random, adversarial, 2^0..2^8 px", "as exact integers", random_triangles, True),
    Case("5b", "half-pixel-grid", "all of a 7x7 half-pixel grid", "as exact integers", half_pixel_grid, True),
    Case("6", "edges-on-centers", "corners and edges on pixel centers", "top-left rule", edges_on_centers),
    Case("10", "slivers", "needles 1e5:1, slivers of 0.01 px", "each pixel once, no hole", slivers),
    Case("11", "many-into-few", "1.6M triangles into 64x64", "each pixel once, no hole", million_into_64, True),
    Case("11b", "two-a-pixel", "one mesh of two triangles a pixel", "the upper one's pixel", two_a_pixel),
    Case("12", "huge-triangle", "a triangle 1e4 times the screen", "exact at every pixel", huge_triangle),
    Case("13", "far-coordinates", "past +-32768 px, 1e38, 1e100", "clipped, never wrapped", far_coordinates),
    Case("14", "not-finite", "NaN and infinite vertices", "dropped and counted", not_finite),
    Case("15", "near-plane", "behind, across, at the eye", "near-clipped, never mirrored", near_plane),
)
