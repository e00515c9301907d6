"""Which lights reach a point: every triangle of the scene is tried, in float64.

A point P of a face R is dark if a triangle T other than R lies between it and the light L: T has a vertex on the light's
side of R's plane, P and L lie on opposite sides of T's plane, and the line through both meets T. A P in T's plane lies on
the side of R's centroid. The signs are exact but for those within the reach of the device's rounding, where either answer
is right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.camera import Camera
from ..scene.lights import Light, PlacedLight
from .corners import Corners
from .lights import position_of
from .signs import orientation
from .transform import SAMPLE_STEPS, camera_frame
from .vectors import cross, dot, length, power_of_two, unit

# How far pairs of float32 may be off (kernels/shadow_predicate.clh): a coordinate, of the scene's size; and a determinant,
# of the product of its vectors' lengths. A coordinate counts in 2^-46 of half the size, and 9 of these along each axis
# decide whether a receiver lies in a plane: 8 * 2^-46 along its normal. A determinant that counts as 0 is at most
# 22 * 2^-48, and as much off, of the sum of its terms' magnitudes, which are at most 1.7 times that product.
OFF, REACH = 2.0**-42, 2.0**-41
INWARD = 3.0 * 2.0**-12  # how far toward the centroid, of the whole distance, Gouraud's shading sees a corner
PAIRS = 1 << 20  # of points and triangles, tried at a time

Factors = Callable[[Integers, Floats, Floats], "Passed"]


@dataclass(frozen=True, eq=False)
class Casters:
    """The triangles of a scene. Lengths are relative to `origin`, over `scale`, a power of two.

    world: (F, 3, 3) corners in world space. corners: (F, 3, 3) the same relative to the origin. veiling: (F,) those that
    may let light pass. solid, veils: indices of the others and of these, if they are finite and of an area above 0.
    """

    world: Floats
    origin: Floats
    scale: float
    veiling: Bools

    @classmethod
    def of(cls, corners: Corners, veiling: Bools | None = None) -> Casters:
        veiling = np.zeros(len(corners.world), bool) if veiling is None else veiling
        finite = corners.world[np.isfinite(corners.world).all(axis=(1, 2))].reshape(-1, 3)
        if not len(finite):
            return cls(corners.world, np.zeros(3), 1.0, veiling)
        low, high = finite.min(axis=0), finite.max(axis=0)
        origin = low + 0.5 * (high - low)
        return cls(corners.world, origin, float(power_of_two(np.maximum(high - low, 1e-290))), veiling)

    @cached_property
    def corners(self) -> Floats:
        relative: Floats = (self.world - self.origin) / self.scale
        return relative

    @cached_property
    def normals(self) -> Floats:
        """(F, 3), twice the area long, on the side from which the corners run counter-clockwise."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        with np.errstate(invalid="ignore"):
            return cross(b - a, c - a)

    @cached_property
    def casting(self) -> Bools:
        finite: Bools = np.isfinite(self.normals).all(axis=1) & (self.normals != 0.0).any(axis=1)
        return finite

    @cached_property
    def solid(self) -> Integers:
        return np.flatnonzero(self.casting & ~self.veiling)

    @cached_property
    def veils(self) -> Integers:
        return np.flatnonzero(self.casting & self.veiling)

    def sides_of(self, plane: Integers, triangle: Integers, corner: int) -> Integers:
        """Return on which sides of the planes of triangles (K,) a corner of others (K,) lies, exactly: signs (K,)."""
        pairs, where = np.unique(plane * len(self.world) + triangle, return_inverse=True)
        first, other = np.divmod(pairs, max(len(self.world), 1))
        a, b, c = np.moveaxis(self.world[first], 1, 0)
        signs: Integers = orientation(a, b, c, self.world[other, corner])[where]
        return signs

    def toward(self, light: Light) -> tuple[Floats, bool]:
        """Return where a light is, and whether that is a direction toward it."""
        position = position_of(light, self.origin)
        return (position / self.scale, False) if isinstance(light, PlacedLight) else (position, True)


