"""The lights of a scene as the kernels read them, for each frame anew; and the points that stand for those of finite size.

Point i of N lies in the unit square at u = (i + 1/2)/N and v = 1/2 + (i - (N - 1)/2)/phi modulo 1, phi the golden ratio: the
Kronecker sequence of camera_space.py, in fractions of 2^32. Each pixel shifts all of them, modulo 1, by its
column and row times SHIFT_U_COLUMN and so on, in u by the height and in v by the distance from the left at which it is
sampled, fractions of a pixel. On a rectangle u and v are coordinates; on a disc u is the square of the distance from the
center, v the angle (H. Vogel, A better way to construct the sunflower head, Mathematical Biosciences 44, 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.lights import MIN_CONE_EDGE, Light, PlacedLight
from .camera_space import GOLDEN
from .shading_tables import light_exponents, relative_lights, to_real
from .struct_layout import Structs

_ONE = 1 << 32
# The discs of spheres are mirrored from a plane at right angles to this to one that faces the receiver. A receiver just
# opposite is ill-conditioned: hence no axis or diagonal that scenes have.
AXIS = np.array([-2.0, -3.0, -5.0]) / 38.0**0.5
_ACROSS = np.array([3.0, -2.0, 0.0]) / 13.0**0.5
# Two radii, at right angles to each other, of the unit disc that AXIS is normal to.
RADII: Floats = np.stack([_ACROSS, np.cross(AXIS, _ACROSS)])


def pattern(points: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return u and v of the first point, and from point to point, fractions of 2^32."""
    step_v = round(_ONE * GOLDEN)
    first_v = (_ONE // 2 - (points - 1) * step_v // 2) % _ONE
    return (_ONE // (2 * points) % _ONE, first_v), (_ONE // points % _ONE, step_v)


def write_points(row: np.void, points: int, *, sphere: bool) -> None:
    """Write the pattern of so many points into a row of structs.Light. sphere: whether they lie on the disc of one."""
    row["points"], row["sphere"] = points, sphere
    if sphere:
        row["axis"] = AXIS
    row["first_point"], row["point_step"] = np.array(pattern(points), np.uint32).view(np.int32)


def sides_of(light: PlacedLight) -> Floats:
    """Return (2, 3): half the sides of a flat light, or two radii of a sphere's disc that `AXIS` is normal to; 0 of a light
    without a size."""
    return light.radius * RADII if light.sides is None else light.sides


_MOST_ATTENUATED = 50  # squared distances of 2^100 leave room for the cone's factor above the smallest normal float
_LEAST_SIDE = 2.0**-60  # of a light, scaled: products with its points are then no denormal numbers
_MOST_INVERSE = 2.0**60  # of a range, scaled: nearer than 2^-50 nothing arrives


class LightTable:
    """The lights of non-zero intensity. unit: what their intensities are expressed in. points: how many stand for a light
    of finite size. table: rows of structs.Light, at least one. shadow_factors: those of `shadow_lights`, 1 without shadows.
    """

    def __init__(self, lights: Sequence[Light], unit: float, structs: Structs, points: int) -> None:
        shining = [light for light in lights if light.intensity.any()]
        self.count, self.unit, self._real = len(shining), unit, structs.real
        self.shadow_factors: Floats = np.ones(len(shining))
        self.table = np.zeros(max(len(shining), 1), structs.Light)
        intensities = np.array([light.intensity for light in shining]).reshape(-1, 3) / unit
        intensities[[light.has_size for light in shining]] /= points
        self.table["intensity"][: self.count] = to_real(intensities, self._real)
        placed = [(k, light) for k, light in enumerate(shining) if isinstance(light, PlacedLight)]
        for row, light in zip(self.table, shining, strict=False):
            row["attenuated"] = light.attenuates
            if not isinstance(light, PlacedLight):
                row["directional"], row["position"] = 1.0, -light.axis
            elif light.axis is not None:
                row["axis"] = light.axis
            if light.cone is not None:
                inner, outer = (math.cos(math.radians(angle)) for angle in light.cone)
                row["cone"], row["cone_cosine"] = 1, outer
                row["cone_scale"] = 1.0 / max(inner - outer, MIN_CONE_EDGE)
        for k, light in placed:
            if light.has_size:
                write_points(self.table[k], points, sphere=light.sides is None)
        self._placed = np.array([k for k, _ in placed], np.int64)
        self._positions = np.array([light.position for _, light in placed]).reshape(-1, 3)
        self._sides = np.array([sides_of(light) for _, light in placed]).reshape(-1, 2, 3)
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
    intensities = np.array([light.intensity for light in lights]).reshape(-1, 3)
    attenuated = np.array([light.attenuates and radius > 0.0 for light in lights], bool)
    with np.errstate(over="ignore"):
        intensities[attenuated] = np.nan_to_num(intensities[attenuated] / (radius or 1.0) / (radius or 1.0))
    return intensities
