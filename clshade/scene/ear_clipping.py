"""Ear clipping of plane polygons (mapbox-earcut), completed such that every corner and every edge is used.

Ear clipping drops corners that are collinear or coincide, even if other triangles use them. Their neighbors would not
meet there, and a crack could open. And it gives up where a polygon intersects itself. The missing region has a
boundary, the edges that no triangle uses; it is closed by fans, and triangles without area among these are flipped.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers

_ALWAYS = 64  # corners of a polygon that is cut at any cost
_UNCHECKED = 1 << 11  # corners of a polygon that is cut even if it intersects itself
_MOST = 1 << 16  # corners of a polygon that is cut at all
_PAIRS = 1 << 25  # of edges, tested for intersections of a large polygon with itself: a second or two
# Cost of a polygon as a multiple of the square of its corners, a third of a nanosecond each: usually, and with edges
# that intersect many times. Cost of testing a pair of edges.
_CLEAN, _TANGLED, _PAIR = 1, 512, 128
_WORK = 1 << 34  # total cost of all polygons of more than _ALWAYS corners: several seconds
_BLOCK = 1 << 16  # pairs of edges whose temporary arrays stay in the cache
_FLAT = 2.0**-44  # times the square of the longest edge: a triangle with less area is degenerate
_SAME_AREA = 2.0**-40  # times the square of a polygon's size: triangles that differ less in area from it fill it


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
        rings = np.array([count], np.uint32)
        cuts = np.tile(_fan(range(count)), (len(polygons), 1, 1))
        whole = np.zeros(len(polygons), bool)
        for number, points in enumerate(polygons):
            if not self._affordable(points):
                self.left += 1
                whole[number] = True
                continue
            found = triangulate_float64(points, rings).reshape(-1, 3).astype(np.intp)
            if count > _ALWAYS:
                filled, area = (_doubled_areas(points, each).sum() for each in (found, _fan(range(count))))
                self._work += count * count * (_CLEAN if abs(filled - area) <= _SAME_AREA else _TANGLED)
            if len(found) == count - 2:
                cuts[number] = found
            else:
                cuts[number] = _whole(points, found)
                whole[number] = True
        first = count * np.arange(len(polygons))[:, None, None]
        flat = _flat(polygons.reshape(-1, 2), (cuts + first).reshape(-1, 3)).reshape(-1, count - 2)
        for number in np.flatnonzero(flat.any(axis=1) & ~whole).tolist():
            cuts[number] = _whole(polygons[number], cuts[number])
        return cuts

    def _affordable(self, points: Floats) -> bool:
        count = len(points)
        if count <= _ALWAYS:
            return True
        if count > _MOST or self._work + count * count > _WORK:
            return False
        if count <= _UNCHECKED:
            return True
        crosses, pairs = _crosses(points)
        self._work += pairs * _PAIR
        return not crosses


def _fan(corners: range | list[int]) -> Array:
    rest = np.asarray(corners, np.intp)
    return np.stack([np.full(len(rest) - 2, rest[0]), rest[1:-1], rest[2:]], axis=1)


def _doubled_areas(points: Floats, triangles: Integers) -> Floats:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    b, c = b - a, c - a
    return b[:, 0] * c[:, 1] - c[:, 0] * b[:, 1]


def _flat(points: Floats, triangles: Integers) -> Bools:
    """Return (F,) whether each triangle is degenerate."""
    edges = points[triangles] - points[np.roll(triangles, 1, axis=1)]
    longest = (edges * edges).sum(axis=2).max(axis=1, initial=0.0)
    return np.asarray(np.abs(_doubled_areas(points, triangles)) <= _FLAT * longest)


def _whole(points: Floats, triangles: Integers) -> Array:
    """Return (n - 2, 3): the triangles, and those that are missing."""
    count = len(points)
    missing = [_fan(cycle) for cycle in _cycles(_unused(count, triangles.tolist())) if len(cycle) > 2]
    found = np.concatenate([triangles, *missing])
    if len(found) > count - 2:  # they overlap such that their boundary does not show what is missing
        return _fan(range(count))
    found = _Flips(points, found).triangles()
    # Cycles that touch themselves in a corner need fewer triangles; degenerate ones keep the count.
    return np.concatenate([found, np.zeros((count - 2 - len(found), 3), np.intp)])


def _unused(count: int, triangles: list[list[int]]) -> Counter[tuple[int, int]]:
    """Return the directed edges that are missing for the triangles to fill the polygon.

    Then every edge of a triangle is one of the polygon or is shared with a triangle in the opposite direction, and
    every edge of the polygon is used.
    """
    needed = Counter((k, (k + 1) % count) for k in range(count))
    for a, b, c in triangles:
        for start, end in ((a, b), (b, c), (c, a)):
            if needed[start, end] > 0:
                needed[start, end] -= 1
            else:
                needed[end, start] += 1
    return +needed


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


class _Flips:
    """Flips of the longest edges of degenerate triangles whose neighbor there is not degenerate.

    A corner in the middle of an edge then splits that neighbor.
    """

    def __init__(self, points: Floats, triangles: Integers) -> None:
        self.points: list[list[float]] = points.tolist()
        self.found: list[tuple[int, int, int]] = [(a, b, c) for a, b, c in triangles.tolist()]
        self.flat = _flat(points, triangles).tolist()
        self.owner = {edge: k for k, triangle in enumerate(self.found) for edge in _edges(*triangle)}

    def triangles(self) -> Array:
        waiting = [k for k, flat in enumerate(self.flat) if flat]
        while waiting:
            for k in self._flipped(waiting.pop()):
                waiting += [
                    n for a, b in _edges(*self.found[k]) if (n := self.owner.get((b, a), k)) != k and self.flat[n]
                ]
        return np.array(self.found, np.intp)

    def _flipped(self, number: int) -> tuple[int, ...]:
        """Flip an edge of the triangle if possible, and return the two triangles that changed."""
        if not self.flat[number]:
            return ()
        a, b, c = self.found[number]
        # The longest edge from `start` to `end`, and the corner that lies on it.
        _, start, end, middle = max((self._distance(p, q), p, q, r) for p, q, r in ((a, b, c), (b, c, a), (c, a, b)))
        beyond = self.owner.get((end, start), number)
        if beyond == number or self.flat[beyond]:
            return ()
        far = sum(self.found[beyond]) - start - end
        one, two = (start, far, middle), (far, end, middle)
        if self._area(*one) <= 0.0 or self._area(*two) <= 0.0:
            return ()
        for edge in (*_edges(*self.found[number]), *_edges(*self.found[beyond])):
            self.owner.pop(edge, None)
        for k, triangle in ((number, one), (beyond, two)):
            self.found[k], self.flat[k] = triangle, False
            self.owner.update(dict.fromkeys(_edges(*triangle), k))
        return number, beyond

    def _distance(self, p: int, q: int) -> float:
        (x, y), (s, t) = self.points[p], self.points[q]
        return (s - x) * (s - x) + (t - y) * (t - y)

    def _area(self, p: int, q: int, r: int) -> float:
        (x, y), (s, t), (u, v) = self.points[p], self.points[q], self.points[r]
        return (s - x) * (v - y) - (u - x) * (t - y)


def _edges(a: int, b: int, c: int) -> tuple[tuple[int, int], ...]:
    return (a, b), (b, c), (c, a)


def _crosses(points: Floats) -> tuple[bool, int]:
    """Return whether two edges of a polygon (n, 2) intersect in a point inside of both, and how many pairs were tested.

    Also True if the bounds of more than _PAIRS pairs overlap along both axes, which would take too long to test.
    """
    ends = np.roll(points, -1, axis=0)
    low, high = np.minimum(points, ends), np.maximum(points, ends)
    orders = [np.argsort(low[:, axis], kind="stable") for axis in range(2)]
    beyond = [np.searchsorted(low[order, k], high[order, k], side="right") for k, order in enumerate(orders)]
    axis = int(np.argmin([int(found.sum()) for found in beyond]))
    order, pairs = orders[axis], beyond[axis] - np.arange(1, len(points) + 1)
    total = int(pairs.sum())
    if total > _PAIRS:
        return True, 0
    x, y, u, v = (np.ascontiguousarray(column) for column in (*points[order].T, *ends[order].T))
    cuts = np.searchsorted(np.cumsum(pairs), np.arange(0, total + 1, _BLOCK))
    for first, last in zip(cuts, [*cuts[1:], len(points)], strict=True):
        steps = np.arange(int(pairs[first:last].sum())) - np.repeat(
            np.cumsum(pairs[first:last]) - pairs[first:last], pairs[first:last]
        )
        one = np.repeat(np.arange(first, last), pairs[first:last])
        two = one + 1 + steps
        a, b, c, d = ((p[k], q[k]) for k in (one, two) for p, q in ((x, y), (u, v)))
        apart = _side(a, b, c) * _side(a, b, d) < 0.0
        if apart.any() and (apart & (_side(c, d, a) * _side(c, d, b) < 0.0)).any():
            return True, total
    return False, total


def _side(a: tuple[Floats, Floats], b: tuple[Floats, Floats], c: tuple[Floats, Floats]) -> Floats:
    """Return a positive number if c is to the left of the line from a to b; exactly 0 if it equals one of these."""
    x, y = a
    u, v, s, t = b[0] - x, b[1] - y, c[0] - x, c[1] - y
    return u * t - v * s
