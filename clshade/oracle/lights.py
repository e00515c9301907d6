"""What reaches a point of a light that is not a plain point light: by direction, cone, distance and size.

Points and positions are (..., 3), relative to the eye; results are (...).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Array, Floats, Integers
from ..scene.lights import Light, PlacedLight, PointLight, RectangleLight
from . import light_points
from .vectors import cross, dot, length, unit

NARROWEST_EDGE = 1e-3  # of a cone, in cosines (KHR_lights_punctual)
MOST_SHARE = 1e250  # keeps products with intensities finite
NEAREST = 2.0**-50  # of s: nearer points have no direction to a light in float32 (kernels/numerics.clh)


@dataclass(frozen=True, eq=False)
class Shape:
    """How a light differs from a point light without attenuation.

    parallel: whether its position is a unit vector toward it, the same everywhere. axis: (3,) unit, of its cone, away from
    the light; None without. inner, outer: cosines of the cone's angles. attenuates: with the square of the distance, and
    ends at `range`. points: that stand for a light of finite size, 0 for others. radius: of a sphere. sides: (2, 3) half
    the sides of a rectangle. front: (3,) unit, the normal of the side of a rectangle that shines. shift: (..., 2) of the
    points, see `light_points.shifts`. Of one of these points, offset: (..., 3) from the light's position; blur: (...) how
    far rounding may move it, in units of which one is an error 2^-24.
    """

    parallel: bool = False
    axis: Floats | None = None
    inner: float = 1.0
    outer: float = 0.0
    attenuates: bool = False
    range: float = math.inf
    points: int = 0
    radius: float = 0.0
    sides: Floats | None = None
    front: Floats | None = None
    shift: Integers | int = 0
    blur: Floats | float = 0.0
    offset: Floats | None = None

    @property
    def varies(self) -> bool:
        """Whether what arrives depends on the place: by distance, cone or front."""
        return self.attenuates or self.axis is not None or self.front is not None


POINT = Shape()


def shape_of(light: Light, points: int = 1) -> Shape:
    """Return the shape of a light. points: how many stand for one of finite size."""
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


def each(
    positions: Array, intensities: Array, shapes: Sequence[Shape], point: Floats, size: Array | float = 0.0
) -> Iterator[tuple[Floats, Floats, Shape]]:
    """Yield the lights as they light points (..., 3): rows of positions and intensities (L, 3), and of a light of finite
    size each of its points, (..., 3), with its part of the intensity. shapes: L of them, or none if all are POINT. size:
    (...) the largest coordinate that the points come from."""
    for position, intensity, shape in zip(positions, intensities, shapes or [POINT] * len(positions), strict=True):
        if not shape.points:
            yield position, intensity, shape
            continue
        extent = np.maximum(size, np.abs(position).max())
        one, to_receiver = replace(shape, points=0), point - position
        for uv in light_points.coordinates(shape.points):
            at = (uv + shape.shift) % light_points.WHOLE
            if shape.sides is not None:
                offset, blur = light_points.on_rectangle(at, shape.sides), 2.0 * np.abs(shape.sides).sum(axis=0).max()
            else:
                offset = light_points.on_disc(at, shape.radius, to_receiver)
                blur = shape.radius * light_points.amplified(to_receiver, extent)
            yield position + offset, intensity / shape.points, replace(one, blur=blur, offset=offset)


def rounding_of_sums(shape: Shape) -> float:
    """Return by how much more than a single light one of finite size is rounded: partial sums of N equal parts are rounded
    N/2 times the whole in all, besides the 32 times that are allowed anyway."""
    return 1.0 + shape.points / 64.0


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
    """Return what part of the light's intensity arrives: cone times attenuation, of a rectangle times the cosine to its
    normal; 0 at a distance of 0 with attenuation."""
    found = np.ones(np.shape(point)[:-1])
    if shape.axis is not None:
        found = found * np.clip(_fading(point, position, shape.axis, shape), 0.0, 1.0) ** 2
    if shape.attenuates:
        away = length(position - point)
        with np.errstate(divide="ignore", over="ignore"):
            window = np.clip(1.0 - np.minimum(away / shape.range, 2.0) ** 4, 0.0, 1.0)
            found = found * np.where(away > 0.0, np.minimum((1.0 / away) ** 2, MOST_SHARE) * window, 0.0)
    if shape.front is not None:
        found = found * np.clip(dot(unit(point - position), shape.front), 0.0, 1.0)
    return found


def most_share(point: Floats, position: Floats, shape: Shape, size: Floats, gate: float) -> Floats:
    """Return the largest share that the light would have there without cone, range and a rectangle's cosine, within
    rounding: as if the point were nearer by `gate` times size (...), the largest coordinate."""
    if not shape.attenuates:
        return np.ones(np.shape(point)[:-1])
    nearest = np.maximum(length(position - point) - gate * size, NEAREST * size)
    with np.errstate(over="ignore", divide="ignore"):
        found: Floats = np.minimum((1.0 / nearest) ** 2, MOST_SHARE)
    return found


def sensitivity(point: Floats, position: Floats, shape: Shape, turned: Floats) -> Floats:
    """Return how much an error of the direction to the light, or a relative one of its distance, changes what arrives:
    1 + the slopes of attenuation, cone and a rectangle's cosine, relative to `most_share`. turned: (...) error of the
    direction by which the cone's edge may be missed."""
    found = np.ones(np.shape(point)[:-1])
    if shape.attenuates:
        with np.errstate(over="ignore"):
            within = np.minimum(length(position - point) / shape.range, 1.0)
        found = found + 2.0 + 4.0 * within**4
    if shape.front is not None:
        found = found + 1.0
    if shape.axis is not None:
        width = max(shape.inner - shape.outer, NARROWEST_EDGE)
        fading = _fading(point, position, shape.axis, shape)
        flat = fading - turned / width >= 1.0
        found = found + np.where(flat, 0.0, 2.0 / width * np.clip(fading + turned / width, 0.0, 1.0))
    return found
