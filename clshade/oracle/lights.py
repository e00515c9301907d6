"""Lights: the sample points of area lights, and the light that arrives from each at the points that it lights.

Points and positions are (..., 3), relative to the eye; results are (...). Coordinates on a light are integers in units of
2^-32, modulo 2^32, which kernels and oracle have in common; where they lie, as seen from a receiver, is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..base.arrays import Array, Floats, Integers
from ..scene.lights import Light, PlacedLight, PointLight, RectangleLight
from ..scene.model import Scene
from .coverage import GOLDEN_RATIO
from .transform import SAMPLE_STEPS, cross, dot, length, unit

MIN_CONE_EDGE = 1e-3  # of a cone, in cosines (KHR_lights_punctual)
MAX_SHARE = 1e250  # keeps products with intensities finite
NEAREST = 2.0**-50  # of s: nearer points have no direction to a light in float32 (kernels/numerics.clh)
# |N.L| or |R.V| below this times kappa: float32 may decide the highlight's gate otherwise. Both are accurate to 16
# roundings if kappa is 1. If it is larger, the directions that they are products of are off by kappa times as much: an
# error 2^-24 s of P turns L by 2^-24 s/|P-L| and V by 2^-24 s/|P-eye|, one 2^-24 of the mean normal turns N by 2^-24/|N|.
GATE = 1e-6

TURN = 2**32  # the range of coordinates on a light
# The real solution of g^5 = g + 1: its powers 1/g to 1/g^4 are the steps of the R4 sequence (M. Roberts, The unreasonable
# effectiveness of quasirandom sequences, 2018).
GENERALIZED_RATIO = 1.1673039782614187
POLE = -np.array([2.0, 3.0, 5.0]) / np.sqrt(38.0)  # normal of a sphere's disc before it is mirrored


def coordinates(points: int) -> Integers:
    """Return (N, 2) int64: u = (i + 1/2)/N and v = 1/2 + (i - (N - 1)/2)/phi, each step rounded."""
    i, step = np.arange(points), round(TURN / GOLDEN_RATIO)
    u = TURN // (2 * points) + i * (TURN // points)
    v = TURN // 2 - (points - 1) * step // 2 + i * step
    return np.asarray(np.stack([u, v], axis=1) % TURN)


def shifts(place: Integers) -> Integers:
    """Return the shifts of u and v at pixels, (K, 2). place: (K, 2) where they are lit, 1/256 px from the lower left corner
    of the image."""
    pixel, part = np.divmod(np.asarray(place, np.int64), SAMPLE_STEPS)
    step = [2**8 * round(2**24 / GENERALIZED_RATIO**power) for power in (1, 2, 3, 4)]
    u = pixel[:, 0] * step[0] + pixel[:, 1] * step[3] + part[:, 1] * (TURN // SAMPLE_STEPS)
    v = pixel[:, 0] * step[2] + pixel[:, 1] * step[1] + part[:, 0] * (TURN // SAMPLE_STEPS)
    return np.asarray(np.stack([u, v], axis=1) % TURN)


def fractions(coordinate: Integers) -> Floats:
    """Return numbers between 0 and 1: odd multiples of 2^-24."""
    return np.asarray((coordinate // 2**8 // 2 * 2 + 1) / 2.0**24)


def on_disc(uv: Integers, radius: float, to_receiver: Floats) -> Floats:
    """Return points (..., 3) from a sphere's center, on its disc at right angles to vectors to_receiver (..., 3): u is the
    square of the distance over the radius, v the angle, in steps of 2^-26 of a turn.

    The disc lies at right angles to `POLE`, and is mirrored in the plane halfway to to_receiver.
    """
    distance, angle = radius * np.sqrt(fractions(uv[..., 0])), 2.0 * np.pi * (uv[..., 1] // 2**6) / 2.0**26
    first = np.array([3.0, -2.0, 0.0]) / np.sqrt(13.0)
    flat = (distance * np.cos(angle))[..., None] * first + (distance * np.sin(angle))[..., None] * cross(POLE, first)
    halfway = unit(POLE + unit(to_receiver))
    return np.asarray(flat - 2.0 * dot(flat, halfway)[..., None] * halfway)


def amplified(to_receiver: Floats, size: Array) -> Floats:
    """Return how far rounding may move the points of a sphere's disc, (...), over its radius, in units of which one is an
    error 2^-24. size: (...) the largest coordinate that to_receiver is a difference of.

    A direction w to the receiver that is off by d turns the sum of `POLE` and w by d over its length, and mirrored vectors
    by twice that, on either side.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = np.fmax(size / length(to_receiver), 1.0)
        return np.asarray(1.0 + 4.0 * direction / length(POLE + unit(to_receiver)))


