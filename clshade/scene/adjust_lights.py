"""Adjust a scene's lights: which are used, how bright they are, and where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats
from ..base.validation import number
from ..errors import InputError
from .lights import DirectionalLight, PointLight, attenuates
from .model import Light, Scene


def with_lights(scene: Scene, chosen: Sequence[int], option: str = "lights") -> Scene:
    """Return the scene with only the lights of these indices, its own from now on. Raises InputError, naming `option`,
    for an index that it lacks."""
    for index in chosen:
        if not 0 <= index < len(scene.lights):
            expected = f"indices from 0 to {len(scene.lights) - 1}" if scene.lights else "none, the scene has no lights"
            raise InputError(f"{option}: expected {expected}, found {index}")
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


def turned_light(light: Light, center: Floats, turn: Array) -> Light:
    """Return the light turned about `center` by a rotation (3, 3). Raises InputError where a position overflows."""
    changed: dict[str, Any] = {}
    if not isinstance(light, DirectionalLight):
        with np.errstate(over="ignore"):
            changed["position"] = np.asarray(center + turn @ (light.position - center))
    if not isinstance(light, PointLight):
        changed["direction"] = turn @ light.direction
    return replace(light, **changed)


def rescaled_light(light: Light, scale: float, shift: float | Floats) -> Light:
    """Return the light of a scene whose lengths are `scale` times as large, moved by `shift`: what it lights is as bright
    as before."""
    if isinstance(light, DirectionalLight):
        return light
    changed: dict[str, Any] = {"position": light.position * scale + shift}
    if attenuates(light):
        changed["intensity"] = light.intensity * scale**2
        changed["range"] = None if light.range is None else light.range * scale
    return replace(light, **changed)
