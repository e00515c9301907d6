"""Images over nothing: straight alpha from premultiplied colors, and what shows through."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Bytes, Reals
from .tonemap import Operator, tonemap

WHITE, BLACK = (255, 255, 255), (0, 0, 0)
_LIGHT, _DARK = 204, 153  # codes of a checkerboard, as image editors draw it
_SQUARE = 8  # pixels


def straight(rgba: Reals) -> Reals:
    """Return the colors (M, N, 3) of premultiplied (M, N, 4): divided by alpha, 0 where that is 0."""
    alpha = rgba[..., 3:]
    colors: Reals = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0.0)
    return colors


def tonemap_rgba(rgba: Reals, operator: Operator, exposure: float = 0.0) -> Bytes:
    """Return the display image of premultiplied linear floats (M, N, 4) with straight alpha, uint8 (M, N, 4).

    The color is divided by alpha, then tone-mapped as `tonemap` does; alpha, which is linear, becomes round(255*alpha).
    """
    alpha = np.clip(np.nan_to_num(rgba[..., 3]), 0.0, 1.0)
    codes = np.floor(255.0 * alpha.astype(np.float64) + 0.5).astype(np.uint8)
    with np.errstate(over="ignore"):
        return np.dstack([tonemap(straight(rgba), operator, exposure), codes])


def over(picture: Bytes, ground: Bytes | tuple[int, int, int]) -> Bytes:
    """Return a display image without transparency, uint8 (M, N, 3): as viewers show it over a ground of that color, (3,),
    or of a color each pixel, (M, N, 3). An image (M, N, 3) is returned as it is.

    The codes are mixed, as viewers do, not the light.
    """
    if picture.shape[2] == 3:
        return picture
    share = picture[..., 3:].astype(np.uint32)
    mixed = picture[..., :3] * share + np.asarray(ground, np.uint32) * (255 - share)
    return ((mixed + 127) // 255).astype(np.uint8)


def over_checkers(picture: Bytes) -> Bytes:
    """Return a display image over gray squares where it is transparent, see `over`."""
    rows, columns = (np.arange(length) // _SQUARE for length in picture.shape[:2])
    ground: Array = np.where((rows[:, None] + columns) % 2, _DARK, _LIGHT)
    return over(picture, np.repeat(ground[..., None], 3, axis=2).astype(np.uint8))
