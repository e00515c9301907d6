"""The environment behind the surfaces: its radiance along rays, and how far rounding may change it."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats, Integers
from ..scene.camera import Camera
from ..scene.environment import Environment
from .microfacet import REACH
from .transform import SAMPLE_STEPS, camera_frame
from .vectors import unit


def rays(camera: Camera, x: Integers, y: Integers) -> Floats:
    """Return unit directions (K, 3), world space, of the rays through points of the image (K,), 1/256 px, y up."""
    axes = camera_frame(camera.eye, camera.lookat, camera.up)
    if camera.orthographic:
        return np.tile(axes[2], (len(x), 1))
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    right = (x / (SAMPLE_STEPS * columns) - principal[0]) * (width / camera.focal)
    up = (y / (SAMPLE_STEPS * rows) - principal[1]) * (height / camera.focal)
    directions: Floats = unit(right[:, None] * axes[0] + up[:, None] * axes[1] + axes[2])
    return directions


def seen(environment: Environment, directions: Floats, precision: str) -> tuple[Floats, Floats]:
    """Return the radiance (K, 3) in unit directions (K, 3), bilinear between the centers of pixels, and the budget (K, 3)
    of its errors. At a pole the first or last row is interpolated to its mean, so that the radiance is continuous there.

    A direction that turns by r moves by at most 2 h/pi r rows, since the row at a pole is half as far away as the others,
    and by w/(2 pi) min(h, 1/sin) r columns: within half a row of a pole, where longitudes turn faster, they count the less.
    Less than a pixel away the mean changes by at most twice that distance times the range of the pixels around, else by the
    range of the image.
    """
    rows, columns, _ = environment.image.shape
    front, left, up = (directions @ axis for axis in environment.axes)
    longitude, polar = np.arctan2(left, front), np.arctan2(np.hypot(left, front), up)
    x, y = columns * (0.5 - longitude / (2.0 * np.pi)) - 0.5, rows * polar / np.pi - 0.5
    column = np.floor(x).astype(np.int64)
    row = np.clip(np.floor(y).astype(np.int64), -1, rows - 1)
    across, down = (x - column)[:, None], (y - row)[:, None]
    down = np.where((row == -1)[:, None], 2.0 * down - 1.0, np.where((row == rows - 1)[:, None], 2.0 * down, down))
    first, last = (environment.image[k].astype(np.float64) * environment.intensity for k in (0, -1))

    def pixel(k: int, i: int) -> Floats:
        """Return the pixels k rows below and i columns to the right of the one above and to the left."""
        at = (row + k)[:, None]
        inside = environment.image[np.clip(row + k, 0, rows - 1), (column + i) % columns].astype(np.float64)
        beyond = np.where(at < 0, first.mean(axis=0), last.mean(axis=0))
        shown: Floats = np.where((at < 0) | (at >= rows), beyond, inside * environment.intensity)
        return shown

    upper = (1.0 - across) * pixel(0, 0) + across * pixel(0, 1)
    lower = (1.0 - across) * pixel(1, 0) + across * pixel(1, 1)
    found = (1.0 - down) * upper + down * lower
    around = np.array([pixel(k, i) for k in (-1, 0, 1, 2) for i in (-1, 0, 1, 2)])
    low, high = around.min(axis=0), around.max(axis=0)
    for near, end in ((row <= 0, first), (row >= rows - 2, last)):  # all longitudes meet there
        low = np.where(near[:, None], np.minimum(low, end.min(axis=0)), low)
        high = np.where(near[:, None], np.maximum(high, end.max(axis=0)), high)
    reach = REACH[precision]
    sine = np.maximum(np.sin(polar), 1.0 / rows)
    moved = reach * (2.0 * rows / np.pi + columns / (2.0 * np.pi * sine))[:, None]
    whole = float(environment.image.max()) * environment.intensity
    off = np.where(moved < 1.0, 2.0 * moved * (high - low), whole)
    most = np.finfo(np.float64 if precision == "float64" else np.float32).max  # where samples saturate
    return np.minimum(found, float(most)), found + off / reach
