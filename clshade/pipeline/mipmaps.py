"""Mip-map levels of a texture: each half as wide and high as the previous one, rounded down, to a single texel."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array
from ..scene.model import Texture

BAND = 1 << 18  # values of the larger level halved at a time, in float64: they stay in the cache

_levels: WeakKeyDictionary[Texture, list[Array]] = WeakKeyDictionary()


def levels_below(texture: Texture) -> list[Array]:
    """Return `smaller_levels` of a texture without its alpha; kept as long as the texture lives."""
    if texture not in _levels:
        _levels[texture] = smaller_levels(texture.image[..., :3])
    return _levels[texture]


def smaller_levels(image: Array) -> list[Array]:
    """Return the levels below an image (h, w, C), float32, from the largest, max(h // 2, 1) by max(w // 2, 1), to 1 x 1.

    A texel is the mean, in linear light, of the area of the previous level that it covers: the box filter, also for odd
    sizes. Computed in float64 from level to level, rounded once, so that a constant image has constant levels.
    """
    values, levels = image, []
    while max(values.shape[:2]) > 1:
        values = _half_size(values)
        levels.append(values.astype(np.float32))
    return levels


def _half_size(values: Array) -> Array:
    """Return the next level of (h, w, C), float64. Works in bands of rows, so that only the result is held whole in
    float64."""
    height, width, channels = values.shape
    rows = max(height // 2, 1)
    half = np.empty((rows, max(width // 2, 1), channels))
    band = max(1, BAND // (2 * width * channels))
    for start in range(0, rows, band):
        stop = min(start + band, rows)
        halved = _halved(values, start, stop)
        half[start:stop] = _halved(halved.swapaxes(0, 1), 0, half.shape[1]).swapaxes(0, 1)
    return half


def _halved(rows: Array, start: int, stop: int) -> Array:
    """Return rows `start` to `stop` of an image with half as many rows, rounded down, but at least one; float64.

    Of 2m+1 rows each new one covers 2 + 1/m. The i-th has (m-i)/m of the first, all of the second and (i+1)/m of the third
    of its three: a polyphase box filter, as in the remarks on OpenGL's ARB_texture_non_power_of_two.
    """
    m = len(rows) // 2
    if m == 0:
        return rows.astype(np.float64)
    if len(rows) == 2 * m:
        part = rows[2 * start : 2 * stop].astype(np.float64, copy=False)
        return (part[0::2] + part[1::2]) * 0.5
    part = rows[2 * start : 2 * stop + 1].astype(np.float64, copy=False)
    i = np.arange(start, stop, dtype=np.float64)[:, None, None]
    return ((m - i) * part[:-1:2] + m * part[1::2] + (i + 1.0) * part[2::2]) / (2 * m + 1)
