"""The view of a frame: the camera, its axes, the near plane, and the scale that brings the scene within float32's range; and
projection on the host, in float64: near-plane and guard-band clipping of the faces that need it, and kernels/project.cl for
devices without float64; and the sample positions of a pixel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from ..base.arrays import Array, Floats, Integers
from ..errors import InputError
from ..scene.camera import Camera, Raster, raster_of
from ..scene.geometry import bounding_box, camera_axes
from ..scene.model import Scene
from .shading_tables import scale_for
from .struct_layout import GUARD_HIGH, GUARD_LOW, MOST_DEPTH, MOST_LENGTH, SAMPLE_BITS, SNAP_LIMIT, SUBPIXEL_BITS

GOLDEN = (5.0**0.5 - 1.0) / 2.0


class Extent(NamedTuple):
    """The bounding box of a scene's vertices, (3,) each, and half its diagonal."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    radius: float

    @classmethod
    def of(cls, low: Array, high: Array) -> Extent:
        return cls(tuple(low.tolist()), tuple(high.tolist()), math.hypot(*(high / 2.0 - low / 2.0)))


class CameraSpace(NamedTuple):
    """A camera; its axes, rows are camera x, y, z in world space; the distance of the near plane, scene units; the power of
    two that brings eye-relative positions to about 1; and the raster of the image that is drawn in whole or in part."""

    camera: Camera
    axes: Array
    near: float
    scale: float
    raster: Raster

    @classmethod
    def of(cls, camera: Camera, extent: Extent | None, near: float | None) -> CameraSpace:
        """Return the space of a camera. near: as in Settings; None: 1e-4 of the scene's radius. Raises InputError if
        float64 cannot hold the scene."""
        farthest = 1.0
        if extent is not None:
            corners = zip(camera.eye.tolist(), extent.low, extent.high, strict=True)
            farthest = max(max(abs(low - at), abs(high - at)) for at, low, high in corners)
        near = near or 1e-4 * ((extent and extent.radius) or math.dist(camera.eye, camera.lookat))
        if not math.isfinite(farthest) or not math.isfinite(near):
            raise InputError("render: scene: expected coordinates whose differences float64 can hold")
        # A vertex 2^40 times as far away as the near plane must not push near ones out of float32's range.
        return cls(camera, camera_axes(camera), near, scale_for(min(farthest, 2.0**40 * near)), raster_of(camera))

    def write_view(self, view: np.void) -> None:
        """Fill a row of structs.View, but for what the frame needs."""
        raster = self.raster
        view["eye"], view["axes"] = self.camera.eye, self.axes.reshape(-1)
        view["principal"], view["focal"] = raster.principal, self.camera.focal
        view["plane_height"], view["plane_width"] = raster.plane
        view["columns"], view["rows"] = raster.resolution
        view["guarded"] = raster.corner
        view["first"] = [place << SUBPIXEL_BITS for place in raster.first]
        view["near"], view["scale"] = self.near, self.scale

    def points(self, positions: Array) -> Array:
        """Transform world positions (..., 3) to camera space, float64."""
        d = positions.astype(np.float64) - self.camera.eye
        return np.stack([(d[..., 0] * a[0] + d[..., 1] * a[1]) + d[..., 2] * a[2] for a in self.axes], axis=-1)


def near_plane(scene: Scene) -> float:
    """Return the distance of the near plane of a scene whose settings give none."""
    low, high = bounding_box(scene)
    return CameraSpace.of(scene.camera, Extent.of(low, high) if scene.face_count else None, None).near


class Pieces(NamedTuple):
    """The triangles that clipping produces."""

    source: Array  # (C,), row of the face of each
    points: Array  # (C, 3, 3), corners, camera space
    weights: Array  # (C, 3, 3), barycentric coordinates of each corner in its face


