"""Cases 18 to 20b: visibility, of lines too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....scene.model import Mesh
from ....scene.settings import Edges
from . import flat, lit
from .bench import PRESETS, Bench, Case, Outcome, Outcomes, against_oracle, different_bits, wrong_pixels
from .coverage import grid


def equal_depth(bench: Bench) -> Outcomes:
    """Coincident triangles of bit-identical depth: the later face wins, in any order of the list; -0.0 among the
    coordinates equals 0.0."""
    rng = np.random.default_rng(18)
    size = flat.SUB * np.exp2(rng.uniform(1.0, 6.0, (300, 1, 1)))
    xy = np.rint(rng.uniform(0, 80 * flat.SUB, (300, 1, 2)) + size * rng.uniform(-1, 1, (300, 3, 2))).astype(np.int64)
    for order in (np.arange(300), np.arange(300)[::-1], rng.permutation(300)):
        ids = flat.exact(xy[order], (80, 70))
        for visibility in ("painter", "depth"):
            frames = [flat.draw(bench, xy[order], (80, 70), visibility=visibility) for _ in range(2)]
            yield from [wrong_pixels(frame["id"], ids) for frame in frames]
            yield different_bits(*frames)
    mesh = lit.blob()
    near = np.abs(mesh.verts) < 0.1
    meshes = (replace(mesh, verts=np.where(near, zero, mesh.verts)) for zero in (0.0, -0.0))
    yield different_bits(*(bench.draw(lit.scene_of(each)) for each in meshes))


def close_depths(bench: Bench) -> Outcomes:
    """Two triangles in each of 64 cells, one float32 ulp apart in depth, or 16 float64 ulp (with visibility `depth`
    2^-10 of a float32 ulp): the nearer one is visible, although it comes first."""
    rng = np.random.default_rng(19)
    cell = np.stack(np.divmod(np.arange(64), 8), axis=1)[:, None, :] * 8 * flat.SUB
    corners = np.array([[1, 1], [38, 2], [2, 37]]) * flat.SUB // 5 + cell
    xy = np.concatenate([corners, corners])
    expected = flat.exact(corners, (64, 64))
    uv, faces = flat.separate(xy)
    for magnitude in (1e-30, 1e-10, 1.0, 1e6, 1e15, 1e30):
        far = (magnitude * rng.uniform(1.0, 2.0, 64)).astype(np.float32)
        if magnitude > 1e29:
            far = np.minimum(far, np.float32(1.9e30))
        ulp = np.spacing(far).astype(np.float64)
        fine = {"painter": 16 * np.spacing(far.astype(np.float64)), "depth": ulp * 2.0**-10}
        for visibility, step in (("painter", ulp), ("depth", ulp), *fine.items()):
            depth = np.repeat(np.concatenate([far - step, far.astype(np.float64)]), 3)
            scene = flat.scene_of(uv, faces, (64, 64), depth)
            frame = bench.draw(scene, **{**flat.FLAT, "visibility": visibility, "near": magnitude / 2})
            yield wrong_pixels(frame["id"], expected, f"{visibility} at {magnitude:g}")


def _bars() -> tuple[Mesh, np.ndarray]:
    """Return three bars, each over the next at its start and under the previous one at its end, and where each must be
    on top."""
    angle = np.radians([90.0, 210.0, 330.0])
    tips = 0.9 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    verts = []
    for start, end in zip(tips, np.roll(tips, -1, axis=0), strict=True):
        along = (end - start) / np.hypot(*(end - start))
        side = 0.2 * np.array([-along[1], along[0]])
        for point, height in ((start - 0.5 * along, 0.4), (end + 0.5 * along, -0.4)):
            verts += [[*(point + side), height], [*(point - side), height]]
    faces = (4 * np.arange(3)[:, None] + [0, 1, 3, 0, 3, 2]).reshape(-1, 3)
    colors = np.repeat(np.eye(3), 4, axis=0)
    return Mesh(np.array(verts) * (1 + 2.0**-40), faces, colors=colors, material=lit.MATERIAL), tips


def cyclic_overlap(bench: Bench) -> Outcomes:
    """`depth`: each bar is over the next. `painter`: one mean depth per triangle, as in the oracle, in every run."""
    mesh, tips = _bars()
    camera = replace(lit.CAMERA, eye=np.array([0.0, 0.0, 5.0]), lookat=np.zeros(3))
    for preset in PRESETS:
        frames = [bench.draw(lit.scene_of(mesh, camera=camera), preset=preset) for _ in range(2)]
        yield from [against_oracle(frames[0]), different_bits(*frames)]
        if preset == "standard":
            column, row = (np.floor((tips * 1.3 / 5.0 * [1, -1] + 0.5) * 61)).astype(int).T
            owner = (frames[0]["id"][row, column].astype(int) - 1) // 2
            yield Outcome(int((owner != np.arange(3)).sum()))


# Lines along edges


def _sheet(cells: int, size: float) -> Mesh:
    """Return a square in the plane z = 0 around the origin, of 2 * cells^2 triangles."""
    points, faces = grid(cells)
    return Mesh(np.column_stack([2.0 * size * points, np.zeros(len(points))]), faces, material=lit.MATERIAL)


def lines(bench: Bench) -> Outcomes:
    """Every sample shows a line exactly where the oracle's does: edges seen end-on, at coordinates of 1e7, across the near
    plane, and in a mesh finer than pixels; twice the same bits."""
    coarse, fine = _sheet(3, 1.0), _sheet(90, 0.9)
    side = replace(coarse, verts=coarse.verts[:, [2, 0, 1]])  # in the plane x = 0, seen edge-on or nearly
    views = (
        ("end-on", coarse, [0.0, 0.0, 4.0], 0.0),
        ("nearly end-on", coarse, [1e-6, 1e-9, 4.0], 0.0),
        ("far", coarse, [0.7, 0.4, 3.0], np.array([1e7, -3e7, 2e7])),
        ("near plane", coarse, [0.4, 0.3, 0.2], 0.0),
        ("fine", fine, [0.5, 0.6, 3.0], 0.0),
    )
    for name, mesh, eye, shift in views:
        camera = replace(lit.CAMERA, eye=np.array(eye), lookat=np.zeros(3))
        scene = lit.shifted(lit.scene_of(mesh, side, camera=camera), 1.0, shift)
        frames = [bench.draw(scene, edges=Edges("all", width=1.3)) for _ in range(2)]
        yield from [against_oracle(frames[0], name), different_bits(*frames)]


CASES = (
    Case("18", "equal-depth", "equal depths, -0.0", "the later face, at every run", equal_depth),
    Case("19", "close-depths", "depths one ulp apart, 1e-30..1e30", "not quantized: the nearer", close_depths),
    Case("20", "cyclic-overlap", "bars over each other in a ring", "depth right, painter as defined", cyclic_overlap),
    Case("20b", "lines", "edges end-on, far, near, finer than pixels", "hidden exactly, the same bits", lines, True),
)
