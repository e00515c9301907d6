"""Mip-map levels of a texture: each half as wide and high as the one before, rounded down, to a single texel."""

from __future__ import annotations

import numpy as np

from .validation import Array


def smaller_levels(image: Array) -> list[Array]:
    """The levels below an image (h, w, C), float32, from the largest, max(h // 2, 1) by max(w // 2, 1), to 1 x 1.

    A texel is the mean of the area of the level before that it covers: the box filter, also where sizes are odd, as linear
    light. Computed in float64 from level to level, rounded once, so that a constant image has constant levels.
    """
    values, levels = image.astype(np.float64), []
    while max(values.shape[:2]) > 1:
        values = _halved(_halved(values).swapaxes(0, 1)).swapaxes(0, 1)
        levels.append(values.astype(np.float32))
    return levels


def _halved(rows: Array) -> Array:
    """Half as many rows, rounded down, but at least one.

    Of 2m+1 rows each new one covers 2 + 1/m. The i-th has (m-i)/m of the first, all of the second and (i+1)/m of the third
    of its three: a polyphase box filter, as the remarks on OpenGL's ARB_texture_non_power_of_two have it.
    """
    m = len(rows) // 2
    if m == 0:
        return rows
    if len(rows) == 2 * m:
        return (rows[0::2] + rows[1::2]) * 0.5
    i = np.arange(m, dtype=np.float64)[:, None, None]
    return ((m - i) * rows[:-1:2] + m * rows[1::2] + (i + 1.0) * rows[2::2]) / (2 * m + 1)
