"""Which rays meet triangles: every triangle of the scene is tried, in float64.

A point P of a face R is dark if a triangle T other than R lies between it and the light L: T has a vertex on the light's
side of R's plane, P and L lie on opposite sides of T's plane, and the line through both meets T. A P in T's plane lies on
the side of R's centroid. The signs are exact but for those within the reach of the device's rounding, where either answer
is right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.camera import Camera
from ..scene.lights import Light, PlacedLight
from .corners import Corners
from .lights import position_of
from .transform import SAMPLE_STEPS, camera_frame, cross, dot, length, orientation, power_of_two, unit
from .transparency import Transmittance, face_transmittance

# How far pairs of float32 may be off (kernels/shadow_predicate.clh): a coordinate, of the scene's size; and a determinant,
# of the product of its vectors' lengths. A coordinate counts in 2^-46 of half the size, and 9 of these along each axis
# decide whether a receiver lies in a plane: 8 * 2^-46 along its normal. A determinant that counts as 0 is at most
# 22 * 2^-48, and as much off, of the sum of its terms' magnitudes, which are at most 1.7 times that product.
OFF, REACH = 2.0**-42, 2.0**-41
INWARD = 3.0 * 2.0**-12  # how far toward the centroid, of the whole distance, Gouraud's shading sees a corner
PAIRS = 1 << 20  # of points and triangles, tried at a time


@dataclass(frozen=True, eq=False)
class Casters:
    """The triangles of a scene."""

    faces: Corners
    origin: Floats  # to which lengths are relative
    scale: float  # which they are divided by, a power of two
    may_transmit: Bools  # (F,) those that may let light pass

    @classmethod
    def of(cls, faces: Corners, may_transmit: Bools | None = None) -> Casters:
        may_transmit = np.zeros(len(faces.world), bool) if may_transmit is None else may_transmit
        finite = faces.world[np.isfinite(faces.world).all(axis=(1, 2))].reshape(-1, 3)
        if not len(finite):
            return cls(faces, np.zeros(3), 1.0, may_transmit)
        low, high = finite.min(axis=0), finite.max(axis=0)
        origin = low + 0.5 * (high - low)
        return cls(faces, origin, float(power_of_two(np.maximum(high - low, 1e-290))), may_transmit)

    @cached_property
    def corners(self) -> Floats:
        """(F, 3, 3)."""
        return np.asarray((self.faces.world - self.origin) / self.scale)

    @cached_property
    def normals(self) -> Floats:
        """(F, 3), twice the area long, on the side from which the corners run counter-clockwise."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        with np.errstate(invalid="ignore"):
            return cross(b - a, c - a)

    @cached_property
    def casting(self) -> Bools:
        """(F,) those that are finite and of an area above 0."""
        return np.asarray(np.isfinite(self.normals).all(axis=1) & (self.normals != 0.0).any(axis=1))

    @cached_property
    def opaque(self) -> Integers:
        return np.flatnonzero(self.casting & ~self.may_transmit)

    @cached_property
    def transparent(self) -> Integers:
        return np.flatnonzero(self.casting & self.may_transmit)

    def sides_of(self, plane: Integers, triangle: Integers, corner: int) -> Integers:
        """Return on which sides of the planes of triangles (K,) a corner of others (K,) lies, exactly: signs (K,)."""
        world = self.faces.world
        pairs, where = np.unique(plane * len(world) + triangle, return_inverse=True)
        first, other = np.divmod(pairs, max(len(world), 1))
        a, b, c = np.moveaxis(world[first], 1, 0)
        return np.asarray(orientation(a, b, c, world[other, corner])[where])