class Directions(NamedTuple):
    """Directions at points, unit vectors or 0: the normal, to the light, to the eye."""

    normal: Floats
    to_light: Floats
    to_eye: Floats

    @classmethod
    def at(cls, point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
        return cls(unit(normal), unit(light - point), unit(eye - point))

    @property
    def n_l(self) -> Floats:
        """The cosine N.L, (...)."""
        return dot(self.normal, self.to_light)


@dataclass(frozen=True, eq=False)
class Shape:
    """How a light differs from a point light without attenuation."""

    parallel: bool = False  # whether its position is a constant unit vector toward it
    axis: Floats | None = None  # (3,) unit, of its cone, away from the light
    inner: float = 1.0  # cosines of the cone's angles
    outer: float = 0.0
    attenuates: bool = False  # with the square of the distance
    range: float = math.inf  # at which that ends
    points: int = 0  # sample points of an area light
    radius: float = 0.0  # of a sphere
    sides: Floats | None = None  # (2, 3) half the sides of a rectangle
    front: Floats | None = None  # (3,) unit normal of the side of a rectangle that shines
    shift: Integers | int = 0  # (..., 2) of the points, see `shifts`


POINT = Shape()


def shape_of(light: Light, points: int = 1) -> Shape:
    """Return the shape of a light. points: of an area light."""
    if not isinstance(light, PlacedLight):
        return Shape(parallel=True)
    end, attenuates = math.inf if light.range is None else light.range, light.attenuation == "inverse-square"
    shape = Shape(attenuates=attenuates, range=end)
    if isinstance(light, PointLight):
        return replace(shape, points=points if light.radius else 0, radius=light.radius)
    if isinstance(light, RectangleLight):
        sides, front = np.stack([light.right, light.up]), unit(cross(unit(light.right), unit(light.up)))
        return replace(shape, points=points, sides=sides, front=front)
    inner, outer = (math.cos(math.radians(angle)) for angle in (light.inner_cone, light.outer_cone))
    return replace(shape, axis=unit(light.direction), inner=inner, outer=outer)


def position_of(light: Light, origin: Floats) -> Floats:
    """Return the position relative to an origin; of a directional light the unit vector toward it."""
    return light.position - origin if isinstance(light, PlacedLight) else -unit(light.direction)


@dataclass(frozen=True, eq=False)
class Lights:
    """Rows of positions, see `position_of`, and of intensities, (L, 3), and as many shapes; none if all are POINT."""

    positions: Array
    intensities: Array
    shapes: Sequence[Shape] = ()

    def magnitudes(self) -> Lights:
        return replace(self, intensities=np.abs(self.intensities))


def shining(scene: Scene) -> list[Light]:
    return [light for light in scene.lights if light.intensity.any()]


def scene_lights(scene: Scene, points: int, place: Integers | None = None) -> Lights:
    """Return the lights of non-zero intensity, relative to the eye. points: of an area light. place: (K, 2) of the pixels
    that are lit, 1/256 px; None for corners of faces."""
    lights, shift = shining(scene), 0 if place is None else shifts(place)
    positions = np.array([position_of(light, scene.camera.eye) for light in lights]).reshape(-1, 3)
    shapes = [replace(shape_of(light, points), shift=shift) for light in lights]
    return Lights(positions, np.array([light.intensity for light in lights]).reshape(-1, 3), shapes)


NO_LIGHTS = Lights(np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Interaction:
    """Surface points, the lights and the eye, and what their errors depend on."""

    point: Floats  # (..., 3)
    normal: Floats  # (..., 3) of any length
    eye: Floats
    lights: Lights = NO_LIGHTS
    extent: Array | float = 0.0  # (...) the largest coordinate that a point is interpolated from, relative to the eye
    normal_length: Array | float = 1.0  # (...) before normalizing
    parallel: bool = (
        False  # whether the direction to the eye is constant, hence exact; the origin then serves as the eye
    )

    @property
    def shape(self) -> tuple[int, ...]:
        return np.broadcast_shapes(np.shape(self.point), np.shape(self.normal))[:-1]

    @cached_property
    def has_normal(self) -> Array:
        return np.asarray((np.asarray(self.normal) != 0.0).any(axis=-1))

    @cached_property
    def eye_condition(self) -> Floats:
        """s/|P-eye|, (...): how much rounding of a point turns the direction to the eye."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.zeros(()) if self.parallel else np.asarray(self.extent / length(self.eye - self.point))

    @cached_property
    def normal_condition(self) -> Floats:
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / np.asarray(self.normal_length, np.float64))

    @cached_property
    def kappa(self) -> Floats:
        """The condition number without lights, (...): max(1, s/|P-eye|, 1/|N before normalizing|)."""
        terms = np.broadcast_arrays(self.normal_condition, self.eye_condition, np.zeros(np.shape(self.point)[:-1]))
        return np.asarray(np.fmax.reduce(terms, axis=0, initial=1.0))

    @cached_property
    def samples(self) -> list[LightSample]:
        """The lights, and in place of area lights their sample points with equal parts of the intensity."""
        samples = []
        shapes = self.lights.shapes or [POINT] * len(self.lights.positions)
        rows = zip(self.lights.positions, self.lights.intensities, shapes, strict=True)
        for number, (position, intensity, shape) in enumerate(rows):
            if not shape.points:
                samples.append(LightSample(self, number, position, intensity, shape))
                continue
            to_receiver = self.point - position
            for uv in coordinates(shape.points):
                at = (uv + shape.shift) % TURN
                if shape.sides is not None:
                    along, blur = 2.0 * fractions(at) - 1.0, 2.0 * np.abs(shape.sides).sum(axis=0).max()
                    offset = np.asarray(along[..., :1] * shape.sides[0] + along[..., 1:] * shape.sides[1])
                else:
                    offset = on_disc(at, shape.radius, to_receiver)
                    size = np.maximum(self.extent, np.abs(position).max())
                    blur = shape.radius * amplified(to_receiver, size)
                samples.append(LightSample(self, number, position + offset, intensity, shape, offset, blur))
        return samples


@dataclass(frozen=True, eq=False)
class LightSample:
    """A light, or a sample point of an area light, as it lights the points `at`."""

    at: Interaction
    number: int  # of the light
    position: Floats
    of_light: Floats  # intensity of the light
    shape: Shape
    offset: Floats | None = None  # (..., 3) from the light's position; None without a size
    blur: Floats | float = 0.0  # (...) how far rounding may move it, in units of which one is an error 2^-24

    @property
    def intensity(self) -> Floats:
        return self.of_light / max(self.shape.points, 1)

    @property
    def place(self) -> Floats:
        """Its position as seen from the points: a directional one is as far away as they are from the origin, for 1 away
        from a point at 1e15 would leave no digit of the direction."""
        if not self.shape.parallel:
            return self.position
        point = self.at.point
        return np.asarray(point + self.position * np.ldexp(1.0, np.frexp(np.abs(point).max(initial=1e-300))[1]))

    @property
    def directions(self) -> Directions:
        return Directions.at(self.at.point, self.at.normal, self.at.eye, self.place)

    @property
    def distance(self) -> Floats:
        return length(self.position - self.at.point)

    @property
    def size(self) -> Floats:
        """s, (...): the largest coordinate that the direction comes from."""
        position = self.position if self.at.parallel else self.position - self.at.eye
        return np.asarray(np.maximum(self.at.extent, np.abs(position).max(axis=-1)) + self.blur)

    @property
    def condition(self) -> Floats:
        """The term s/|P-L| of kappa, (...): 0 if the direction is constant."""
        if self.shape.parallel:
            return np.zeros(np.shape(self.at.point)[:-1])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.size / self.distance)

    @property
    def kappa(self) -> Floats:
        """The condition number of the points with this light, (...)."""
        return np.fmax(self.at.kappa, self.condition)

    def _fading(self, axis: Floats) -> Floats:
        """Return the root of the cone's factor, before it is clamped to 0 and 1."""
        cosine = dot(unit(self.at.point - self.position), axis)
        return np.asarray((cosine - self.shape.outer) / max(self.shape.inner - self.shape.outer, MIN_CONE_EDGE))

    @property
    def share(self) -> Floats:
        """The part of the intensity that arrives: cone times attenuation, for a rectangle times the cosine to its normal; 0
        at a distance of 0 with attenuation."""
        share, shape = np.ones(np.shape(self.at.point)[:-1]), self.shape
        if shape.axis is not None:
            share = share * np.clip(self._fading(shape.axis), 0.0, 1.0) ** 2
        if shape.attenuates:
            away = self.distance
            with np.errstate(divide="ignore", over="ignore"):
                window = np.clip(1.0 - np.minimum(away / shape.range, 2.0) ** 4, 0.0, 1.0)
                share = share * np.where(away > 0.0, np.minimum((1.0 / away) ** 2, MAX_SHARE) * window, 0.0)
        if shape.front is not None:
            share = share * np.clip(dot(unit(self.at.point - self.position), shape.front), 0.0, 1.0)
        return share

    @property
    def max_arriving(self) -> Floats:
        """The largest intensity that arrives, (..., 3), without cone, range and a rectangle's cosine, within rounding: as
        if the point were nearer by `GATE` times s."""
        # Partial sums of N equal parts are rounded N/2 times the sum in all, besides the 32 times that are allowed anyway.
        intensity = self.of_light * (1.0 + self.shape.points / 64.0) / max(self.shape.points, 1)
        if not self.shape.attenuates:
            return intensity * np.ones((*np.shape(self.at.point)[:-1], 1))
        nearest = np.maximum(self.distance - GATE * self.size, NEAREST * self.size)
        with np.errstate(over="ignore", divide="ignore"):
            return np.asarray(intensity * np.minimum((1.0 / nearest) ** 2, MAX_SHARE)[..., None])

    def sensitivity(self, turned: Floats) -> Floats:
        """Return how much an error of the direction, or a relative one of the distance, changes the light: 1 + the
        slopes of attenuation, cone and a rectangle's cosine, relative to `max_arriving`. turned: (...) error of the
        direction by which the cone's edge may be missed."""
        slopes, shape = np.ones(np.shape(self.at.point)[:-1]), self.shape
        if shape.attenuates:
            with np.errstate(over="ignore"):
                within = np.minimum(self.distance / shape.range, 1.0)
            slopes = slopes + 2.0 + 4.0 * within**4
        if shape.front is not None:
            slopes = slopes + 1.0
        if shape.axis is not None:
            width, fading = max(shape.inner - shape.outer, MIN_CONE_EDGE), self._fading(shape.axis)
            flat = fading - turned / width >= 1.0
            slopes = slopes + np.where(flat, 0.0, 2.0 / width * np.clip(fading + turned / width, 0.0, 1.0))
        return slopes
