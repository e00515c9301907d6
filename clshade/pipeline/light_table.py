"""The lights of a scene as the kernels read them, for each frame anew: relative to the eye, and scaled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.lights import NARROWEST_EDGE, DirectionalLight, PointLight, SpotLight, attenuates, unit_direction
from ..scene.model import Light
from .shading_tables import Real, light_exponents, relative_lights, to_real
from .struct_layout import Structs

_MOST_ATTENUATED = 50  # squared distances of 2^100 leave room for the cone's factor above the smallest normal float
_MOST_INVERSE = 2.0**60  # of a range, scaled: nearer than 2^-50 nothing arrives


class LightTable:
    """The lights of non-zero intensity. unit: what their intensities are expressed in."""

    def __init__(self, lights: Sequence[Light], unit: float, structs: Structs) -> None:
        shining = [light for light in lights if light.intensity.any()]
        self._rows = np.zeros(max(len(shining), 1), structs.Light)
        self._real: Real = structs.real
        self.count, self.unit = len(shining), unit
        intensities = np.array([light.intensity for light in shining]).reshape(-1, 3) / unit
        rows = self._rows[: self.count]
        rows["intensity"] = to_real(intensities, self._real)
        for row, light in zip(rows, shining, strict=True):
            _write_shape(row, light, self._real)
        placed = [(k, light) for k, light in enumerate(shining) if not isinstance(light, DirectionalLight)]
        self._placed = np.array([k for k, _ in placed], np.int64)
        self._positions = np.array([light.position for _, light in placed]).reshape(-1, 3)
        self._attenuated = np.array([attenuates(light) for _, light in placed], bool)
        self._most = np.where(self._attenuated, _MOST_ATTENUATED, 60)
        self._intensities: Floats = intensities[self._placed[self._attenuated]]
        ranges = [light.range or math.inf for _, light in placed if attenuates(light)]
        with np.errstate(over="ignore"):
            self._inverse_ranges: Floats = np.float64(1.0) / np.array(ranges)

    def rows(self, eye: Array, scale: float) -> Array:
        """Return rows of structs.Light, at least one, for an eye (3,) and the scale of its coordinates, a power of two."""
        if len(self._placed):
            self._rows["position"][self._placed] = relative_lights(self._positions, eye, scale, self._most)
        if self._attenuated.any():
            exponents = light_exponents(self._positions, eye, scale, self._most)
            self._write_attenuation(self._placed[self._attenuated], exponents[self._attenuated])
        return self._rows

    def _write_attenuation(self, index: Array, exponents: Array) -> None:
        """Write what depends on distances, which the kernels count in 2^-exponent of the scene's unit, of the rows `index`
        of attenuated lights."""
        with np.errstate(over="ignore", under="ignore"):
            intensities = np.ldexp(self._intensities, 2 * exponents[:, None])
            inverse = np.ldexp(self._inverse_ranges, -exponents)
        self._rows["intensity"][index] = to_real(intensities, self._real)
        self._rows["inverse_range"][index] = to_real(np.minimum(inverse, _MOST_INVERSE), self._real)


def _write_shape(row: np.void, light: Light, real: Real) -> None:
    """Write what no camera changes."""
    if isinstance(light, DirectionalLight):
        row["directional"], row["position"] = 1.0, -unit_direction(light)
        return
    row["attenuated"] = attenuates(light)
    if isinstance(light, PointLight):
        return
    inner, outer = (math.cos(math.radians(angle)) for angle in (light.inner_cone, light.outer_cone))
    row["cone"], row["axis"] = 1, unit_direction(light)
    row["cone_cosine"] = to_real(np.float64(outer), real)
    row["cone_scale"] = 1.0 / max(inner - outer, NARROWEST_EDGE)


def typical_intensities(lights: Sequence[Light], radius: float) -> Floats:
    """Return the intensities (L, 3) with which lights arrive, the attenuated ones at a distance of `radius`."""
    found = np.array([light.intensity for light in lights]).reshape(-1, 3)
    for row, light in zip(found, lights, strict=True):
        if isinstance(light, (PointLight, SpotLight)) and attenuates(light) and radius > 0.0:
            with np.errstate(over="ignore"):
                row[:] = np.nan_to_num(row / radius / radius)
    return found
