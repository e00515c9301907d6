"""An environment as the background: the table of its radiance, and the rays along which kernels look it up."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import Array
from ..scene.environment import Environment
from .camera_space import CameraSpace
from .shading_tables import to_real
from .struct_layout import SAMPLE_BITS, Structs

_ROWS = 256  # of the image, converted at a time
_MOST = 2.0**100  # of the table: sums of its numbers stay within float32's range
_NARROWEST = 2.0**-40  # of the viewing direction's part of a ray: the part across the image is at most 1
_MOST_CENTER = 1 << 30  # 1/256 px


def backdrop_table(environment: Environment, structs: Structs) -> Array:
    """Return the radiance over `unit_of`, ((h + 3) * (w + 2), 4) reals, row by row.

    A column more on each side continues the image around the seam. The first row and the last but one are the poles: the
    mean of the image's first and last row. The last row is read, with a weight of 0, at the lower pole.
    """
    height, width, _ = environment.image.shape
    factor = environment.intensity / unit_of(environment)
    table = np.zeros((height + 3, width + 2, 4), structs.real)

    def put(place: int, rows: Array) -> None:
        inside = to_real(rows * factor, structs.real)
        table[place : place + len(rows), 1:-1, :3] = inside
        table[place : place + len(rows), 0, :3], table[place : place + len(rows), -1, :3] = inside[:, -1], inside[:, 0]

    for first in range(0, height, _ROWS):
        put(1 + first, environment.image[first : first + _ROWS].astype(np.float64))
    for place, row in ((0, 0), (height + 1, -1), (height + 2, -1)):
        pole = environment.image[row].astype(np.float64).mean(axis=0)
        put(place, np.broadcast_to(pole, (1, width, 3)))
    return table.reshape(-1, 4)


def unit_of(environment: Environment) -> float:
    """Return what the table is counted in: 1 for all but extreme radiance, a power of two."""
    most = float(environment.image.max()) * environment.intensity
    return max(1.0, 2.0 ** math.ceil(math.log2(most / _MOST))) if most > 0.0 else 1.0


def write_size(image: np.void, environment: Environment) -> None:
    """Fill a row of structs.Image with what `backdrop_table` holds."""
    image["backdrop_rows"], image["backdrop_columns"] = environment.image.shape[:2]
    image["backdrop_unit"] = unit_of(environment)


def write_rays(image: np.void, environment: Environment, space: CameraSpace, real: type[np.floating]) -> None:
    """Fill a row of structs.Image with the rays through the image of a camera.

    A ray at u, v is proportional to (x, y, f) in camera space: x = (u - u0) W/(N focal), y = (v - v0) H/(M focal) and f = 1,
    all three divided by the largest x or y in the image if that is above 1. Rays of an orthographic camera are all
    parallel. u - u0 is taken in whole 1/256 px, exactly, so that x and y are accurate relative to themselves.
    """
    camera, raster = space.camera, space.raster
    steps = 1 << SAMPLE_BITS
    pixels, principal = np.array(raster.resolution, np.float64), np.array(raster.principal)
    center = np.clip(principal * pixels * steps, -float(_MOST_CENTER), float(_MOST_CENTER))
    whole = np.rint(center)
    with np.errstate(over="ignore"):
        pitch = np.minimum(np.array(raster.plane[::-1]) / (pixels * camera.focal), 1e150)
        largest = (np.maximum(np.abs(principal), np.abs(1.0 - principal)) * pixels * pitch).max()
    scale = 1.0 / max(1.0, min(float(largest), 1e300))
    step = np.zeros(2) if camera.orthographic else pitch * scale / steps
    forward = 1.0 if camera.orthographic else max(scale, _NARROWEST)
    image["ray_center"] = whole.astype(np.int32) - steps * np.array(raster.first, np.int32)
    image["ray_step"] = to_real(step, real)
    image["ray_offset"] = to_real((whole - principal * pixels * steps) * step, real)
    image["ray_axes"] = to_real(environment.axes @ space.axes.T * (1.0, 1.0, forward), real).reshape(-1)
