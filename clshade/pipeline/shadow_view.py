"""The rays of a camera in the casters' frame, from which kernels find the points that receive shadows."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.lights import PlacedLight
from ..scene.model import Light
from .camera_space import CameraSpace
from .hierarchy import CasterFrame, split
from .light_points import sides_of
from .struct_layout import SAMPLE_BITS, SHADOW_REACH, SINGLE

_FARTHEST = 2.0**90  # products of three coordinates stay within float32's range


def write_shadow_view(row: np.void, space: CameraSpace, frame: CasterFrame) -> None:
    """Fill a row of structs.ShadowView for a camera.

    Rays are counted from the pixel at the whole image's center, by whole 1/256 px that float32 holds.
    """
    camera, raster, steps = space.camera, space.raster, 1 << SAMPLE_BITS
    across, upward, forward = space.axes
    columns, rows = raster.resolution
    center = columns * steps // 2, rows * steps // 2
    (height, width), principal = raster.plane, raster.principal
    start = (camera.eye - frame.origin) * frame.unit
    right, up = width / (columns * steps) * across, height / (rows * steps) * upward
    middle = (center[0] - principal[0] * columns * steps) * right + (center[1] - principal[1] * rows * steps) * up
    if camera.orthographic:
        start, along = start + middle * frame.unit, forward
        right, up = right * frame.unit, up * frame.unit
    else:
        along = middle + camera.focal * forward
        largest = max(float(np.abs(along).max()), width, height)
        along, right, up = along / largest, right / largest, up / largest
    for name, vector in (("start", start), ("along", along), ("right", right), ("up", up)):
        row[name], row[f"{name}_low"] = np.split(split(np.clip(vector, -_FARTHEST, _FARTHEST)), 2)
    row["center"] = [middle - steps * first for middle, first in zip(center, raster.first, strict=True)]


def shadow_lights(lights: tuple[Light, ...], frame: CasterFrame) -> Array:
    """Return rows of structs.ShadowLight of the lights that shine, in their order, at least one."""
    rows = [frame.light(_homogeneous(light), _size(light)) for light in lights if light.intensity.any()]
    return np.concatenate(rows) if rows else np.zeros(1, SINGLE.ShadowLight)


def shadow_factors(lights: tuple[Light, ...], frame: CasterFrame) -> Floats:
    """Return what turns lengths into the units of the rows of `shadow_lights`, one of each light that shines: the frame's
    unit times w, which the row has as 0 if it is too small."""
    factors = []
    for light in lights:
        if light.intensity.any():
            w = 0.0
            if isinstance(light, PlacedLight):
                moved = (np.asarray(light.position, np.float64) - frame.origin) * frame.unit
                reach = float(np.abs(moved).max()) + _size(light) * frame.unit
                w = 1.0 if reach <= SHADOW_REACH else SHADOW_REACH * 2.0 ** -math.frexp(reach)[1]
            factors.append(frame.unit * w)
    return np.array(factors)


def _size(light: Light) -> float:
    """Return how far from its position a light reaches."""
    return float(np.abs(sides_of(light)).sum()) if isinstance(light, PlacedLight) else 0.0


def _homogeneous(light: Light) -> Floats:
    """Return the position of a light, w = 1, or the unit vector toward a directional one, w = 0."""
    return np.append(light.position, 1.0) if isinstance(light, PlacedLight) else np.append(-light.axis, 0.0)
