"""Near-plane and guard-band clipping on the host, in float64, of the faces that need it; pieces are set up on the device."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..errors import InputError
from ..scene.camera import Camera
from ..scene.image_part import Raster, raster_of
from ..scene.model import MAX_FACES
from .buffers import Buffer
from .frame_state import SceneFrame
from .programs import running_time
from .struct_layout import GUARD_HIGH, GUARD_LOW, MOST_DEPTH, SUBPIXEL_BITS
from .triangle_source import Faces, Triangles, TriangleSource, set_up_pieces


@dataclass(frozen=True)
class Pieces:
    """The triangles that clipping produces.

    source: (C,) row of the face of each. points: (C, 3, 3) corners, camera space.
    weights: (C, 3, 3) barycentric coordinates of each corner in its face.
    """

    source: Array
    points: Array
    weights: Array


def image_positions(points: Array, camera: Camera) -> Array:
    """Return continuous image coordinates (..., 2), of the whole image, of camera-space points (..., 3) in front of the
    eye."""
    raster = raster_of(camera)
    (height, width), (columns, rows), principal = raster.plane, raster.resolution, raster.principal
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.orthographic:
        u = (x / width + principal[0]) * columns
        v = (y / height + principal[1]) * rows
    else:
        u = ((camera.focal * x) / (z * width) + principal[0]) * columns
        v = ((camera.focal * y) / (z * height) + principal[1]) * rows
    return np.stack([u, v], axis=-1)


def beyond_guard_band(points: Array, camera: Camera) -> Bools:
    """Return whether camera-space points (..., 3) before the eye lie beyond the guard band, along each axis (..., 2)."""
    corner = raster_of(camera).corner
    place = image_positions(points, camera) - corner
    beyond: Bools = ~((place >= GUARD_LOW) & (place <= GUARD_HIGH))
    return beyond


def snap(positions: Array, raster: Raster) -> Integers:
    """Round image coordinates to 1/65536 px from the drawn part's first pixel, int64, ties to even, clamped to the guard
    band."""
    corner = np.array(raster.corner, np.float64)
    held = np.clip(positions, corner + GUARD_LOW, corner + GUARD_HIGH)
    snapped: Integers = np.rint(held * (1 << SUBPIXEL_BITS)).astype(np.int64)
    return snapped - (np.array(raster.first, np.int64) << SUBPIXEL_BITS)


def guard_planes(camera: Camera) -> Iterator[tuple[int, float, float, float]]:
    """Yield axis, side, slope and offset of the guard band's left, right, lower and upper plane: what is inside has
    side*(slope*x + offset*z) >= 0; in a parallel projection z counts as 1."""
    raster = raster_of(camera)
    for axis in (0, 1):
        size = raster.resolution[axis]
        slope = (1.0 if camera.orthographic else camera.focal) * size / raster.plane[1 - axis]
        center = raster.principal[axis] * size - raster.corner[axis]
        for side, limit in ((1.0, GUARD_LOW), (-1.0, GUARD_HIGH)):
            yield axis, side, slope, center - limit


def _crossings(a: Array, b: Array, da: Array, db: Array) -> Floats:
    """Return the points where the edges from rows of a to rows of b (position and weights side by side) meet the plane.

    Each is computed from the end nearer the plane (then by x, y, z), in whichever direction its edge is traversed: faces
    that share the edge share the point, and an end 1e38 away costs no digits.
    """
    first = a[:, 2] <= b[:, 2]
    for axis in (1, 0):
        first = np.where(a[:, axis] == b[:, axis], first, a[:, axis] < b[:, axis])
    first = np.where(np.abs(da) == np.abs(db), first, np.abs(da) < np.abs(db))
    start, end = np.where(first[:, None], a, b), np.where(first[:, None], b, a)
    d_start, d_end = np.where(first, da, db), np.where(first, db, da)
    crossings: Floats = start + (d_start / (d_start - d_end))[:, None] * (end - start)
    return crossings


def _cut(polygons: Array, counts: Array, distance: Array) -> tuple[Array, Array, Array]:
    """Keep the part of each polygon where the distance (n, m) of its corners is not negative.

    polygons: (n, m, 6), the first counts[i] rows of each in use. Returns polygons, counts, and where the new corners are.
    """
    n, m, _ = polygons.shape
    slot = np.arange(m)
    used = slot < counts[:, None]
    following = np.where(slot + 1 < counts[:, None], slot + 1, 0)
    inside = used & (distance >= 0.0)
    crosses = used & (inside != np.take_along_axis(inside, following, axis=1))
    emitted = inside.astype(np.int64) + crosses
    end = np.cumsum(emitted, axis=1)
    place = end - emitted
    result = np.zeros((n, m + 1, 6))
    made = np.zeros((n, m + 1), bool)
    i, j = np.nonzero(inside)
    result[i, place[i, j]] = polygons[i, j]
    i, j = np.nonzero(crosses)
    k = following[i, j]
    at = place[i, j] + inside[i, j]
    result[i, at] = _crossings(polygons[i, j], polygons[i, k], distance[i, j], distance[i, k])
    made[i, at] = True
    return result, end[:, -1], made


def clip(points: Array, camera: Camera, near: float) -> Pieces:
    """Clip triangles, (n, 3, 3) camera space, to z >= near and, if they exceed it, to the guard band.

    Sutherland and Hodgman's algorithm; every crossing is computed from its edge's end points in one order, so
    that faces that share an edge share the new corner. Each remaining polygon is split into a fan from its first corner.
    """
    n = len(points)
    weights = np.broadcast_to(np.eye(3), (n, 3, 3))
    polygons, counts, made = _cut(np.concatenate([points, weights], axis=2), np.full(n, 3), points[:, :, 2] - near)
    polygons[..., 2] = np.where(made, near, polygons[..., 2])
    for axis, side, slope, offset in guard_planes(camera):
        with np.errstate(divide="ignore", invalid="ignore"):
            beyond = beyond_guard_band(polygons[..., :3], camera)
        used = np.arange(polygons.shape[1]) < counts[:, None]
        far = np.asarray((beyond.any(axis=2) & used).any(axis=1))
        if not far.any():
            break
        depth = 1.0 if camera.orthographic else polygons[..., 2]
        distance = side * (slope * polygons[..., axis]) + side * offset * depth
        polygons, counts, made = _cut(polygons, counts, np.where(far[:, None], distance, 1.0))
        # Exactly on the plane: on an edge from -1e38 to 1e38 rounding could give any point at all.
        depth = 1.0 if camera.orthographic else polygons[..., 2]
        polygons[..., axis] = np.where(made, -offset * depth / slope, polygons[..., axis])
    sources, corners = [], []
    for last in range(2, polygons.shape[1]):
        rows = np.flatnonzero(counts > last)
        sources.append(rows)
        corners.append(polygons[rows][:, [0, last - 1, last]])
    source = np.concatenate(sources)
    order = np.argsort(source, kind="stable")
    joined = np.concatenate(corners)[order]
    return Pieces(source[order], joined[..., :3], joined[..., 3:])


class Clipping:
    """Clips the faces that the near plane or the guard band cuts.

    uvs, uv_faces: (T, 4) and (F, 3) texture coordinates, double-singles (u, v, low parts of u, v), or None. depth_test: sort
    by the nearest corner of each piece, else by the mean depth of its face.
    """

    def __init__(self, source: TriangleSource, uvs: Array | None, uv_faces: Array, *, depth_test: bool) -> None:
        self._source, self._uvs, self._uv_faces, self._depth_test = source, uvs, uv_faces, depth_test
        self._none = Buffer.empty(source.stages.device, 0, source.stages.structs.Piece)

    def nothing_clipped(self, visible: int) -> Triangles:
        """Return the source's triangles, so many of them visible, without pieces."""
        return Triangles(self._source.made, visible, self._none)

    def clip(self, frame: SceneFrame) -> Triangles:
        """Clip what the frame's setup listed, and set up the pieces. Raises InputError for more triangles than MAX_FACES."""
        source, stages, counters = self._source, self._source.stages, frame.read_counters()
        if not counters["to_clip"]:
            return self.nothing_clipped(int(counters["visible"]))
        start = running_time()
        faces = source.to_clip(int(counters["to_clip"]))
        table, sources = self._pieces(faces, frame)
        count = len(table)
        if source.room + count > MAX_FACES:
            limit = f"at most {MAX_FACES} triangles, pieces of clipped ones included"
            raise InputError(f"render: scene: expected {limit}, found {source.room} and {count} pieces")
        if source.make_room(count):
            with frame.counted.writing() as rows:
                rows[:] = 0
            source.set_up(frame)
        pieces = self._none
        if count:
            pieces = Buffer(stages.device, table)
            source.add_pieces(faces, sources)
            set_up_pieces(stages, pieces, frame, source.made, source.room, source.sides)
            counters = frame.read_counters()
        frame.host_ms["clip"] = (running_time() - start) * 1e3
        return Triangles(source.made, int(counters["visible"]), pieces)

    def _pieces(self, faces: Faces, frame: SceneFrame) -> tuple[Array, Array]:
        """Clip faces to the near plane and the guard band: the table of pieces, (C,) of `structs.Piece`, and which of the
        faces each comes from."""
        space, real = frame.space, self._source.stages.structs.real
        points = space.points(faces.corners)
        cut = clip(points, space.camera, space.near)
        table = np.zeros(len(cut.source), self._source.stages.structs.Piece)
        if self._depth_test:
            table["key_depth"] = cut.points[..., 2].min(axis=1)
        else:
            z = points[..., 2]
            table["key_depth"] = (((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)[cut.source]
        depth = np.minimum(cut.points[..., 2] * space.scale, MOST_DEPTH)
        pairs = {"w": -depth if space.camera.orthographic else 1.0 / depth, "weights": cut.weights.reshape(-1, 9)}
        if self._uvs is not None:
            parts = self._uvs[self._uv_faces[faces.numbers]].astype(np.float64)
            uvs = (parts[..., :2] + parts[..., 2:])[cut.source]
            pairs["uv"] = np.einsum("cjk,ckd->cjd", cut.weights, uvs).reshape(-1, 6)
        for name, value in pairs.items():
            table[name], table[f"{name}_low"] = value, value - value.astype(real)
        snapped = snap(image_positions(cut.points, space.camera), space.raster)
        table["x"], table["y"] = snapped[..., 0], snapped[..., 1]
        table["face"] = faces.numbers[cut.source]
        return table, cut.source