@dataclass(frozen=True, eq=False)
class Receivers:
    """Points (K, 3) of faces (K,), relative to the casters' origin. off: (K,) how far from there the device may see them."""

    point: Floats
    face: Integers
    off: Floats

    def __getitem__(self, index: slice | Integers) -> Receivers:
        return Receivers(self.point[index], self.face[index], self.off[index])


def at_pixels(casters: Casters, camera: Camera, face: Integers, x: Integers, y: Integers) -> Receivers:
    """Return where the rays through points (x, y) of the image (K,), 1/256 px, y up, meet the planes of faces (K,), clamped
    to the faces.

    Along the plane a point is as uncertain as the ray, over the cosine between it and the normal, over the sine of the angle
    between the face's sides.
    """
    axes = camera_frame(camera.eye, camera.lookat, camera.up)
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    right = (x / (SAMPLE_STEPS * columns) - principal[0]) * width
    up = (y / (SAMPLE_STEPS * rows) - principal[1]) * height
    across = right[:, None] * axes[0] + up[:, None] * axes[1]
    start = np.broadcast_to((camera.eye - casters.origin) / casters.scale, across.shape)
    if camera.orthographic:
        start, along = start + across / casters.scale, np.broadcast_to(axes[2], across.shape)
    else:
        along = unit(across + camera.focal * axes[2])
    a, b, c = np.moveaxis(casters.corners[face], 1, 0)
    sides, normal = (b - a, c - a), casters.normals[face]
    from_first = start - a
    moment = cross(from_first, along)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        facing = -dot(normal, along)
        second = dot(sides[1], moment) / facing
        third = -dot(sides[0], moment) / facing
        spread = length(sides[0]) * length(sides[1]) / np.abs(facing)
    off = 2.0 * OFF * (length(start) + length(from_first) + 1.0) * spread
    second, third = (np.clip(np.nan_to_num(share), 0.0, 1.0) for share in (second, third))
    beyond = np.maximum(second + third, 1.0)
    point = a + (second / beyond)[:, None] * sides[0] + (third / beyond)[:, None] * sides[1]
    whole = np.maximum(length(sides[0]), length(sides[1]))
    return Receivers(point, face, np.fmin(off, whole) + OFF)


def at_corners(casters: Casters, face: Integers) -> Receivers:
    """Return the corners of faces (U,) one after the other, (3 U,), each seen a little inside its own face: what hides a
    face near its corner hides the corner, and faces that only touch it there do not."""
    corners = casters.corners[face]
    inside = corners + INWARD * (corners.mean(axis=1, keepdims=True) - corners)
    return Receivers(inside.reshape(-1, 3), np.repeat(face, 3), np.full(3 * len(face), OFF))


def shadowed(
    casters: Casters, light: Light, at: Receivers, offset: Floats | None = None, off: Floats | float = 0.0
) -> tuple[Bools, Bools]:
    """Return which receivers (K,) a light does not reach, and for which either answer is right. offset: (K, 3) of the
    light's points that light them, in world space from its position; off: (K,) how far the device may see these."""
    return met(casters, *_light_points(casters, light, at, offset, off), at)


