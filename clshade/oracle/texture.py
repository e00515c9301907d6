"""Bilinear texture lookup, both conventions."""

from __future__ import annotations

import numpy as np

from .vectors import Array


def wrapped(t: Array, wrap: str) -> Array:
    """A texture coordinate in units of the image, brought near the image: repeat and clamp to [0, 1], mirror [0, 2]."""
    if wrap == "repeat":
        return t - np.floor(t)
    if wrap == "mirror":
        return np.mod(t, 2.0)
    return np.clip(t, 0.0, 1.0)


def wrapped_index(i: Array, size: int, wrap: str) -> Array:
    """The texel, 0 to size - 1, that stands for whole position i of an endless row of texels."""
    if wrap == "repeat":
        return i % size
    if wrap == "mirror":
        i = i % (2 * size)
        return np.where(i < size, i, 2 * size - 1 - i)
    return np.clip(i, 0, size - 1)


def neighbors(t: Array, size: int, lookup: str, wrap: str) -> tuple[Array, Array, Array]:
    """Along one axis: the two texels around coordinate t and how far t is from the first (0) to the second (1)."""
    t = np.where(np.isfinite(t), t, 0.0)
    if lookup == "course":
        x = np.clip(t, 0.0, 1.0) * (size - 1)
        first = np.floor(x)
        index = first.astype(np.int64)
        return index, np.minimum(index + 1, size - 1), x - first
    x = wrapped(t, wrap) * size - 0.5
    first = np.floor(x)
    index = first.astype(np.int64)
    return wrapped_index(index, size, wrap), wrapped_index(index + 1, size, wrap), x - first


def bilerp(uv: Array, image: Array, lookup: str = "standard", wrap: str | tuple[str, str] = "repeat") -> Array:
    """Colors (..., C) of an image (h, w, C) at texture coordinates uv (..., 2).

    lookup `standard`: texel (i, j) has its center at ((i+0.5)/w, (j+0.5)/h), and `wrap` (repeat, clamp, mirror) says
    what lies beyond the image. `course`: u and v are held to [0, 1], x = u*(w-1), y = v*(h-1), the neighbors are
    floor(x) and min(floor(x)+1, w-1). A coordinate that is NaN or infinite counts as 0.
    """
    uv = np.asarray(uv, dtype=np.float64)
    rows, columns = image.shape[:2]
    wrap_u, wrap_v = (wrap, wrap) if isinstance(wrap, str) else wrap
    left, right, fx = neighbors(uv[..., 0], columns, lookup, wrap_u)
    low, high, fy = neighbors(uv[..., 1], rows, lookup, wrap_v)
    fx, fy = fx[..., None], fy[..., None]
    below = image[low, left] * (1.0 - fx) + image[low, right] * fx
    above = image[high, left] * (1.0 - fx) + image[high, right] * fx
    return below * (1.0 - fy) + above * fy
