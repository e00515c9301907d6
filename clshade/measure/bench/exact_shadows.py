"""Which of two answers to a shadow ray is right: every triangle in turn, in integers of any length.

A triangle T casts a shadow on the point P of a face R if T is not R, has a vertex strictly on the light's side of R's
plane, separates P from the light strictly, and the segment between them meets it, edges included. Where P lies in the
plane of T to within the tolerance, as points near an edge of R do for its neighbor, R's center takes its place, also where
the line then touches an edge of T.

Float64 values are integers over a power of two, so all signs here are exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Faces, Floats

TOLERANCE_BITS = 40  # what float32 pairs decide: signs beyond 2^-40 of the mesh and of the lengths multiplied
_RAYS, _TRIANGLES = 256, 1 << 14  # whose sides are tested at a time

Point = tuple[int, int, int]
Triangle = tuple[Point, Point, Point]


class Answer(Enum):
    """LIT and DARK are proven; at a TIE a rounding of 2^-TOLERANCE_BITS may decide."""

    LIT = 0
    TIE = 1
    DARK = 2


def answers(points: Floats, owners: Array, light: Floats, verts: Floats, faces: Faces) -> list[Answer]:
    """Return the answer to each shadow ray.

    points: (K, 3), and owners: (K,), the faces that they lie on. light: (3,). verts: (V, 3), faces: (F, 3).
    """
    found = []
    box = np.stack([verts.min(axis=0), verts.max(axis=0)])
    for k, near in enumerate(candidates(points, light, verts, faces)):
        corners = verts[faces[[owners[k], *near[near != owners[k]]]]].reshape(-1, 3)
        point, source, low, high, *rest = _integers(np.stack([points[k], light, *box, *corners]))
        receiver, *others = zip(rest[0::3], rest[1::3], rest[2::3], strict=True)
        ray = _Ray(point, source, receiver, _squared(_minus(high, low)))
        found.append(max((_casts(ray, each) for each in others), key=_value, default=Answer.LIT))
    return found


class _Ray(NamedTuple):
    """A shadow ray in integers. reach: the square of the mesh's size."""

    point: Point
    light: Point
    receiver: Triangle
    reach: int


def _value(answer: Answer) -> int:
    return answer.value


def candidates(points: Floats, light: Floats, verts: Floats, faces: Faces) -> Iterator[Array]:
    """Yield for each point the triangles that the line to the light may meet, in float64.

    The line passes all edges of a triangle on the same side if three determinants have one sign. Each is off by less than
    2^-50 of the lengths multiplied, so that a margin of 2^-36 of the largest keeps all that are within the tolerance.
    """
    corners = verts - light
    reach = np.sqrt((corners * corners).sum(axis=1).max())
    for start in range(0, len(points), _RAYS):
        rays = points[start : start + _RAYS] - light
        margin = 2.0**-36 * reach * reach * np.sqrt((rays * rays).sum(axis=1, keepdims=True))
        found: list[list[Array]] = [[] for _ in rays]
        for first in range(0, len(faces), _TRIANGLES):
            a, b, c = corners[faces[first : first + _TRIANGLES]].swapaxes(0, 1)
            sides = [rays @ np.cross(p, q).T for p, q in ((a, b), (b, c), (c, a))]
            low, high = np.minimum.reduce(sides), np.maximum.reduce(sides)
            for ray, triangle in zip(*np.nonzero((low >= -margin) | (high <= margin)), strict=True):
                found[ray].append(first + triangle)
        yield from (np.array(each, np.int64) for each in found)