def met(casters: Casters, positions: Floats, light_off: Floats, parallel: bool, at: Receivers) -> tuple[Bools, Bools]:
    """Return which receivers (K,) are hidden from positions, or directions, (K, 3) that may be off by light_off (K,),
    and for which either answer is right."""
    dark, doubtful = np.zeros(len(at.face), bool), np.zeros(len(at.face), bool)
    step = max(1, PAIRS // max(len(casters.solid), 1))
    for start in range(0, len(at.face), step):
        some = slice(start, start + step)
        dark[some], doubtful[some] = _shadowed(casters, positions[some], light_off[some], parallel, at[some])
    return dark, doubtful & ~dark


def _light_points(
    casters: Casters, light: Light, at: Receivers, offset: Floats | None, off: Floats | float
) -> tuple[Floats, Floats, bool]:
    """Return where the points of a light lie that light receivers (K,), (K, 3), and how far they may be off, (K,); and
    whether these are directions. offset, off: as of `shadowed`."""
    position, parallel = casters.toward(light)
    moved = position if offset is None else position + offset / casters.scale
    positions = np.broadcast_to(moved, at.point.shape)
    light_off = (0.0 if parallel else OFF * length(positions)) + off / casters.scale * np.ones(len(at.face))
    return positions, light_off, parallel


def _shadowed(
    casters: Casters, position: Floats, light_off: Floats, parallel: bool, at: Receivers
) -> tuple[Bools, Bools]:
    """Return the same of positions (K, 3), or directions, of lights that may be off by light_off (K,)."""
    k, triangle = _candidates(casters, position, light_off, parallel, at, casters.solid)
    found = _Tests(casters, position[k], light_off[k], parallel, at[k], triangle)
    hit, open_ = found.hits()
    dark, doubtful = np.zeros(len(at.face), bool), np.zeros(len(at.face), bool)
    dark[k[hit]] = True
    dark[found.between_two(k)] = True
    doubtful[k[open_]] = True
    return dark, doubtful


def _candidates(
    casters: Casters, position: Floats, light_off: Floats, parallel: bool, at: Receivers, tried: Integers
) -> tuple[Integers, Integers]:
    """Return pairs of receivers and triangles that the lines to the light may meet: where the volumes of line and sides, by
    Plücker's coordinates, have the same sign within their rounding.

    slack is more than the margins of `_Tests.volumes` over the line's length d, e being the receiver's `off`, l the
    light's: no two points of the casters' box are more than m = sqrt(3) apart, so these are at most REACH m^2
    + e m (1 + m/d) + 2 OFF m + l m^2/d; of a direction, d = 1 and OFF is l.
    """
    a, b, c = np.moveaxis(casters.corners[tried], 1, 0)
    distance = position if parallel else position - at.point
    away = np.ones(len(at.face)) if parallel else length(distance)
    along = unit(distance)
    line = np.concatenate([along, cross(at.point, along)], axis=1)
    with np.errstate(divide="ignore"):
        slack = 32.0 * (REACH + 8.0 * ((at.off + OFF) * (1.0 + 1.0 / away) + light_off / away))[:, None]
    positive, negative = np.ones((2, len(at.face), len(tried)), bool)
    for first, second in ((a, b), (b, c), (c, a)):
        side = np.concatenate([cross(first, second), second - first], axis=1)
        volume = line @ side.T
        positive &= volume >= -slack
        negative &= volume <= slack
    k, column = np.nonzero((positive | negative) & (tried[None] != at.face[:, None]))
    return k, tried[column]


class _Tests:
    """The tests of receivers (K,) with triangles (K,), all relative to the receivers."""

    def __init__(
        self, casters: Casters, position: Floats, light_off: Floats, parallel: bool, at: Receivers, triangle: Integers
    ) -> None:
        self.casters, self.at, self.triangle, self.parallel = casters, at, triangle, parallel
        self.corners = casters.corners[triangle] - at.point[:, None]
        self.light = position if parallel else position - at.point
        self.own = casters.corners[at.face] - at.point[:, None]
        self.light_off = light_off

    def hits(self) -> tuple[Bools, Bools]:
        """Return which triangles are hit for certain, and which may be."""
        above, between = self._above(), self._between()
        self.facing = above[0] & between[0]
        volume, margin = self.volumes
        inside = (volume > margin).all(axis=0) | (volume < -margin).all(axis=0)
        possible = (volume >= -margin).all(axis=0) | (volume <= margin).all(axis=0)
        yes = self.facing & inside
        return yes, above[1] & between[1] & possible & ~yes

    def between_two(self, receiver: Integers) -> Integers:
        """Return the receivers, of those of each pair, whose lines meet the common side of two triangles on either side of
        it: whatever its rounding, one of the two is hit, for sides belong to their triangles, but for receivers in their
        planes."""
        volume, margin = self.volumes
        near = np.abs(volume) <= margin
        beside = [
            (volume > margin)[[k - 2, k - 1]].all(axis=0) | (volume < -margin)[[k - 2, k - 1]].all(axis=0)
            for k in range(3)
        ]
        ends: dict[tuple[float, ...], float] = {}
        found = []
        for k in range(3):
            for i in np.flatnonzero(self.facing & self.clear & near[k] & beside[k]):
                first, second = sorted(self.casters.world[self.triangle[i], [k, k - 2]].tolist())
                a, b, c = self.corners[i, k], self.corners[i, k - 2], self.corners[i, k - 1]
                side = float(np.sign(dot(cross(a, b), c)))
                side *= 1.0 if self.casters.world[self.triangle[i], k].tolist() == first else -1.0
                key = (float(receiver[i]), *first, *second)
                if ends.setdefault(key, side) == -side:
                    found.append(receiver[i])
        return np.array(found, np.int64)

    def _height_of_light(self, normal: Floats, first: Floats, sides: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Return the light's height over planes, times their normals' lengths, and how far it may be off."""
        most = length(sides[0]) * length(sides[1])
        if self.parallel:
            # Corners off by OFF turn the product of the sides by 2 OFF times their lengths, a direction off by OFF adds OFF
            # times `most`: 8 OFF is four times the one and more than the other.
            return dot(normal, self.light), (REACH + 8.0 * OFF) * (most + length(sides[0]) + length(sides[1]))
        away = self.light - first
        off = REACH * most * length(away) + (self.light_off + 2.0 * self.at.off) * most
        return dot(normal, away), off + 2.0 * OFF * (length(sides[0]) + length(sides[1])) * length(away)

    def _above(self) -> tuple[Bools, Bools]:
        """Whether triangles have a vertex strictly on the light's side of the receivers' faces."""
        a, b, c = np.moveaxis(self.own, 1, 0)
        sides, normal = (b - a, c - a), self.casters.normals[self.at.face]
        height, off = self._height_of_light(normal, a, sides)
        side = np.sign(height)
        certain, possible = np.zeros(len(self.triangle), bool), np.abs(height) <= off
        most, around = length(sides[0]) * length(sides[1]), length(sides[0]) + length(sides[1])
        for corner in range(3):
            from_first = self.corners[:, corner] - a
            margin = REACH * most * length(from_first) + 2.0 * OFF * (most + around * length(from_first))
            rise = dot(normal, from_first) * side
            certain |= rise > margin
            near = np.flatnonzero(np.abs(rise) <= margin)
            exact = self.casters.sides_of(self.at.face[near], self.triangle[near], corner)
            possible[near] |= exact * side[near] > 0.0
            possible |= rise > margin
        return certain & (np.abs(height) > off), possible

    def _between(self) -> tuple[Bools, Bools]:
        """Whether receivers and light lie on opposite sides of the triangles' planes."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        sides, normal = (b - a, c - a), self.casters.normals[self.triangle]
        most, around = length(sides[0]) * length(sides[1]), length(sides[0]) + length(sides[1])
        light, light_off = self._height_of_light(normal, a, sides)
        own = -dot(normal, a)
        own_off = REACH * most * length(a) + (self.at.off + OFF) * (most + around * length(a))
        middle = self.own.mean(axis=1) - a
        of_middle = dot(normal, middle)
        middle_off = REACH * most * length(middle) + 2.0 * OFF * (most + around * length(middle))
        self.clear = clear = np.abs(own) > own_off
        seen = np.abs(light) > light_off
        beyond = seen & (np.abs(of_middle) > middle_off)
        across, middle_across = own * light < 0.0, of_middle * light < 0.0
        yes = seen & across & (clear | (beyond & middle_across))
        no = seen & ~across & (clear | (beyond & ~middle_across))
        return yes, ~no

    @cached_property
    def volumes(self) -> tuple[Floats, Floats]:
        """The volumes of the lines to the light with each triangle's sides, (3, K), and how far they may be off: of one sign
        where the line meets the triangle."""
        volumes, margins = [], []
        far = length(self.light)
        for k in range(3):
            a, b = self.corners[:, k], self.corners[:, (k + 1) % 3]
            product = cross(a, b)
            turned = cross(self.light, b - a) if self.parallel else cross(a - self.light, b - self.light)
            volumes.append(dot(self.light, product))
            margins.append(
                REACH * far * length(a) * length(b)
                + self.at.off * length(turned)
                + OFF * far * (length(a) + length(b))
                + (OFF if self.parallel else self.light_off) * length(product)
            )
        return np.array(volumes), np.array(margins)


class Passed(NamedTuple):
    """What share of lights veils let pass, (...), and the least and the largest within rounding. jumps: bool, where rounding
    decides whether a veil is crossed, or its alpha test passed."""

    share: Floats
    least: Floats
    most: Floats
    jumps: Bools


def passed(
    casters: Casters,
    light: Light,
    at: Receivers,
    factors: Factors,
    offset: Floats | None = None,
    off: Floats | float = 0.0,
) -> Passed:
    """Return what share of a light reaches receivers (K,) through the veils: the product of 1 - alpha over those that the
    segments cross, where they cross them. factors: of faces at weights of their corners, which are so far off. offset, off:
    as of `shadowed`."""
    return passed_through(casters, *_light_points(casters, light, at, offset, off), at, factors)


def passed_through(
    casters: Casters, positions: Floats, light_off: Floats, parallel: bool, at: Receivers, factors: Factors
) -> Passed:
    """Return the same of positions, or directions, as of `met`."""
    share, least, most = np.ones((3, len(at.face)))
    found = Passed(share, least, most, np.zeros(len(at.face), bool))
    step = max(1, PAIRS // max(len(casters.veils), 1))
    for start in range(0, len(at.face) if len(casters.veils) else 0, step):
        some = slice(start, start + step)
        position, position_off, seen = positions[some], light_off[some], at[some]
        k, triangle = _candidates(casters, position, position_off, parallel, seen, casters.veils)
        tests = _Tests(casters, position[k], position_off[k], parallel, seen[k], triangle)
        hit, open_ = tests.hits()
        volume, margin = tests.volumes
        whole = volume.sum(axis=0)
        met = hit | (open_ & (volume * np.sign(whole) >= 0.0).all(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.nan_to_num(np.roll(volume, -1, axis=0) / whole).T
            weights_off = np.nan_to_num(margin.sum(axis=0) / np.abs(whole), posinf=1.0)
        crossed = np.flatnonzero(hit | open_)
        of = factors(triangle[crossed], np.clip(weights[crossed], 0.0, 1.0), np.minimum(weights_off[crossed], 1.0))
        sure, here = hit[crossed], start + k[crossed]
        np.multiply.at(found.share, here, np.where(met[crossed], of.share, 1.0))
        np.multiply.at(found.least, here, of.least)
        np.multiply.at(found.most, here, np.where(sure, of.most, 1.0))
        np.logical_or.at(found.jumps, here, of.jumps | ~sure)
    return found


@dataclass(frozen=True, eq=False)
class Visibility:
    """What of lights reaches receivers `at`, (K,), of which there are (...). facing: (..., 3) unit normals of their faces'
    sides that are seen, 0 without area. off: (...) how far these may be off on the device. factors: as of `passed`."""

    casters: Casters
    lights: Sequence[Light]
    at: Receivers
    facing: Floats
    off: Floats
    factors: Factors

    def reached(self, number: int, offset: Floats | None = None, off: Floats | float = 0.0) -> tuple[Bools, Bools]:
        """Return where a light reaches the receivers, and where either answer is right, (...). offset: (..., 3), off: (...)
        as of `shadowed`."""
        dark, unsure = shadowed(self.casters, self.lights[number], self.at, *self._flat(offset, off))
        return ~dark.reshape(self.off.shape), unsure.reshape(self.off.shape)

    def passed(self, number: int, offset: Floats | None = None, off: Floats | float = 0.0) -> Passed:
        """Return what share of a light veils let pass to the receivers, (...). offset, off: as of `reached`."""
        found = passed(self.casters, self.lights[number], self.at, self.factors, *self._flat(offset, off))
        share, least, most = (each.reshape(self.off.shape) for each in found[:3])
        return Passed(share, least, most, found.jumps.reshape(self.off.shape))

    def _flat(self, offset: Floats | None, off: Floats | float) -> tuple[Floats | None, Floats]:
        shape = self.off.shape
        offsets = None if offset is None else np.broadcast_to(offset, (*shape, 3)).reshape(-1, 3)
        return offsets, np.broadcast_to(off, shape).reshape(-1)


def visibility(
    casters: Casters, lights: Sequence[Light], at: Receivers, behind: Bools, shape: tuple[int, ...], factors: Factors
) -> Visibility:
    """Return what reaches receivers (K,), of which there are `shape`. behind: (K,) whether their faces are seen from
    behind. factors: as of `passed`."""
    a, b, c = np.moveaxis(casters.corners[at.face], 1, 0)
    normal = casters.normals[at.face]
    sides = length(b - a), length(c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = (REACH * sides[0] * sides[1] + OFF * (sides[0] + sides[1])) / length(normal)
    off = np.nan_to_num(off, nan=0.0, posinf=1.0)
    facing = np.where(behind[:, None], -unit(normal), unit(normal))
    return Visibility(casters, lights, at, facing.reshape(*shape, 3), off.reshape(shape), factors)


# The terminator


@dataclass(frozen=True, eq=False)
class Normals:
    """Unit normals at points (..., 3): turned by a map, interpolated, and of the face's side that is seen. bend: (...) sine
    of the angle between the interpolated one and those of faces around."""

    turned: Floats
    smooth: Floats
    facing: Floats
    bend: Floats


MOST_BEND = 0.5  # of `bend`, which is relative to the length of the interpolated normal


def softened(normals: Normals, to_light: Floats, reach: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what share of a light arrives at surfaces whose normals are not those of their faces, (...), and the least and
    the largest within rounding. to_light: unit, (..., 3). reach: (...) how far cosines may be off.

    M. J.-Y. Chiang, Y. K. Li, B. Burley, "Taming the Shadow Terminator", SIGGRAPH Talks 2019: g + g^2 - g^3 with g =
    (Ng.L)/(|Ng.N| (N.L)), at most 1. Here g is the least of three: of the face's side that is seen, Ng, and the interpolated
    normal N, so that it falls to 0 where the light sinks below the face; of N and the normal that a map turned it to; and of
    N and the faces around, whose Ng.L is at least N.L - bend, so that it changes without steps from face to face. It is 1
    where all of them are the same.
    """
    facing, normal = normals.facing, normals.smooth
    flat = (facing != 0.0).any(axis=-1)
    above, along, cosine = dot(facing, to_light), np.abs(dot(facing, normal)), dot(normal, to_light)
    turned, turned_along = dot(normals.turned, to_light), np.abs(dot(normals.turned, normal))
    mapped = (normals.turned != normal).any(axis=-1)

    def rising(part: Floats, whole: Floats) -> Floats:
        share = np.where(part < whole, part / np.where(whole > 0.0, whole, 1.0), 1.0)
        return np.where(part > 0.0, share, 0.0)

    def share(off: Floats | float) -> Floats:
        """Return the share with all cosines off by this much, in the same sense."""
        lower, bend = np.maximum(cosine - off, 0.0), np.clip(normals.bend - off, 0.0, MOST_BEND)
        g = np.where(flat, rising(above + off, np.maximum(along - off, 0.0) * lower), 1.0)
        g = np.minimum(g, rising(cosine + off - bend, np.maximum(cosine + off, 0.0) * (1.0 - bend)))
        of_map = rising(cosine + off, np.maximum(turned_along - off, 0.0) * np.maximum(turned - off, 0.0))
        g = np.where(mapped, np.minimum(g, of_map), g)
        smooth: Floats = g + g * g - g * g * g
        return smooth

    return share(0.0), share(-reach), share(reach)
