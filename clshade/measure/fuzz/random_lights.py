"""Lights of random scenes that are no plain points: of any kind, with any values of its fields, also at their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...errors import InputError
from ...scene.lights import FIELDS, LIGHTS, Field, PointLight
from ...scene.model import Light
from .random_shapes import Random

# Of attenuated lights, whose intensities grow with the square of a scene's size: what float32 holds.
MOST_INTENSITY, LEAST_SCALE = 3e38, 1e-15


def replaced(
    rng: Random, lights: Sequence[Light], points: Sequence[PointLight], sized: bool, scale: float, center: Array
) -> tuple[Light, ...]:
    """Return the lights, the first and half of the others replaced by lights of finite size, or by others that are no plain
    points. points: where these are, and how bright. scale, center: size and middle of the scene."""
    found = list(lights)
    for k, point in enumerate(points):
        if k == 0 or rng.random() < 0.5:
            found[k] = _light(rng, sized, point, scale, center)
    return tuple(found)


def _light(rng: Random, sized: bool, point: PointLight, scale: float, center: Array) -> Light:
    """Return a light where a point is, and as bright. Half of those with a direction shine at the scene."""
    while True:
        kind = LIGHTS[rng.integers(len(LIGHTS))]
        given = {each.name: _value(rng, FIELDS[each.name], scale) for each in fields(kind)}
        known = {"position": point.position, "intensity": point.intensity}
        if rng.random() < 0.5:
            known["direction"] = center - point.position + scale * rng.uniform(0.0, 0.5) * rng.normal(size=3)
        try:
            light = kind(**{**given, **{name: value for name, value in known.items() if name in given}})
        except InputError:  # values that do not go together
            continue
        if light.attenuates:
            intensity = light.intensity * scale**2
            if np.abs(intensity).max() > MOST_INTENSITY or scale < LEAST_SCALE:
                continue
            light = replace(light, intensity=intensity)
        if light.has_size == sized and not light.is_plain:
            return light


def _value(rng: Random, field: Field, scale: float) -> Any:
    """Return a value of a field: any vector, a value that it names, any length, or one between those that it names."""
    length = scale * 10.0 ** (rng.uniform(-1.5, 1.0) if rng.random() < 0.7 else rng.uniform(-8.0, 8.0))
    if field.turns:
        axis = rng.permutation([0.0, 0.0, rng.choice((-1.0, 1.0))])
        vector = axis if rng.random() < 0.3 else rng.normal(size=3)
        return length * vector if field.grows else vector
    named = field.values[rng.integers(len(field.values))] if field.values else None
    if field.grows:
        return named if rng.random() < 0.4 else length
    ends = [value for value in field.values if isinstance(value, float)]
    return rng.uniform(min(ends), max(ends)) if len(ends) > 1 and rng.random() < 0.6 else named
