"""Triangulation of polygons, strips and fans of vertex indices, vectorized."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Floats
from .ear_clipping import Cutter

CUT_AS_FANS = "concave polygons of very many corners (cut as fans)"  # description of Cuts.left
_BLOCK = 1 << 14  # corners whose temporary arrays stay in the cache
_TINY = 2.0**-800  # squared normal, in a mesh of size 1: not far from underflow
_NO_AREA = 2.0**-40  # of a polygon of size 1: a smaller area is rounding error
_ROUNDING = 2.0**-46  # rounding error of a triangle's part in the squared normal of a polygon of size 1
_NO_OTHER = np.zeros(0, np.intp), np.zeros((0, 3), np.intp)


@dataclass(frozen=True)
class Cuts:
    """Polygons cut into triangles, in the order of the polygons.

    They are fans around the first corner, except for the triangles with the numbers `other` (T,), which have the
    corners `places` (T, 3). counts: (P,) corners of each polygon. left: the number of polygons that are fans, right or
    not, because a better triangulation would take too long.
    """

    counts: Array
    other: Array
    places: Array
    left: int = 0

    @property
    def polygon(self) -> Array:
        """(F,) the polygon of each triangle."""
        numbers = np.arange(len(self.counts), dtype=np.int32)
        return numbers if (self.counts == 3).all() else np.repeat(numbers, self.counts - 2)

    def triangles(self, values: Array) -> Array:
        """Return (F, 3, ...) the values (C, ...) of all corners at the corners of the triangles; may be a view."""
        count = int(self.counts.max(initial=3))
        if len(values) == count * len(self.counts):
            found = _fans(values.reshape(-1, count, *values.shape[1:]))
        else:
            found = values[_mixed_fans(self.counts)]
        if len(self.other):
            found[self.other] = values[self.places]
        return found


def triangulated(verts: Array, corners: Array, counts: Array) -> Cuts:
    """Cut polygons into triangles with the same winding; each polygon of n corners gives n - 2.

    verts: (V, 3) finite positions. corners: (C,) indices into verts, one polygon after the other. counts: (P,) corners
    of each, at least 3.

    A polygon becomes a fan around its first corner unless a triangle of the fan would be inverted as seen along the
    polygon's own normal (Newell's); convex polygons, collinear corners and zero-area polygons are therefore fans. A
    quadrilateral is then cut along its other diagonal, any other polygon by ear clipping in the plane of its normal,
    provided that this inverts less area than the fan (a self-intersecting polygon may have no cut without).
    Positions of any magnitude, and polygons far smaller than their mesh, are cut alike.
    """
    if (counts == 3).all():
        return Cuts(counts, *_NO_OTHER)
    # By coordinate, times the power of two (exact) that brings the largest to 1.
    exponent = int(np.frexp(max(verts.max(initial=0.0), -verts.min(initial=0.0)))[1])
    if abs(exponent) < 1000:
        columns: Floats = np.multiply(verts.T, 2.0**-exponent, order="C", dtype=np.float64)
    else:
        columns = np.ldexp(np.array(verts.T, np.float64, order="C"), -exponent)
    turned = _turned(columns, corners, counts)
    if not len(turned):
        return Cuts(counts, *_NO_OTHER)
    first, start = np.cumsum(counts - 2) - (counts - 2), np.cumsum(counts) - counts
    cutter = Cutter()
    other, places = [], []
    for chosen in _by_count(counts[turned]):
        which = turned[chosen]
        count = int(counts[which[0]])
        for rows in _blocks(len(which), count):
            own = start[which[rows], None] + np.arange(count)
            cuts = _recut(columns[:, corners[own]], cutter)
            other.append((first[which[rows], None] + np.arange(count - 2)).reshape(-1))
            places.append(np.take_along_axis(own[:, None], cuts, axis=2).reshape(-1, 3))
    return Cuts(counts, np.concatenate(other), np.concatenate(places), cutter.left)


def _fans(polygons: Array) -> Array:
    """Return (P * (n - 2), 3, ...), the fans of polygons with corners (P, n, ...)."""
    count, rest = polygons.shape[1], polygons.shape[2:]
    if count == 3:
        return polygons
    fans = np.empty((len(polygons), count - 2, 3, *rest), polygons.dtype)
    fans[:, :, 0] = polygons[:, :1]
    fans[:, :, 1] = polygons[:, 1:-1]
    fans[:, :, 2] = polygons[:, 2:]
    return fans.reshape(-1, 3, *rest)


def _mixed_fans(counts: Array) -> Array:
    """Return (F, 3) the corner numbers of the fans of polygons. counts: (P,) corners of each."""
    triangles = counts - 2
    polygon = np.repeat(np.arange(len(counts)), triangles)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    start = (np.cumsum(counts) - counts)[polygon]
    return np.stack([start, start + step + 1, start + step + 2], axis=1)


def _by_count(counts: Array) -> Iterator[Array]:
    """Return an iterator over the ascending indices of the polygons with the same number of corners."""
    if (counts == counts[0]).all():
        return iter([np.arange(len(counts))])
    order = np.argsort(counts, kind="stable")
    return iter(np.split(order, np.flatnonzero(np.diff(counts[order])) + 1))


def _blocks(rows: int, width: int) -> Iterator[slice]:
    step = max(1, _BLOCK // width)
    return (slice(start, start + step) for start in range(0, rows, step))


def _turned(columns: Array, corners: Array, counts: Array) -> Array:
    """Return the polygons, ascending, whose fan may invert a triangle. columns: (3, V) float64 positions of unit size.

    A conservative test: the fan of a polygon that is very small, has no area, or almost collinear corners may be right.
    """
    start = np.cumsum(counts) - counts
    found = []
    for group in _by_count(counts):
        count = int(counts[group[0]])
        if count == 3:
            continue
        alike = len(group) == len(counts)
        polygons = corners.reshape(-1, count) if alike else corners[start[group, None] + np.arange(count)]
        for rows in _blocks(len(group), count):
            index = polygons[rows].T.astype(np.intp, order="C")
            parts = _fan_areas(*(column.take(index) for column in columns))[0]
            found.append(group[rows][(parts.min(axis=0) < 0.0) | (parts.sum(axis=0) < _TINY)])
    return np.sort(np.concatenate(found))


def _fan_areas(x: Array, y: Array, z: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """Return the signed parts of the triangles of P fans, and twice the vector areas of their polygons.

    x, y, z: (n, P) coordinates. parts: (n - 2, P) scalar products of each triangle with the vector area of its polygon,
    negative where it is inverted. The vector areas: three (P,).
    """
    x, y, z = x[1:] - x[0], y[1:] - y[0], z[1:] - z[0]
    one = y[:-1] * z[1:] - z[:-1] * y[1:]
    two = z[:-1] * x[1:] - x[:-1] * z[1:]
    three = x[:-1] * y[1:] - y[:-1] * x[1:]
    normal = one.sum(axis=0), two.sum(axis=0), three.sum(axis=0)
    parts = one * normal[0]
    parts += two * normal[1]
    parts += three * normal[2]
    return parts, normal


def _recut(points: Array, cutter: Cutter) -> Array:
    """Return (P, n - 2, 3) triangles of corner numbers for polygons with corners (3, P, n) whose fan may be wrong."""
    points = points.transpose(1, 2, 0)
    points = points - points[:, :1]
    extent = np.abs(points).max(axis=(1, 2), initial=0.0)
    points = np.ldexp(points, -np.frexp(extent)[1][:, None, None])
    parts, sums = _fan_areas(*points.transpose(2, 1, 0))
    normal = np.stack(sums, axis=1)
    count = points.shape[1]
    cuts = _fans(np.tile(np.arange(count), (len(points), 1))).reshape(-1, count - 2, 3)
    length = np.sqrt((normal * normal).sum(axis=1))
    wrong = np.flatnonzero((parts.min(axis=0) < -_ROUNDING * length) & (length > _NO_AREA))
    flat = _in_plane(points[wrong], normal[wrong] / length[wrong, None])
    if count == 4:
        better = np.broadcast_to([[1, 2, 3], [1, 3, 0]], (len(wrong), 2, 3))
    else:
        better = cutter.cut(flat)
    less = _turned_area(flat, better) < _turned_area(flat, cuts[wrong])
    cuts[wrong[less]] = better[less]
    return cuts


def _in_plane(points: Array, normal: Array) -> Array:
    """Project points (P, n, 3) to (P, n, 2) in planes of unit normals (P, 3), counter-clockwise seen against these.

    A normal along an axis leaves the other coordinates as they are, so that collinear corners stay collinear.
    """
    axis = np.abs(normal).argmax(axis=1)[:, None]
    other = np.zeros_like(normal)
    np.put_along_axis(other, (axis + 1) % 3, 1.0, axis=1)
    u = other - (other * normal).sum(axis=1, keepdims=True) * normal
    u /= np.sqrt((u * u).sum(axis=1, keepdims=True))
    v = np.cross(normal, u)
    return np.stack([(points * u[:, None]).sum(axis=2), (points * v[:, None]).sum(axis=2)], axis=2)


def _turned_area(points: Floats, triangles: Array) -> Floats:
    """Return (P,) twice the area of the clockwise ones of the triangles (P, F, 3) of polygons (P, n, 2)."""
    a, b, c = (np.take_along_axis(points, triangles[:, :, [k]], axis=1) for k in range(3))
    b, c = b - a, c - a
    return np.asarray(np.maximum(c[:, :, 0] * b[:, :, 1] - b[:, :, 0] * c[:, :, 1], 0.0).sum(axis=1))


def strips(indices: Array) -> Array:
    """Convert triangle strips to triangles, all with the winding of the first of their strip.

    indices: (N,) integers; -1 ends a strip. Returns (F, 3) of the same type; a strip of less than 3 gives none.
    """
    if len(indices) < 3:
        return np.zeros((0, 3), indices.dtype)
    ends = indices == -1
    place = np.arange(len(indices))
    begin = np.maximum.accumulate(np.where(ends, place + 1, 0))
    first = np.flatnonzero(~(ends[:-2] | ends[1:-1] | ends[2:]))
    odd = (first - begin[first]) & 1
    return np.asarray(indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)])


def single_fan(indices: Array) -> Array:
    """Convert one fan around indices[0] to triangles in glTF's order: (N,) -> (N-2, 3), each i+1, i+2, 0."""
    middle = np.stack([indices[1:-1], indices[2:]], axis=1)
    return np.concatenate([middle, np.broadcast_to(indices[:1], (len(middle),))[:, None]], axis=1)