@dataclass(frozen=True, eq=False)
class Receivers:
    """Points of faces, relative to the casters' origin."""

    casters: Casters
    point: Floats  # (K, 3)
    face: Integers  # (K,)
    off: Floats  # (K,) how far from there the device may see them
    behind: Bools | bool = False  # (K,) where the face is seen from behind

    def __getitem__(self, index: slice | Integers) -> Receivers:
        return Receivers(self.casters, self.point[index], self.face[index], self.off[index])

    @cached_property
    def facing(self) -> tuple[Floats, Floats]:
        """The unit normals of the visible sides of their faces, (K, 3), 0 without area, and how far these may be off on the
        device, (K,)."""
        a, b, c = np.moveaxis(self.casters.corners[self.face], 1, 0)
        normal, one, other = self.casters.normals[self.face], length(b - a), length(c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            off = (REACH * one * other + OFF * (one + other)) / length(normal)
        turned = np.broadcast_to(self.behind, off.shape)[:, None]
        return np.where(turned, -unit(normal), unit(normal)), np.nan_to_num(off, nan=0.0, posinf=1.0)


def at_pixels(casters: Casters, camera: Camera, face: Integers, x: Integers, y: Integers) -> Receivers:
    """Return where the rays through points (x, y) of the image (K,), 1/256 px, y up, meet the planes of faces (K,), clamped
    to the faces.

    Along the plane a point is as uncertain as the ray, over the cosine between it and the normal, over the sine of the
    angle between the face's sides.
    """
    axes = camera_frame(camera)
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
    sides, lengths, from_first = (b - a, c - a), (length(b - a), length(c - a)), start - a
    moment = cross(from_first, along)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        facing = -dot(casters.normals[face], along)
        second, third = dot(sides[1], moment) / facing, -dot(sides[0], moment) / facing
        spread = lengths[0] * lengths[1] / np.abs(facing)
    off = 2.0 * OFF * (length(start) + length(from_first) + 1.0) * spread
    second, third = (np.clip(np.nan_to_num(share), 0.0, 1.0) for share in (second, third))
    beyond = np.maximum(second + third, 1.0)
    point = a + (second / beyond)[:, None] * sides[0] + (third / beyond)[:, None] * sides[1]
    return Receivers(casters, point, face, np.fmin(off, np.maximum(*lengths)) + OFF)


def at_corners(casters: Casters, face: Integers) -> Receivers:
    """Return the corners of faces (U,) one after the other, (3 U,), moved a little into their faces: occluders near a
    corner hide it, and faces that only touch it do not."""
    corners = casters.corners[face]
    inside = corners + INWARD * (corners.mean(axis=1, keepdims=True) - corners)
    return Receivers(casters, inside.reshape(-1, 3), np.repeat(face, 3), np.full(3 * len(face), OFF))


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays from receivers."""

    at: Receivers
    end: Floats  # (K, 3), or direction if they are `parallel`
    off: Floats  # (K,) how far the ends may be off
    parallel: bool = False

    @classmethod
    def to(cls, light: Light, at: Receivers, offset: Floats | None = None, off: Floats | float = 0.0) -> Rays:
        """Return the rays to a light. offset: (K, 3) of points from its position, in world space; off: (K,) how far the
        device may see these."""
        casters, parallel = at.casters, not isinstance(light, PlacedLight)
        position = position_of(light, casters.origin) / (1.0 if parallel else casters.scale)
        moved = position if offset is None else position + offset / casters.scale
        end = np.broadcast_to(moved, at.point.shape)
        rounding = 0.0 if parallel else OFF * length(end)
        return cls(at, end, rounding + off / casters.scale * np.ones(len(at.face)), parallel)

    def __getitem__(self, index: slice | Integers) -> Rays:
        return replace(self, at=self.at[index], end=self.end[index], off=self.off[index])

    def tests(self, tried: Integers) -> Iterator[tuple[Integers, Tests]]:
        """Yield the numbers (K,) of rays, and their tests with triangles that they may meet, in batches."""
        step = max(1, PAIRS // max(len(tried), 1))
        for start in range(0, len(self.off) if len(tried) else 0, step):
            batch = self[start : start + step]
            k, triangle = candidates(batch, tried)
            yield start + k, Tests(batch[k], triangle)


def met(rays: Rays) -> tuple[Bools, Bools]:
    """Return which rays (K,) meet an opaque triangle, and for which either answer is right."""
    dark, unsure = np.zeros((2, len(rays.off)), bool)
    for ray, tests in rays.tests(rays.at.casters.opaque):
        hit, possible = tests.hits()
        dark[ray[hit]] = True
        dark[tests.between_two(ray)] = True
        unsure[ray[possible]] = True
    return dark, unsure & ~dark


def candidates(rays: Rays, tried: Integers) -> tuple[Integers, Integers]:
    """Return pairs of rays and triangles that may meet: where the volumes of ray and sides, by Plücker's coordinates, have
    the same sign within their rounding.

    slack is more than the margins of `Tests.volumes` over the ray's length d, e being the receiver's `off`, l the
    light's: no two points of the casters' box are more than m = sqrt(3) apart, so these are at most REACH m^2
    + e m (1 + m/d) + 2 OFF m + l m^2/d; of a direction, d = 1 and OFF is l.
    """
    a, b, c = np.moveaxis(rays.at.casters.corners[tried], 1, 0)
    distance = rays.end if rays.parallel else rays.end - rays.at.point
    away = np.ones(len(rays.off)) if rays.parallel else length(distance)
    along = unit(distance)
    line = np.concatenate([along, cross(rays.at.point, along)], axis=1)
    with np.errstate(divide="ignore"):
        slack = 32.0 * (REACH + 8.0 * ((rays.at.off + OFF) * (1.0 + 1.0 / away) + rays.off / away))[:, None]
    positive, negative = np.ones((2, len(rays.off), len(tried)), bool)
    for first, second in ((a, b), (b, c), (c, a)):
        side = np.concatenate([cross(first, second), second - first], axis=1)
        volume = line @ side.T
        positive &= volume >= -slack
        negative &= volume <= slack
    k, column = np.nonzero((positive | negative) & (tried[None] != rays.at.face[:, None]))
    return k, tried[column]


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Triangles (K, 3, 3), relative to receivers, with normals (K, 3), and the magnitudes of the errors of their planes."""

    corners: Floats
    normals: Floats

    @cached_property
    def sides(self) -> tuple[Floats, Floats]:
        """Lengths of the sides from the first corner, (K,)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return length(b - a), length(c - a)

    def height(self, point: Floats) -> Floats:
        """Return the heights of points (K, 3) over the planes, times their normals' lengths, (K,)."""
        return dot(self.normals, point - self.corners[:, 0])

    def margin(self, point: Floats, off: Floats | float) -> Floats:
        """Return how far heights may be off, (K,), of points (K, 3) that are off by as much besides OFF."""
        one, other = self.sides
        away = length(point - self.corners[:, 0])
        return np.asarray(REACH * (one * other) * away + off * (one * other + (one + other) * away))


class Tests:
    """The tests of rays (K,) with triangles (K,), all relative to the receivers."""

    def __init__(self, rays: Rays, triangle: Integers) -> None:
        casters, point = rays.at.casters, rays.at.point
        self.rays, self.triangle = rays, triangle
        self.tried = _Triangles(casters.corners[triangle] - point[:, None], casters.normals[triangle])
        self.receiver = _Triangles(casters.corners[rays.at.face] - point[:, None], casters.normals[rays.at.face])
        self.light = rays.end if rays.parallel else rays.end - point

    def hits(self) -> tuple[Bools, Bools]:
        """Return which triangles are hit for certain, and which may be."""
        above, between = self._above(), self._between()
        self.facing = above[0] & between[0]
        volume, margin = self.volumes
        inside = (volume > margin).all(axis=0) | (volume < -margin).all(axis=0)
        possible = (volume >= -margin).all(axis=0) | (volume <= margin).all(axis=0)
        certain = self.facing & inside
        return certain, above[1] & between[1] & possible & ~certain

    def between_two(self, receiver: Integers) -> Integers:
        """Return the receivers, out of those of all pairs, whose rays meet the common side of two triangles on either side
        of it: whatever its rounding, one of the two is hit, for sides belong to their triangles, but for receivers in their
        planes."""
        volume, margin = self.volumes
        ends: dict[tuple[float, ...], float] = {}
        hit = []
        for k in range(3):
            others = [k - 2, k - 1]
            beside = (volume > margin)[others].all(axis=0) | (volume < -margin)[others].all(axis=0)
            for i in np.flatnonzero(self.facing & self.clear & (np.abs(volume[k]) <= margin[k]) & beside):
                world = self.rays.at.casters.faces.world[self.triangle[i]]
                first, second = sorted(world[[k, k - 2]].tolist())
                a, b, c = self.tried.corners[i, [k, k - 2, k - 1]]
                side = float(np.sign(dot(cross(a, b), c))) * (1.0 if world[k].tolist() == first else -1.0)
                key = (float(receiver[i]), *first, *second)
                if ends.setdefault(key, side) == -side:
                    hit.append(receiver[i])
        return np.array(hit, np.int64)

    def _height_of_light(self, over: _Triangles) -> tuple[Floats, Floats]:
        """Return the light's height over planes, times their normals' lengths, and how far it may be off."""
        one, other = over.sides
        if self.rays.parallel:
            # Corners off by OFF turn the product of the sides by 2 OFF times their lengths, a direction off by OFF adds OFF
            # times their product: 8 OFF is four times the one and more than the other.
            return dot(over.normals, self.light), (REACH + 8.0 * OFF) * (one * other + one + other)
        away = length(self.light - over.corners[:, 0])
        off = REACH * (one * other) * away + (self.rays.off + 2.0 * self.rays.at.off) * (one * other)
        return over.height(self.light), off + 2.0 * OFF * (one + other) * away

    def _above(self) -> tuple[Bools, Bools]:
        """Whether triangles have a vertex strictly on the light's side of the receivers' faces."""
        height, off = self._height_of_light(self.receiver)
        side = np.sign(height)
        certain, possible = np.zeros(len(self.triangle), bool), np.abs(height) <= off
        for corner in range(3):
            vertex = self.tried.corners[:, corner]
            rise, margin = self.receiver.height(vertex) * side, self.receiver.margin(vertex, 2.0 * OFF)
            certain |= rise > margin
            near = np.flatnonzero(np.abs(rise) <= margin)
            exact = self.rays.at.casters.sides_of(self.rays.at.face[near], self.triangle[near], corner)
            possible[near] |= exact * side[near] > 0.0
        return certain & (np.abs(height) > off), possible | certain

    def _between(self) -> tuple[Bools, Bools]:
        """Whether receivers and light lie on opposite sides of the triangles' planes."""
        light, light_off = self._height_of_light(self.tried)
        origin, middle = np.zeros(3), self.receiver.corners.mean(axis=1)
        height, of_middle = self.tried.height(origin), self.tried.height(middle)
        self.clear = clear = np.abs(height) > self.tried.margin(origin, self.rays.at.off + OFF)
        seen = np.abs(light) > light_off
        beyond = seen & (np.abs(of_middle) > self.tried.margin(middle, 2.0 * OFF))
        across, middle_across = height * light < 0.0, of_middle * light < 0.0
        certain = seen & across & (clear | (beyond & middle_across))
        return certain, ~(seen & ~across & (clear | (beyond & ~middle_across)))

    @cached_property
    def volumes(self) -> tuple[Floats, Floats]:
        """The volumes of the rays with each triangle's sides, (3, K), and how far they may be off: of one sign where the
        ray meets the triangle."""
        volumes, margins = [], []
        far, parallel = length(self.light), self.rays.parallel
        for k in range(3):
            a, b = self.tried.corners[:, k], self.tried.corners[:, (k + 1) % 3]
            product = cross(a, b)
            turned = cross(self.light, b - a) if parallel else cross(a - self.light, b - self.light)
            volumes.append(dot(self.light, product))
            margins.append(
                REACH * far * length(a) * length(b)
                + self.rays.at.off * length(turned)
                + OFF * far * (length(a) + length(b))
                + (OFF if parallel else self.rays.off) * length(product)
            )
        return np.array(volumes), np.array(margins)


def transmittance(rays: Rays) -> Transmittance:
    """Return the share of light that passes along rays (K,): the product of 1 - alpha over the transparent triangles that
    they cross, where they cross them."""
    count = len(rays.off)
    total = Transmittance(np.ones(count), np.ones(count), np.ones(count), np.zeros(count, bool))
    for ray, tests in rays.tests(rays.at.casters.transparent):
        hit, possible = tests.hits()
        volume, margin = tests.volumes
        sums = volume.sum(axis=0)
        crosses = hit | (possible & (volume * np.sign(sums) >= 0.0).all(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.clip(np.nan_to_num(np.roll(volume, -1, axis=0) / sums).T, 0.0, 1.0)
            weights_off = np.minimum(np.nan_to_num(margin.sum(axis=0) / np.abs(sums), posinf=1.0), 1.0)
        met = np.flatnonzero(hit | possible)
        of_face = face_transmittance(rays.at.casters.faces, tests.triangle[met], weights[met], weights_off[met])
        certain, here = hit[met], ray[met]
        np.multiply.at(total.share, here, np.where(crosses[met], of_face.share, 1.0))
        np.multiply.at(total.low, here, of_face.low)
        np.multiply.at(total.high, here, np.where(certain, of_face.high, 1.0))
        np.logical_or.at(total.jumps, here, of_face.jumps | ~certain)
    return total
