"""Random lights, with any values of their fields, also at their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from random_kinds import Kind, Random

from clshade.base.arrays import Array
from clshade.errors import InputError
from clshade.scene.lights import FIELDS, LIGHTS, Field, PointLight
from clshade.scene.model import Light, Mesh

# Of attenuated lights, whose intensities grow with the square of a scene's size: what float32 holds.
MOST_INTENSITY, LEAST_SCALE = 3e38, 1e-15


def random_lights(
    rng: Random, kind: Kind, meshes: Sequence[Mesh], center: Array, scale: float, shift: Array
) -> tuple[Light, ...]:
    """Return lights, at most six, of a scene that is scaled and then shifted; some are of the kind's sorts, and then
    the first is. The first is not black if the kind needs it."""
    points = [_point(rng, meshes) for _ in range(rng.integers(0, 6))]
    if kind.specialize or kind.two_sided or kind.normal_faces or kind.shaped or kind.sized:
        points.insert(0, PointLight(3.0 * rng.normal(size=3), rng.uniform(0.1, 1.0, 3)))
    points = [replace(point, position=point.position * scale + shift) for point in points]
    lights: list[Light] = list(points)
    for sized in [False] * kind.shaped + [True] * kind.sized:
        for k, point in enumerate(points):
            if k == 0 or rng.random() < 0.5:
                lights[k] = _light(rng, sized, point, scale, center * scale + shift)
    return tuple(lights)


def _point(rng: Random, meshes: Sequence[Mesh]) -> PointLight:
    position, intensity = 3.0 * rng.normal(size=3), rng.uniform(0, 2, 3)
    where, how = rng.random(2)
    if where < 0.1:
        position *= 10.0 ** rng.uniform(0, 9)
    elif where < 0.2:
        verts = meshes[rng.integers(len(meshes))].verts
        position = verts[rng.integers(len(verts))].astype(np.float64) if len(verts) else position
    elif where < 0.25:
        position = np.zeros(3)
    if how < 0.15:
        intensity *= 10.0 ** rng.uniform(-30, 30)
    elif how < 0.25:
        intensity[rng.random(3) < 0.6] = 0.0
    elif how < 0.3:
        intensity *= -1.0
    return PointLight(position, intensity)


def _light(rng: Random, sized: bool, point: PointLight, scale: float, center: Array) -> Light:
    """Return a light where a point is, and as bright. Half of those with a direction shine at the center."""
    while True:
        kind = LIGHTS[rng.integers(len(LIGHTS))]
        values = {field.name: _value(rng, FIELDS[field.name], scale) for field in fields(kind)}
        overrides = {"position": point.position, "intensity": point.intensity}
        if rng.random() < 0.5:
            overrides["direction"] = center - point.position + scale * rng.uniform(0.0, 0.5) * rng.normal(size=3)
        try:
            light = kind(**{**values, **{name: value for name, value in overrides.items() if name in values}})
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
