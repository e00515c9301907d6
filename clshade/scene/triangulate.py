"""Triangulation of polygons, strips and fans of vertex indices.

Concave polygons are cut by ear clipping in their planes (mapbox-earcut), completed such that every corner and every edge
is used. Ear clipping drops corners that are collinear or coincide, even if other triangles use them. Their neighbors would
not meet there, and a crack could open. And it gives up where a polygon intersects itself. The missing region has a
boundary, the edges that no triangle uses; it is closed by fans, and triangles without area among these are flipped.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from .geometry import _exponent, row_blocks

CUT_AS_FANS = "concave polygons of very many corners (cut as fans)"  # description of Cuts.left
_BLOCK = 1 << 14  # corners, or pairs of edges, whose temporary arrays stay in the cache
_TINY = 2.0**-800  # squared normal, in a mesh of size 1: not far from underflow
_NO_AREA = 2.0**-40  # of a polygon of size 1: a smaller area is rounding error
_ROUNDING = 2.0**-46  # rounding error of a triangle's part in the squared normal of a polygon of size 1
_ALWAYS = 64  # corners of a polygon that is cut at any cost
_UNCHECKED = 1 << 11  # corners of a polygon that is cut even if it intersects itself
_MAX_CORNERS = 1 << 16  # of a polygon that is cut at all
_PAIRS = 1 << 25  # of edges, tested for intersections of a large polygon with itself: a second or two
# Cost of a polygon as a multiple of the square of its corners, a third of a nanosecond each: usually, and with edges
# that intersect many times. Cost of testing a pair of edges.
_CLEAN, _TANGLED, _PAIR = 1, 512, 128
_WORK = 1 << 34  # total cost of all polygons of more than _ALWAYS corners: several seconds
_FLAT = 2.0**-44  # times the square of the longest edge: a triangle with less area is degenerate
_SAME_AREA = 2.0**-40  # times the square of a polygon's size: triangles that differ less in area from it fill it


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
        if (self.counts == 3).all():
            return values.reshape(-1, 3, *values.shape[1:])
        triangles, polygon = self.counts - 2, self.polygon
        step = np.arange(len(polygon)) - (np.cumsum(triangles) - triangles)[polygon]
        start = (np.cumsum(self.counts) - self.counts)[polygon]
        corners: Array = values[np.stack([start, start + step + 1, start + step + 2], axis=1)]
        corners[self.other] = values[self.places]
        return corners


def triangulated(verts: Array, corners: Array, counts: Array) -> Cuts:
    """Cut polygons into triangles with the same winding; each polygon of n corners gives n - 2.

    corners: (C,) indices into verts (V, 3), one polygon after the other. counts: (P,) corners of each, at least 3.

    A polygon becomes a fan around its first corner unless a triangle of the fan would be inverted as seen along the
    polygon's own normal (Newell's); convex polygons, collinear corners and zero-area polygons are therefore fans. A
    quadrilateral is then cut along its other diagonal, any other polygon by ear clipping in the plane of its normal,
    provided that this inverts less area than the fan (a self-intersecting polygon may have no cut without).
    Positions of any magnitude, and polygons far smaller than their mesh, are cut alike.
    """
    cut_corners, places, cutter = [np.zeros(0, np.intp)], [np.zeros((0, 3), np.intp)], Cutter()
    larger = np.flatnonzero(counts > 3)
    if len(larger):
        # By coordinate, times the power of two (exact) that brings the largest to 1.
        columns = np.ldexp(np.array(verts.T, np.float64, order="C"), -_exponent(verts))
        blocks = _blocks(counts, larger)
        turned = np.sort(np.concatenate([some[_may_turn(columns, corners[at])] for some, at in blocks]))
        first = np.cumsum(counts - 2) - (counts - 2)
        for some, at in _blocks(counts, turned):
            cuts = _recut(columns[:, corners[at]], cutter)
            cut_corners.append((first[some, None] + np.arange(cuts.shape[1])).reshape(-1))
            places.append(np.take_along_axis(at[:, None], cuts, axis=2).reshape(-1, 3))
    return Cuts(counts, np.concatenate(cut_corners), np.concatenate(places), cutter.left)


def _blocks(counts: Array, polygons: Array) -> Iterator[tuple[Array, Array]]:
    """Yield some of the polygons (K,), with equal numbers of corners n, and the places of their corners (K, n)."""
    start, order = np.cumsum(counts) - counts, polygons[np.argsort(counts[polygons], kind="stable")]
    for group in np.split(order, np.flatnonzero(np.diff(counts[order])) + 1):
        count = int(counts[group[0]]) if len(group) else 1
        for rows in row_blocks(len(group), max(1, _BLOCK // count)):
            yield group[rows], start[group[rows], None] + np.arange(count)


def _may_turn(columns: Floats, polygons: Array) -> Bools:
    """Return whether the fans of polygons (P, n) may invert a triangle; those of tiny, flat or nearly collinear ones may
    be right even so; (P,). columns: (3, V) positions of unit size."""
    index = polygons.T.astype(np.intp, order="C")
    parts = _fan_areas(*(column.take(index) for column in columns))[0]
    return np.asarray((parts.min(axis=0) < 0.0) | (parts.sum(axis=0) < _TINY))


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
    normal, cuts = np.stack(sums, axis=1), _fans(len(points), points.shape[1])
    length = np.sqrt((normal * normal).sum(axis=1))
    wrong = np.flatnonzero((parts.min(axis=0) < -_ROUNDING * length) & (length > _NO_AREA))
    flat = _in_plane(points[wrong], normal[wrong] / length[wrong, None])
    if points.shape[1] == 4:
        better = np.broadcast_to([[1, 2, 3], [1, 3, 0]], (len(wrong), 2, 3))
    else:
        better = cutter.cut(flat)
    new, old = (np.maximum(-_areas(_corners(flat, triangles)), 0.0).sum(axis=1) for triangles in (better, cuts[wrong]))
    cuts[wrong[new < old]] = better[new < old]
    return cuts


def _in_plane(points: Array, normal: Array) -> Array:
    """Project points (P, n, 3) to (P, n, 2) in planes of unit normals (P, 3), counter-clockwise seen against these.

    A normal along an axis leaves the other coordinates as they are, so that collinear corners stay collinear.
    """
    axis = np.abs(normal).argmax(axis=1)[:, None]
    second = np.zeros_like(normal)
    np.put_along_axis(second, (axis + 1) % 3, 1.0, axis=1)
    u = second - (second * normal).sum(axis=1, keepdims=True) * normal
    u /= np.sqrt((u * u).sum(axis=1, keepdims=True))
    v = np.cross(normal, u)
    return np.stack([(points * u[:, None]).sum(axis=2), (points * v[:, None]).sum(axis=2)], axis=2)


def _fans(polygons: int, count: int) -> Array:
    """Return (polygons, count - 2, 3) corner numbers of fans around the first corners."""
    step = np.arange(1, count - 1)
    return np.tile(np.stack([np.zeros_like(step), step, step + 1], axis=1), (polygons, 1, 1))


def _corners(points: Floats, triangles: Array) -> Floats:
    """Return the corners (P, F, 3, 2) of triangles (P, F, 3) of polygons (P, n, 2)."""
    return np.asarray(points[np.arange(len(points))[:, None, None], triangles])


def _areas(corners: Floats) -> Floats:
    """Return twice the areas (...) of triangles (..., 3, 2), negative for clockwise ones."""
    return np.asarray(_side(*np.moveaxis(corners, (-2, -1), (0, 1))))


def _side(a: Any, b: Any, c: Any) -> Any:
    """Return a positive number if c is to the left of the line from a to b; exactly 0 if it equals one of these. Each
    point: its x and y."""
    x, y = a
    u, v, s, t = b[0] - x, b[1] - y, c[0] - x, c[1] - y
    return u * t - v * s


class Cutter:
    """Ear clipping for the polygons of a file. left: how many were not cut, because that could take too long.

    The time of ear clipping is quadratic in the corners; some hundred times more where edges intersect. Which polygons
    are left depends on the polygons alone, so that a file always gives the same triangles.
    """

    def __init__(self) -> None:
        self.left = 0
        self._work = 0

    def cut(self, polygons: Floats) -> Array:
        """Return (P, n - 2, 3) triangles of corner numbers of counter-clockwise polygons (P, n, 2) of size 1.

        Fewer triangles are padded to n - 2 by degenerate ones. Those of a self-intersecting polygon may overlap.
        A polygon that is not cut is a fan.
        """
        from mapbox_earcut import triangulate_float64

        polygons = np.ascontiguousarray(polygons)
        count = polygons.shape[1]
        cuts, is_final = _fans(len(polygons), count), np.zeros(len(polygons), bool)
        for number, points in enumerate(polygons):
            if not self._affordable(points):
                self.left += 1
                is_final[number] = True
                continue
            triangles = triangulate_float64(points, np.array([count], np.uint32)).reshape(-1, 3).astype(np.intp)
            if count > _ALWAYS:
                filled, area = (_areas(points[corners]).sum() for corners in (triangles, cuts[number]))
                self._work += count * count * (_CLEAN if abs(filled - area) <= _SAME_AREA else _TANGLED)
            is_final[number] = len(triangles) != count - 2
            cuts[number] = _completed(points, triangles) if is_final[number] else triangles
        flat = _flat(_corners(polygons, cuts)).any(axis=1)
        for number in np.flatnonzero(flat & ~is_final).tolist():
            cuts[number] = _completed(polygons[number], cuts[number])
        return cuts

    def _affordable(self, points: Floats) -> bool:
        count = len(points)
        if count <= _ALWAYS:
            return True
        if count > _MAX_CORNERS or self._work + count * count > _WORK:
            return False
        if count <= _UNCHECKED:
            return True
        crosses, pairs = _crosses(points)
        self._work += pairs * _PAIR
        return not crosses


def _flat(corners: Floats) -> Bools:
    """Return (...) whether triangles (..., 3, 2) are degenerate."""
    edges = corners - np.roll(corners, 1, axis=-2)
    longest = (edges * edges).sum(axis=-1).max(axis=-1, initial=0.0)
    return np.asarray(np.abs(_areas(corners)) <= _FLAT * longest)


def _completed(points: Floats, triangles: Integers) -> Array:
    """Return (n - 2, 3): the triangles, and those that are missing."""
    count = len(points)
    cycles = [np.array(cycle) for cycle in _cycles(_unused(count, triangles.tolist())) if len(cycle) > 2]
    triangles = np.concatenate([triangles, *(cycle[_fans(1, len(cycle))[0]] for cycle in cycles)])
    if len(triangles) > count - 2:  # they overlap, and their boundary does not show the missing region
        return np.asarray(_fans(1, count)[0])
    triangles = _flipped(points, triangles)
    # Cycles that touch themselves in a corner need fewer triangles; degenerate ones keep the count.
    return np.concatenate([triangles, np.zeros((count - 2 - len(triangles), 3), np.intp)])


def _unused(count: int, triangles: list[list[int]]) -> Counter[tuple[int, int]]:
    """Return the directed edges that are missing for the triangles to fill the polygon.

    Then every edge of a triangle is one of the polygon or is shared with a triangle in the opposite direction, and
    every edge of the polygon is used.
    """
    needed = Counter((k, (k + 1) % count) for k in range(count))
    for triangle in triangles:
        for start, end in _edges(*triangle):
            if needed[start, end] > 0:
                needed[start, end] -= 1
            else:
                needed[end, start] += 1
    return +needed


def _edges(a: int, b: int, c: int) -> tuple[tuple[int, int], ...]:
    return (a, b), (b, c), (c, a)


def _cycles(edges: Counter[tuple[int, int]]) -> list[list[int]]:
    """Split directed edges, of which as many start as end in every corner, into cycles that visit no corner twice."""
    follow: dict[int, list[int]] = {}
    for start, end in sorted(edges.elements(), reverse=True):
        follow.setdefault(start, []).append(end)
    cycles = []
    for first in sorted(follow):
        path, place = [first], {first: 0}
        while follow[path[-1]] or len(path) > 1:
            corner = follow[path[-1]].pop()
            if corner not in place:
                place[corner] = len(path)
                path.append(corner)
                continue
            cycles.append(path[place[corner] :])
            for gone in path[place[corner] + 1 :]:
                del place[gone]
            del path[place[corner] + 1 :]
    return cycles


def _flipped(points: Floats, triangles: Integers) -> Array:
    """Flip the longest edges of degenerate triangles whose neighbor there is not degenerate: a corner in the middle of an
    edge then splits that neighbor."""
    place: list[list[float]] = points.tolist()
    faces: list[tuple[int, int, int]] = [(a, b, c) for a, b, c in triangles.tolist()]
    flat = _flat(points[triangles]).tolist()
    owner = {edge: k for k, triangle in enumerate(faces) for edge in _edges(*triangle)}

    def squared_length(p: int, q: int) -> float:
        x, y = place[q][0] - place[p][0], place[q][1] - place[p][1]
        return x * x + y * y

    waiting = [k for k, is_flat in enumerate(flat) if is_flat]
    while waiting:
        number = waiting.pop()
        a, b, c = faces[number]
        # The longest edge from `start` to `end`, and the corner that lies on it.
        _, start, end, middle = max((squared_length(p, q), p, q, r) for p, q, r in ((a, b, c), (b, c, a), (c, a, b)))
        beyond = owner.get((end, start), number)
        if not flat[number] or beyond == number or flat[beyond]:
            continue
        far = sum(faces[beyond]) - start - end
        one, two = (start, far, middle), (far, end, middle)
        if any(_side(*(place[corner] for corner in triangle)) <= 0.0 for triangle in (one, two)):
            continue
        for edge in (*_edges(*faces[number]), *_edges(*faces[beyond])):
            owner.pop(edge, None)
        for k, triangle in ((number, one), (beyond, two)):
            faces[k], flat[k] = triangle, False
            owner.update(dict.fromkeys(_edges(*triangle), k))
        for k in (number, beyond):
            waiting += [n for p, q in _edges(*faces[k]) if (n := owner.get((q, p), k)) != k and flat[n]]
    return np.array(faces, np.intp)


def _crosses(points: Floats) -> tuple[bool, int]:
    """Return whether two edges of a polygon (n, 2) intersect in a point inside of both, and how many pairs were tested.

    Also True if the bounds of more than _PAIRS pairs overlap along both axes, which would take too long to test.
    """
    ends = np.roll(points, -1, axis=0)
    low, high = np.minimum(points, ends), np.maximum(points, ends)
    orders = [np.argsort(low[:, axis], kind="stable") for axis in range(2)]
    beyond = [np.searchsorted(low[order, k], high[order, k], side="right") for k, order in enumerate(orders)]
    axis = int(np.argmin([int(last.sum()) for last in beyond]))
    order, pairs = orders[axis], beyond[axis] - np.arange(1, len(points) + 1)
    total = int(pairs.sum())
    if total > _PAIRS:
        return True, 0
    places = np.ascontiguousarray(np.stack([points[order], ends[order]]).transpose(0, 2, 1))
    cuts = np.searchsorted(np.cumsum(pairs), np.arange(0, total + 1, 4 * _BLOCK))
    for first, last in zip(cuts, [*cuts[1:], len(points)], strict=True):
        some = pairs[first:last]
        one = np.repeat(np.arange(first, last), some)
        two = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(some) - some, some)
        a, b, c, d = (end[:, edge] for edge in (one, two) for end in places)
        apart = _side(a, b, c) * _side(a, b, d) < 0.0
        if apart.any() and (apart & (_side(c, d, a) * _side(c, d, b) < 0.0)).any():
            return True, total
    return False, total


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
