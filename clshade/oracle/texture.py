"""Texture lookups: bilinear, in both conventions, and trilinear between mip-map levels."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats, Integers, Reals


def wrapped(t: Floats, wrap: str) -> Floats:
    """Wrap a texture coordinate, in units of the image: repeat and clamp to [0, 1], mirror to [0, 2]."""
    if wrap == "repeat":
        return t - np.floor(t)
    if wrap == "mirror":
        return np.mod(t, 2.0)
    return np.clip(t, 0.0, 1.0)


def wrapped_index(i: Integers, size: int, wrap: str) -> Integers:
    """Return the texel, 0 to size - 1, at integer position i of an endless row of texels."""
    if wrap == "repeat":
        return i % size
    if wrap == "mirror":
        i = i % (2 * size)
        return np.where(i < size, i, 2 * size - 1 - i)
    return np.clip(i, 0, size - 1)


def neighbors(t: Floats, size: int, lookup: str, wrap: str) -> tuple[Integers, Integers, Floats]:
    """Return, along one axis, the two texels around coordinate t and how far t is from the first (0) to the second (1)."""
    t = np.where(np.isfinite(t), t, 0.0)
    if lookup == "nearest":
        index = np.floor(wrapped(t, wrap) * size).astype(np.int64)
        return (both := wrapped_index(index, size, wrap)), both, np.zeros_like(t)
    if lookup == "course":
        x = np.clip(t, 0.0, 1.0) * (size - 1)
        first = np.floor(x)
        index = first.astype(np.int64)
        return index, np.minimum(index + 1, size - 1), x - first
    x = wrapped(t, wrap) * size - 0.5
    first = np.floor(x)
    index = first.astype(np.int64)
    return wrapped_index(index, size, wrap), wrapped_index(index + 1, size, wrap), x - first


def four_texels(uv: Reals, image: Reals, lookup: str, wrap: str | tuple[str, str]) -> tuple[Floats, Floats, Floats]:
    """Return the texels (2, 2, ..., C) around texture coordinates uv (..., 2), [low or high v, left or right u], and
    the fractions of the way from left to right and low to high, (..., 1) each."""
    at = np.asarray(uv, dtype=np.float64)
    rows, columns = image.shape[:2]
    wrap_u, wrap_v = (wrap, wrap) if isinstance(wrap, str) else wrap
    left, right, fx = neighbors(at[..., 0], columns, lookup, wrap_u)
    low, high, fy = neighbors(at[..., 1], rows, lookup, wrap_v)
    texels = np.array([[image[low, left], image[low, right]], [image[high, left], image[high, right]]])
    return texels, fx[..., None], fy[..., None]


def bilerp(uv: Reals, image: Reals, lookup: str = "standard", wrap: str | tuple[str, str] = "repeat") -> Floats:
    """Return colors (..., C) of an image (h, w, C) at texture coordinates uv (..., 2).

    lookup `standard`: texel (i, j) has its center at ((i+0.5)/w, (j+0.5)/h), and `wrap` (repeat, clamp, mirror) defines
    what lies beyond the image. `course`: u and v are clamped to [0, 1], x = u*(w-1), y = v*(h-1), the neighbors are
    floor(x) and min(floor(x)+1, w-1). `nearest`: the texel whose rectangle holds the
    point. A coordinate that is NaN or infinite counts as 0.
    """
    texels, fx, fy = four_texels(uv, image, lookup, wrap)
    below, above = texels[:, 0] * (1.0 - fx) + texels[:, 1] * fx
    colors: Floats = below * (1.0 - fy) + above * fy
    return colors


def brightest(uv: Reals, image: Reals, lookup: str = "standard", wrap: str | tuple[str, str] = "repeat") -> Floats:
    """Return the largest magnitude (..., C) among the texels of a bilinear lookup: the sensitivity of the color to
    errors of its fractions."""
    largest: Floats = np.abs(four_texels(uv, image, lookup, wrap)[0]).max(axis=(0, 1))
    return largest


def spread(uv: Floats, image: Reals, wrap: tuple[str, str], slack: Floats) -> Floats:
    """Return how much the nearest texel's color (K, C) may change if texture coordinates uv (K, 2) are off by up to `slack`
    (K, 2)."""
    here = bilerp(uv, image, "nearest", wrap)
    found = np.zeros_like(here)
    for across in (-1.0, 0.0, 1.0):
        for down in (-1.0, 0.0, 1.0):
            other = bilerp(uv + slack * [across, down], image, "nearest", wrap)
            found = np.maximum(found, np.abs(other - here))
    return found


def covered_means(rows: Floats) -> Floats:
    """Reduce rows (s, ...) to d = max(s // 2, 1): row i of the result is the mean of what lies from i*s/d to (i+1)*s/d."""
    size = len(rows)
    count = max(size // 2, 1)
    start = np.arange(count) * size  # in units of 1/d row, in which row j lies from j*d to (j+1)*d
    total = np.zeros((count, *rows.shape[1:]))
    for step in range(3):
        j = start // count + step
        overlap = np.minimum((j + 1) * count, start + size) - np.maximum(j * count, start)
        total += np.maximum(overlap, 0)[:, None, None] * rows[np.minimum(j, size - 1)]
    return total / size


def levels(image: Reals) -> list[Reals]:
    """Return the mip-map of an image (h, w, C): the image itself, then each level half the size of the previous one,
    rounded down, to 1 x 1. A texel is the mean of the area that it covers; the levels are kept as float32, as the image
    is."""
    found, exact = [image], image.astype(np.float64)
    while max(exact.shape[:2]) > 1:
        exact = covered_means(covered_means(exact).swapaxes(0, 1)).swapaxes(0, 1)
        found.append(exact.astype(np.float32))
    return found


def level_of_detail(right: Floats, up: Floats, size: tuple[int, int], last: int) -> Floats:
    """Return lambda (...) of OpenGL 4.6, section 8.14, clamped to the levels 0 to `last`.

    right, up: (..., 2) derivatives of u and v from pixel to pixel. size: columns and rows of the image.
    rho, the larger of the two distances in texels, is what a pixel spans; lambda is log2(rho). If one is NaN or infinite
    the last level is right: for derivatives beyond all numbers, the mean of the texture.
    """
    rho = np.maximum(np.hypot(*np.moveaxis(right * size, -1, 0)), np.hypot(*np.moveaxis(up * size, -1, 0)))
    detail: Floats = np.log2(np.clip(np.where(np.isnan(rho), np.inf, rho), 1.0, 2.0**last))
    return detail


def trilinear(
    uv: Floats, right: Floats, up: Floats, mipmap: list[Reals], lookup: str, wrap: tuple[str, str], slack: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return colors (K, C) at texture coordinates uv (K, 2) that change by right and up (K, 2) from pixel to pixel: between
    the colors of the levels before and after lambda. mipmap: as of `levels`. lookup: `standard` or `nearest`.

    Also the largest magnitude among the texels looked up, (K, C), see `brightest`; an error of lambda counts likewise.
    And with `nearest` how much the color may change if uv is off by slack (K, 2).
    """
    last = len(mipmap) - 1
    detail = level_of_detail(right, up, mipmap[0].shape[1::-1], last)
    first = np.floor(detail).astype(np.int64)
    color, most, apart = np.zeros((3, len(uv), mipmap[0].shape[2]))
    for level in np.unique(first):
        mine = first == level
        share = (detail[mine] - level)[:, None]
        both = mipmap[level], mipmap[min(level + 1, last)]
        fine, coarse = (bilerp(uv[mine], image, lookup, wrap) for image in both)
        color[mine] = fine * (1.0 - share) + coarse * share
        most[mine] = np.maximum(*(brightest(uv[mine], image, lookup, wrap) for image in both))
        if lookup == "nearest":
            fine, coarse = (spread(uv[mine], image, wrap, slack[mine]) for image in both)
            apart[mine] = fine * (1.0 - share) + coarse * share
    return color, most + apart, apart
