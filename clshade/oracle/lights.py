"""What reaches a point of a light that is not a plain point light: by direction, cone and distance.

Points and positions are (..., 3), relative to the eye; results are (...).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import DirectionalLight, Light, SpotLight
from .vectors import dot, length, unit

NARROWEST_EDGE = 1e-3  # of a cone, in cosines (KHR_lights_punctual)
MOST_SHARE = 1e250  # keeps products with intensities finite
NEAREST = 2.0**-50  # of s: nearer points have no direction to a light in float32 (kernels/numerics.clh)


@dataclass(frozen=True, eq=False)
class Shape:
    """How a light differs from a point light without attenuation.

    parallel: whether its position is a unit vector toward it, the same everywhere. axis: (3,) unit, of its cone, away from
    the light; None without. inner, outer: cosines of the cone's angles. attenuates: with the square of the distance, and
    ends at `range`.
    """

    parallel: bool = False
    axis: Floats | None = None
    inner: float = 1.0
    outer: float = 0.0
    attenuates: bool = False
    range: float = math.inf


POINT = Shape()


def shape_of(light: Light) -> Shape:
    if isinstance(light, DirectionalLight):
        return Shape(parallel=True)
    end, attenuates = math.inf if light.range is None else light.range, light.attenuation == "inverse-square"
    if not isinstance(light, SpotLight):
        return Shape(attenuates=attenuates, range=end)
    inner, outer = (math.cos(math.radians(angle)) for angle in (light.inner_cone, light.outer_cone))
    return Shape(False, unit(light.direction), inner, outer, attenuates, end)


def position_of(light: Light, eye: Floats) -> Floats:
    """Return the position relative to the eye; of a directional light the unit vector toward it."""
    return -unit(light.direction) if isinstance(light, DirectionalLight) else light.position - eye


def each(positions: Array, intensities: Array, shapes: Sequence[Shape]) -> Iterator[tuple[Floats, Floats, Shape]]:
    """Yield the lights, rows of positions and intensities (L, 3). shapes: L of them, or none if all are POINT."""
    yield from zip(positions, intensities, shapes or [POINT] * len(positions), strict=True)


def place(point: Floats, position: Floats, shape: Shape) -> Floats:
    """Return where the light is, as seen from the points: a directional one as far away as they are from the origin, for
    1 away from a point at 1e15 would leave no digit of the direction."""
    if not shape.parallel:
        return position
    far: Floats = point + position * np.ldexp(1.0, np.frexp(np.abs(point).max(initial=1e-300))[1])
    return far


def _fading(point: Floats, position: Floats, axis: Floats, shape: Shape) -> Floats:
    """Return the root of the cone's factor, before it is clamped to 0 and 1."""
    cosine = dot(unit(point - position), axis)
    ramp: Floats = (cosine - shape.outer) / max(shape.inner - shape.outer, NARROWEST_EDGE)
    return ramp


def share(point: Floats, position: Floats, shape: Shape) -> Floats:
    """Return what part of the light's intensity arrives: cone times attenuation; 0 at a distance of 0 with the latter."""
    found = np.ones(np.shape(point)[:-1])
    if shape.axis is not None:
        found = found * np.clip(_fading(point, position, shape.axis, shape), 0.0, 1.0) ** 2
    if shape.attenuates:
        away = length(position - point)
        with np.errstate(divide="ignore", over="ignore"):
            window = np.clip(1.0 - np.minimum(away / shape.range, 2.0) ** 4, 0.0, 1.0)
            found = found * np.where(away > 0.0, np.minimum((1.0 / away) ** 2, MOST_SHARE) * window, 0.0)
    return found


def most_share(point: Floats, position: Floats, shape: Shape, size: Floats, gate: float) -> Floats:
    """Return the largest share that the light would have there without cone and range, within rounding: as if the point
    were nearer by `gate` times size (...), the largest coordinate."""
    if not shape.attenuates:
        return np.ones(np.shape(point)[:-1])
    nearest = np.maximum(length(position - point) - gate * size, NEAREST * size)
    with np.errstate(over="ignore", divide="ignore"):
        found: Floats = np.minimum((1.0 / nearest) ** 2, MOST_SHARE)
    return found


def sensitivity(point: Floats, position: Floats, shape: Shape, turned: Floats) -> Floats:
    """Return how much an error of the direction to the light, or a relative one of its distance, changes what arrives:
    1 + the slopes of attenuation and cone, relative to `most_share`. turned: (...) error of the direction by which the
    cone's edge may be missed."""
    found = np.ones(np.shape(point)[:-1])
    if shape.attenuates:
        with np.errstate(over="ignore"):
            within = np.minimum(length(position - point) / shape.range, 1.0)
        found = found + 2.0 + 4.0 * within**4
    if shape.axis is not None:
        width = max(shape.inner - shape.outer, NARROWEST_EDGE)
        fading = _fading(point, position, shape.axis, shape)
        flat = fading - turned / width >= 1.0
        found = found + np.where(flat, 0.0, 2.0 / width * np.clip(fading + turned / width, 0.0, 1.0))
    return found
