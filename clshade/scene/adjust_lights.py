"""Adjust a scene's lights: which are used, how bright they are, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..base.validation import number
from ..errors import InputError
from .lights import PointLight
from .model import Scene


def with_lights(scene: Scene, chosen: Sequence[int], option: str = "lights") -> Scene:
    """Return the scene with only the lights of these indices, its own from now on. Raises InputError, naming `option`,
    for an index that it lacks."""
    for index in chosen:
        if not 0 <= index < len(scene.lights):
            if not scene.lights:
                raise InputError(f"{option}: the scene has no lights")
            raise InputError(f"{option}: expected indices from 0 to {len(scene.lights) - 1}, found {index}")
    return replace(scene, lights=tuple(scene.lights[i] for i in dict.fromkeys(chosen)), own_lights=True)


def scaled_lights(scene: Scene, factors: Sequence[float], option: str = "light intensity") -> Scene:
    """Return the scene with its lights' intensities multiplied by `factors`: one for each light, or one for all.

    A factor is at least 0; 0 turns a light off. Raises InputError, naming `option`.
    """
    count = len(scene.lights)
    if len(factors) not in (1, count):
        expected = f"one factor, or {count}: one for each light" if count > 1 else "one factor"
        raise InputError(f"{option}: expected {expected}, found {len(factors)}")
    scales = [number("scene", option, factor, least=0.0) for factor in factors]
    scales = scales * count if len(scales) == 1 else scales
    lights = zip(scene.lights, scales, strict=True)
    return replace(scene, lights=tuple(replace(light, intensity=light.intensity * scale) for light, scale in lights))


def sized_lights(scene: Scene, radius: float, option: str = "light radius") -> Scene:
    """Return the scene with spheres of this radius, scene units, for its point lights. Raises InputError, naming `option`,
    for a radius below 0 or a scene without point lights."""
    size = number("scene", option, radius, least=0.0)
    if not any(isinstance(light, PointLight) for light in scene.lights):
        raise InputError(f"{option}: the scene has no point lights")
    lights = (replace(light, radius=size) if isinstance(light, PointLight) else light for light in scene.lights)
    return replace(scene, lights=tuple(lights))