def image_positions(points: Array, camera: Camera) -> Array:
    """Return continuous image coordinates (..., 2), of the whole image, of camera-space points (..., 3) in front of the
    eye."""
    raster = raster_of(camera)
    (height, width), (columns, rows), principal = raster.plane, raster.resolution, raster.principal
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if camera.orthographic:
        across, up = x / width, y / height
    else:
        across, up = (camera.focal * x) / (z * width), (camera.focal * y) / (z * height)
    return np.stack([(across + principal[0]) * columns, (up + principal[1]) * rows], axis=-1)


def scaled_w(z: Array, space: CameraSpace) -> Floats:
    """Return 1/depth, scaled, of depths z before the near plane; of a parallel projection -depth."""
    depth = np.minimum(z * space.scale, MOST_DEPTH)
    return np.asarray(-depth if space.camera.orthographic else 1.0 / depth)


def snap(positions: Array, raster: Raster) -> Integers:
    """Round image coordinates to 1/65536 px from the drawn part's first pixel, int64, ties to even, clamped to the guard
    band."""
    corner = np.array(raster.corner, np.float64)
    held = np.clip(positions, corner + GUARD_LOW, corner + GUARD_HIGH)
    snapped: Integers = np.rint(held * (1 << SUBPIXEL_BITS)).astype(np.int64)
    return snapped - (np.array(raster.first, np.int64) << SUBPIXEL_BITS)


def _planes(camera: Camera, near: float) -> Iterator[tuple[int, float, float, float]]:
    """Yield axis, side, slope and offset of the near plane and of the guard band's left, right, lower and upper plane: what
    is inside has side*(slope*x + offset*z) >= 0; for the near plane, and in a parallel projection, z counts as 1."""
    yield 2, 1.0, 1.0, -near
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
    return np.asarray(start + (d_start / (d_start - d_end))[:, None] * (end - start))


def _cut(polygons: Array, counts: Array, distance: Array, closed: bool) -> tuple[Array, Array, Array]:
    """Keep the part of each polygon where the distance (n, m) of its corners is not negative.

    polygons: (n, m, k), the first counts[i] rows of each in use. Returns polygons, counts, and where the new corners are.
    """
    n, m, width = polygons.shape
    slot = np.arange(m)
    used = slot < counts[:, None]
    following = np.where(slot + 1 < counts[:, None], slot + 1, 0 if closed else slot)
    inside = used & (distance >= 0.0)
    crosses = used & (inside != np.take_along_axis(inside, following, axis=1))
    emitted = inside.astype(np.int64) + crosses
    end = np.cumsum(emitted, axis=1)
    place = end - emitted
    result = np.zeros((n, m + 1, width))
    is_new = np.zeros((n, m + 1), bool)
    i, j = np.nonzero(inside)
    result[i, place[i, j]] = polygons[i, j]
    i, j = np.nonzero(crosses)
    k = following[i, j]
    at = place[i, j] + inside[i, j]
    result[i, at] = _crossings(polygons[i, j], polygons[i, k], distance[i, j], distance[i, k])
    is_new[i, at] = True
    return result, end[:, -1], is_new


def cut_to_view(polygons: Array, camera: Camera, near: float, *, closed: bool = True) -> tuple[Array, Array]:
    """Clip polygons, or segments if not `closed`, to z >= near and, if they exceed it, to the guard band.

    polygons: (n, m, 3 or more), corners in camera space, and what is linear in them. Returns (n, l, ...), and how many rows
    of each are in use. Sutherland and Hodgman's algorithm, with the points of `_crossings`.
    """
    counts = np.full(len(polygons), polygons.shape[1])
    for axis, side, slope, offset in _planes(camera, near):
        far, flat = np.ones(len(polygons), bool), axis == 2 or camera.orthographic  # far: reach beyond the plane
        if axis != 2:
            with np.errstate(divide="ignore", invalid="ignore"):
                place = image_positions(polygons[..., :3], camera) - raster_of(camera).corner
                beyond = ~((place >= GUARD_LOW) & (place <= GUARD_HIGH)).all(axis=2)
            far = np.asarray((beyond & (np.arange(polygons.shape[1]) < counts[:, None])).any(axis=1))
            if not far.any():
                break
        distance = side * (slope * polygons[..., axis]) + side * offset * (1.0 if flat else polygons[..., 2])
        polygons, counts, is_new = _cut(polygons, counts, np.where(far[:, None], distance, 1.0), closed)
        # Exactly on the plane: on an edge from -1e38 to 1e38 rounding could give any point at all.
        on_plane = -offset * (1.0 if flat else polygons[..., 2]) / slope
        polygons[..., axis] = np.where(is_new, on_plane, polygons[..., axis])
    return polygons, counts


