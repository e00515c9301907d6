"""Triangles in image coordinates: scenes that place them exactly there, and rasterization in exact integers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....base.arrays import Array
from ....oracle import coverage
from ....pipeline.frame import Frame
from ....pipeline.struct_layout import SUBPIXEL_BITS
from ....scene.camera import Camera
from ....scene.model import Material, Mesh, Scene
from .bench import Bench, Outcome

SUB = 1 << SUBPIXEL_BITS
HALF = SUB // 2
Resolution = tuple[int, int]

ONE = np.array([[0, 1, 2]])  # the faces of a single triangle

# All unlit scenes share a material and have positions that are not float32 values, so that one program serves them all.
# The nudge is far too small to move a snapped corner.
NUDGE = 2.0**-38
UNLIT = Material(0.0, 1.0, 0.0, 1.0)
DEPTH = 1.0 + 2.0**-40
FLAT = {"shader": "nolight", "visibility": "painter", "near": 0.5}


def scene_of(uv: Array, faces: Array, resolution: Resolution, depth: Array | float = DEPTH) -> Scene:
    """Return a scene of one mesh with its vertices at image coordinates uv (V, 2), in pixels. World x and y are pixels from
    the image's center, -z is the depth."""
    columns, rows = resolution
    verts = np.empty((len(uv), 3))
    verts[:, :2] = uv - np.array([columns / 2 - NUDGE, rows / 2])
    verts[:, 2] = -np.asarray(depth)
    camera = Camera(np.zeros(3), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 1.0, (rows, columns), resolution, orthographic=True)
    return Scene((Mesh(verts, faces, material=UNLIT),), camera, background=None)


def separate(xy: Array) -> tuple[Array, Array]:
    """Convert snapped triangles (F, 3, 2) to image coordinates (3F, 2) and faces (F, 3)."""
    return xy.reshape(-1, 2) / SUB, np.arange(3 * len(xy)).reshape(-1, 3)


def draw(bench: Bench, xy: Array, resolution: Resolution, **options: object) -> Frame:
    """Render snapped triangles (F, 3, 2) without shared vertices."""
    return bench.draw(scene_of(*separate(xy), resolution), **{**FLAT, **options})


def exact(xy: Array, resolution: Resolution) -> Array:
    """Return the ids of snapped triangles (F, 3, 2), (M, N), row 0 at the TOP, computed in integers; the later face
    wins."""
    columns, rows = resolution
    ids = np.zeros((rows, columns), np.uint32)
    setup = coverage.setup(xy, columns, rows)
    alive = np.flatnonzero(~setup.culled)
    for k, column, row, _ in coverage.samples(xy[alive], setup.box[alive]):
        np.maximum.at(ids, (rows - 1 - row, column), (alive[k] + 1).astype(np.uint32))
    return ids


def drawn_once(bench: Bench, scene: Scene, inside: Array) -> Outcome:
    """Check that a mesh whose triangles all have equal depth draws each pixel of `inside` (M, N) bool exactly once.

    A pixel drawn by two triangles gets the later one, so a different one with the faces in reverse order. Pixels
    outside `inside` may be drawn at most once.
    """
    mesh = scene.meshes[0]
    count = len(mesh.faces)
    turned = replace(scene, meshes=(replace(mesh, faces=mesh.faces[::-1]),))
    ids = bench.draw(scene, **FLAT)["id"].astype(np.int64)
    turned_ids = bench.draw(turned, **FLAT)["id"].astype(np.int64)
    turned_ids = np.where(turned_ids > 0, count + 1 - turned_ids, 0)
    wrong = (ids != turned_ids) | (inside & (ids == 0))
    return Outcome(int(wrong.sum()), pictures=(ids, np.where(inside, np.maximum(ids, 1), ids * ~wrong)))


def polygon_interior(corners: Array, resolution: Resolution, margin: float = 1 / 64) -> Array:
    """Return the centers, (M, N) bool, row 0 at the TOP, inside a convex counter-clockwise polygon (n, 2) in pixels, by
    a margin larger than snapping."""
    columns, rows = resolution
    x, y = np.arange(columns) + 0.5, (rows - 0.5 - np.arange(rows))[:, None]
    inside = np.ones((rows, columns), bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        direction = (b - a) / np.hypot(*(b - a))
        inside &= direction[0] * (y - a[1]) - direction[1] * (x - a[0]) > margin
    return inside
