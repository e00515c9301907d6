"""Lights of random scenes that are no plain points: directions, cones and attenuation, also at their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.arrays import Array
from ...scene.lights import WIDEST_CONE, Attenuation, DirectionalLight, PointLight, SpotLight
from ...scene.model import Light
from .random_shapes import Random

# Of attenuated lights, whose intensities grow with the square of a scene's size: what float32 holds.
MOST_INTENSITY, LEAST_SCALE = 3e38, 1e-15


def shaped(rng: Random, lights: Sequence[PointLight], scale: float, center: Array) -> tuple[Light, ...]:
    """Return the lights, some of them with directions, cones and attenuation; the first always. scale, center: size and
    middle of the scene."""
    return tuple(
        _shaped(rng, light, scale, center) if k == 0 or rng.random() < 0.6 else light for k, light in enumerate(lights)
    )


def _shaped(rng: Random, light: PointLight, scale: float, center: Array) -> Light:
    kind, direction = rng.random(), center - light.position
    if rng.random() < 0.3 or not direction.any():
        direction = rng.normal(size=3)
    direction = direction + scale * rng.uniform(0.0, 0.5) * rng.normal(size=3)
    if kind < 0.3 and direction.any():
        return DirectionalLight(direction, light.intensity)
    attenuation, intensity, end = _attenuation(rng, light, scale)
    if kind < 0.6 or not direction.any():
        if attenuation == "none":
            return DirectionalLight(rng.normal(size=3), light.intensity)
        return PointLight(light.position, intensity, attenuation, end)
    inner, outer = sorted(rng.uniform(0.0, WIDEST_CONE, 2))
    how = rng.random()
    if how < 0.15:
        inner = outer
    elif how < 0.4:
        inner, outer = 0.0, float(rng.choice((0.0, 1e-3, 1.0, WIDEST_CONE)))
    return SpotLight(light.position, direction, intensity, inner, outer, attenuation, end)


def _attenuation(rng: Random, light: PointLight, scale: float) -> tuple[Attenuation, Array, float | None]:
    """Return attenuation, intensity and range."""
    intensity = light.intensity * scale**2
    if np.abs(intensity).max() > MOST_INTENSITY or scale < LEAST_SCALE or rng.random() < 0.2:
        return "none", light.intensity, None
    how = rng.random()
    end = None if how < 0.4 else scale * (rng.uniform(1.0, 10.0) if how < 0.8 else 10.0 ** rng.uniform(-12, 12))
    return "inverse-square", intensity, end