def clip(points: Array, camera: Camera, near: float) -> Pieces:
    """Clip triangles, (n, 3, 3) camera space, as `cut_to_view` does, each to a fan from the first corner that is left."""
    weights = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    polygons, counts = cut_to_view(np.concatenate([points, weights], axis=2), camera, near)
    sources, corners = [], []
    for last in range(2, polygons.shape[1]):
        rows = np.flatnonzero(counts > last)
        sources.append(rows)
        corners.append(polygons[rows][:, [0, last - 1, last]])
    source = np.concatenate(sources)
    order = np.argsort(source, kind="stable")
    joined = np.concatenate(corners)[order]
    return Pieces(source[order], joined[..., :3], joined[..., 3:])


def project_on_host(positions: Array, space: CameraSpace, vertices: Array, relative: Array) -> None:
    """Fill `vertices` (V,) SINGLE.Vertex and `relative` (V, 4) float32 from positions (V, 3), world space, with the
    operations of kernels/project.cl, hence its bits: what lies beyond the guard band is at SNAP_LIMIT."""
    points, raster = space.points(positions), space.raster
    in_front = np.flatnonzero(points[:, 2] >= space.near)
    with np.errstate(over="ignore", invalid="ignore"):
        pixels = image_positions(points[in_front], space.camera)
        from_region = pixels - np.array(raster.corner, np.float64)
        inside = (from_region >= GUARD_LOW) & (from_region <= GUARD_HIGH)
        w = scaled_w(points[in_front, 2], space)
    snapped = np.rint(np.where(inside, pixels, 0.0) * (1 << SUBPIXEL_BITS))
    snapped -= np.array(raster.first, np.int64) << SUBPIXEL_BITS
    snapped = np.where(inside, snapped, np.where(from_region > 0.0, SNAP_LIMIT, -SNAP_LIMIT)).astype(np.int32)
    vertices[:] = 0
    vertices["depth"] = points[:, 2]
    vertices["x"][in_front], vertices["y"][in_front] = snapped.T
    vertices["w"][in_front], vertices["w_low"][in_front] = w, w - w.astype(np.float32)
    relative[:, :3] = np.clip((positions - space.camera.eye) * space.scale, -MOST_LENGTH, MOST_LENGTH)
    relative[:, 3] = 0.0


@cache
def sample_positions(samples: int) -> Integers:
    """Return (S, 2) int: x and y of a pixel's samples from its lower left corner, 1/256 px, nearest to the center first.

    Sample i of S lies at x = (i + 1/2)/S. 4, 9 and 16 samples, n x n, are a rotated grid: y = (j + 1 - x)/n, j = i modulo n.
    Others are the Kronecker sequence of the golden ratio phi, whose discrepancy is low for every S: y = the fractional part
    of 1/2 + (i - (S - 1)/2)/phi. Both are symmetric about the center, and rounded to the grid. Of samples equally near to
    the center the one with the smaller i is first.
    """
    i, rows, grid = np.arange(samples), math.isqrt(samples), 1 << SAMPLE_BITS
    x = (i + 0.5) / samples
    y = (i % rows + 1.0 - x) / rows if samples in (4, 9, 16) else (0.5 + (i - (samples - 1) / 2.0) * GOLDEN) % 1.0
    placed = np.minimum(np.rint(np.stack([x, y], axis=1) * grid).astype(np.int64), grid - 1)
    offset = placed - grid // 2
    ordered: Integers = placed[np.argsort((offset * offset).sum(axis=1), kind="stable")]
    ordered.flags.writeable = False
    return ordered