def _integers(points: Floats) -> list[Point]:
    """Return points (K, 3) in units of one power of two in which all are integers."""
    ratios = [number.as_integer_ratio() for number in points.reshape(-1).tolist()]
    unit = max(below for _, below in ratios)
    whole = [above * (unit // below) for above, below in ratios]
    return list(zip(whole[0::3], whole[1::3], whole[2::3], strict=True))


def _casts(ray: _Ray, caster: Triangle) -> Answer:
    """Return DARK if the caster is met for certain, LIT if it is missed for certain."""
    side = _side(ray.receiver, ray.light, ray.reach)
    above = max(_sign(side) * _side(ray.receiver, corner, ray.reach) for corner in caster)
    towards = _side(caster, ray.light, ray.reach)
    if above <= 0 or towards == 0:
        return Answer.LIT
    near = abs(_side(caster, ray.point, ray.reach)) < 2
    edges = [_turns(ray, caster[k], caster[k - 2], near) for k in range(3)]
    met = {
        _within(light, edges) if light * point < 0 else Answer.LIT
        for light in ({_sign(towards)} if abs(towards) == 2 else {1, 0, -1})
        for point in _sides_of_point(ray, caster)
    }
    if met == {Answer.LIT}:
        return Answer.LIT
    return Answer.DARK if met == {Answer.DARK} and above == abs(side) == 2 else Answer.TIE


def _sides_of_point(ray: _Ray, caster: Triangle) -> set[int]:
    """Return the signs that may tell on which side of the caster's plane the ray begins."""
    side = _side(caster, ray.point, ray.reach)
    if abs(side) == 2:
        return {_sign(side)}
    center = _sign(sum(_height(caster, corner) for corner in ray.receiver))
    return {center, _sign(side) or center}


def _turns(ray: _Ray, a: Point, b: Point, near: bool) -> set[int]:
    """Return the signs that may tell on which side of an edge the ray passes: where it begins in the triangle's plane and
    touches the edge, the receiver's center decides."""
    turn = _turn(ray, a, b)
    if abs(turn) == 2 or not near:
        return {turn}
    center = 2 * _sign(sum(_volume(corner, a, b, ray.light) for corner in ray.receiver))
    return {center, 2 * _sign(turn) or center}


def _within(light: int, edges: list[set[int]]) -> Answer:
    """Return whether a line is on the inner side of all edges, seen from a light on this side of the triangle."""
    seen = [{light * turn for turn in edge} for edge in edges]
    if {-2} in seen:
        return Answer.LIT
    return Answer.TIE if min(map(min, seen)) < 0 else Answer.DARK


# Signs: 0 if exactly zero, 1 or -1 within the tolerance, 2 or -2 beyond it. A sign from float32 pairs is right if the value
# exceeds that of a shift by 2^-TOLERANCE_BITS of the mesh's size, plus this share of the lengths multiplied.


def _side(plane: Triangle, point: Point, reach: int) -> int:
    """Return on which side of a triangle's plane a point lies."""
    a, b, c = plane
    area = _squared(_minus(b, a)) * _squared(_minus(c, a))
    return _decided(_height(plane, point), area * (_squared(_minus(point, a)) + reach))


def _height(plane: Triangle, point: Point) -> int:
    a, b, c = plane
    return _dot(_cross(_minus(b, a), _minus(c, a)), _minus(point, a))


def _turn(ray: _Ray, a: Point, b: Point) -> int:
    """Return on which side of an edge the ray passes."""
    p, q, along = _minus(a, ray.point), _minus(b, ray.point), _minus(ray.light, ray.point)
    moved = ray.reach * _squared(_minus(a, b))
    return _decided(_volume(ray.point, a, b, ray.light), _squared(along) * (_squared(p) * _squared(q) + moved))


def _volume(point: Point, a: Point, b: Point, light: Point) -> int:
    return _dot(_cross(_minus(a, point), _minus(b, point)), _minus(light, point))


def _decided(value: int, squares: int) -> int:
    """Return the sign of a value, twice where its square exceeds the tolerance's share of twice `squares`."""
    return _sign(value) * (2 if (value * value) << (2 * TOLERANCE_BITS) > 2 * squares else 1)


def _sign(value: int) -> int:
    return (value > 0) - (value < 0)


def _minus(p: Point, q: Point) -> Point:
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


def _dot(p: Point, q: Point) -> int:
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


def _squared(p: Point) -> int:
    return _dot(p, p)


def _cross(p: Point, q: Point) -> Point:
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
