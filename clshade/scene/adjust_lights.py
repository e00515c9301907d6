"""Adjust a scene's lights: which are used, and how bright they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..base.validation import number
from ..errors import InputError
from .model import Scene


def with_lights(scene: Scene, chosen: Sequence[int], option: str = "lights") -> Scene:
    """Return the scene with only the lights of these indices. Raises InputError, naming `option`, for an index that it
    lacks."""
    for index in chosen:
        if not 0 <= index < len(scene.lights):
            expected = f"indices from 0 to {len(scene.lights) - 1}" if scene.lights else "none, the scene has no lights"
            raise InputError(f"{option}: expected {expected}, found {index}")
    return replace(scene, lights=tuple(scene.lights[i] for i in dict.fromkeys(chosen)))


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
