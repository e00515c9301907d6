"""The lights of a scene as the kernels read them, for each frame anew: relative to the eye, and scaled."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.lights import PlacedLight
from ..scene.model import Light
from . import light_points
from .light_rows import rows_of
from .shading_tables import Real, light_exponents, relative_lights, to_real
from .struct_layout import Structs

_MOST_ATTENUATED = 50  # squared distances of 2^100 leave room for the cone's factor above the smallest normal float
_LEAST_SIDE = 2.0**-60  # of a light, scaled: products with its points are then no denormal numbers
_MOST_INVERSE = 2.0**60  # of a range, scaled: nearer than 2^-50 nothing arrives


class LightTable:
    """The lights of non-zero intensity. unit: what their intensities are expressed in. points: how many stand for a light
    of finite size. table: rows of structs.Light, at least one. shadow_factors: what `shadow_view.shadow_factors` returns of
    the same lights, 1 without shadows."""

    def __init__(self, lights: Sequence[Light], unit: float, structs: Structs, points: int) -> None:
        shining = [light for light in lights if light.intensity.any()]
        self.table = rows_of(shining, structs.Light)
        self._real: Real = structs.real
        self.count, self.unit = len(shining), unit
        self.shadow_factors: Floats = np.ones(len(shining))
        intensities = np.array([light.intensity for light in shining]).reshape(-1, 3) / unit
        sized = np.array([light.has_size for light in shining], bool)
        intensities[sized] /= points
        rows = self.table[: self.count]
        rows["intensity"] = to_real(intensities, self._real)
        placed = [(k, light) for k, light in enumerate(shining) if isinstance(light, PlacedLight)]
        for k, light in placed:
            if light.has_size:
                rows[k]["points"], rows[k]["sphere"] = points, light.sides is None
                if light.sides is None:
                    rows[k]["axis"] = light_points.AXIS
                light_points.write_pattern(rows[k], points)
        self._placed = np.array([k for k, _ in placed], np.int64)
        self._positions = np.array([light.position for _, light in placed]).reshape(-1, 3)
        self._sides = np.array([light_points.sides_of(light) for _, light in placed]).reshape(-1, 2, 3)
        self._sizes = np.abs(self._sides).max(axis=(1, 2), initial=0.0)
        self._attenuated = np.array([light.attenuates for _, light in placed], bool)
        self._most = np.where(self._attenuated, _MOST_ATTENUATED, 60)
        self._intensities: Floats = intensities[self._placed[self._attenuated]]
        ranges = [light.range or math.inf for _, light in placed if light.attenuates]
        with np.errstate(over="ignore"):
            self._inverse_ranges: Floats = np.float64(1.0) / np.array(ranges)

    def rows(self, eye: Array, scale: float) -> Array:
        """Return rows of structs.Light, at least one, for an eye (3,) and the scale of its coordinates, a power of two."""
        if len(self._placed):
            place = self._positions, eye, scale, self._most
            self.table["position"][self._placed] = relative_lights(*place)
            exponents = light_exponents(*place, self._sizes)
        if self._sizes.any():
            # What spans the lights of finite size is counted in 2^-exponent of the scene's unit: 2^smaller times what their
            # positions would be.
            smaller = exponents - light_exponents(*place)
            sides = np.ldexp(self._sides, exponents[:, None, None])
            sides = np.where(np.abs(sides) < _LEAST_SIDE, 0.0, sides)
            self.table["right"][self._placed], self.table["up"][self._placed] = sides[:, 0], sides[:, 1]
            self.table["center_scale"][self._placed] = to_real(np.ldexp(1.0, smaller), self._real)
            factors = self.shadow_factors[self._placed]
            self.table["shadow_scale"][self._placed] = to_real(np.ldexp(factors, -exponents), self._real)
        if self._attenuated.any():  # their intensities depend on distances, which the kernels count likewise
            index, exponents = self._placed[self._attenuated], exponents[self._attenuated]
            with np.errstate(over="ignore", under="ignore"):
                intensities = np.ldexp(self._intensities, 2 * exponents[:, None])
                inverse = np.ldexp(self._inverse_ranges, -exponents)
            self.table["intensity"][index] = to_real(intensities, self._real)
            self.table["inverse_range"][index] = to_real(np.minimum(inverse, _MOST_INVERSE), self._real)
        return self.table


def typical_intensities(lights: Sequence[Light], radius: float) -> Floats:
    """Return the intensities (L, 3) with which lights arrive, the attenuated ones at a distance of `radius`."""
    found = np.array([light.intensity for light in lights]).reshape(-1, 3)
    attenuated = np.array([light.attenuates and radius > 0.0 for light in lights], bool)
    with np.errstate(over="ignore"):
        found[attenuated] = np.nan_to_num(found[attenuated] / (radius or 1.0) / (radius or 1.0))
    return found
