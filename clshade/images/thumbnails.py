"""Layers of any content as small display images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..base.arrays import Array
from .channels import grouped
from .decode import srgb_to_linear
from .tonemap import tonemap

SIDE = 320  # pixels, at most, along the longer side of a thumbnail; others are skipped, so that none is averaged away
UNIT_OFF = 1e-2  # tolerance for the length of a direction: half floats are off by 1e-3
COLORS = ("red", "green", "blue")
NOTHING = (96, 96, 96)  # gray for NaN and infinity where colors stand for numbers
_RANGE = (1.0, 99.0)  # percentiles that colors span: a single outlier would take them all


class Thumbnail(NamedTuple):
    """A small display image. pixels: (h, w, 3) uint8, row 0 at the top. note: what its colors mean, a few words."""

    pixels: Array
    note: str


def thinned(plane: Array, side: int = SIDE) -> Array:
    """Return every k-th pixel of (M, N, ...) from the first on, a view, at most `side` along the longer side.

    Strips are thinned less along the shorter side, so that some of it remains.
    """
    longer = -(-max(plane.shape[:2]) // side)
    down, across = (min(longer, -(-4 * length // side)) for length in plane.shape[:2])
    return plane[::down, ::across]


def largest(errors: Array, side: int = SIDE) -> Array:
    """Return the largest error of each block of pixels of which `thinned` shows the first."""
    rows, columns = thinned(errors, side).shape
    down, across = -(-errors.shape[0] // rows), -(-errors.shape[1] // columns)
    padded = np.pad(errors, ((0, rows * down - errors.shape[0]), (0, columns * across - errors.shape[1])))
    maxima: Array = padded.reshape(rows, down, columns, across).max(axis=(1, 3))
    return maxima


def thumbnails(channels: Mapping[str, Array], *, encoded: bool = False, side: int = SIDE) -> dict[str, Thumbnail]:
    """Return a thumbnail of each layer of an image. channels: name -> (M, N); encoded: whether colors are sRGB-encoded.

    Integers are taken as identifiers, each with a color of its own, 0 black; X, Y, Z as a direction if they have length
    1, shown as (n + 1)/2, else as a position; R, G, B as a color; single floats as a quantity.
    """
    return {
        name: _thumbnail(group.family, group.names, [thinned(plane, side) for plane in group.planes], encoded)
        for name, group in grouped(channels).items()
    }


def _thumbnail(family: str, names: Sequence[str], planes: Sequence[Array], encoded: bool) -> Thumbnail:
    if any(plane.dtype.kind in "iub" for plane in planes):
        return Thumbnail(_categories(planes), "each number a color")
    if len(planes) == 1:
        return _quantity(planes[0].astype(np.float64))
    stacked = np.stack(planes, axis=-1).astype(np.float64)
    if family == "RGB" and len(planes) == 3:
        return Thumbnail(tonemap(srgb_to_linear(stacked) if encoded else stacked, "srgb"), "as it is, sRGB")
    if family == "UVW":
        colors = ", ".join(f"{color} {name[-1].lower()}" for color, name in zip(COLORS, names, strict=False))
        with np.errstate(invalid="ignore"):
            return Thumbnail(_codes(stacked % 1.0), f"{colors}, from 0 to 1, repeated")
    if family == "XYZ" and len(planes) == 3:
        with np.errstate(over="ignore", invalid="ignore"):
            lengths = np.sqrt(np.square(stacked).sum(axis=-1, keepdims=True))
        nonzero = lengths[lengths != 0.0]
        if nonzero.size and (np.abs(nonzero - 1.0) <= UNIT_OFF).all():
            return Thumbnail(
                _codes(np.where(stacked.any(axis=-1, keepdims=True), (stacked + 1.0) / 2.0, 0.0)), "(n + 1)/2"
            )
    return Thumbnail(_codes(np.stack([_spread(plane)[0] for plane in planes], axis=-1)), "each component's range")


def color_mapped(values: Array, name: str) -> Array:
    """Return the colors of one of Matplotlib's maps for (M, N) values from 0 to 1, uint8 (M, N, 3)."""
    from matplotlib import colormaps

    pixels: Array = np.rint(255.0 * colormaps[name](values)[..., :3]).astype(np.uint8)
    return pixels


def _codes(values: Array) -> Array:
    """Convert (M, N, 2|3) floats from 0 to 1 to (M, N, 3) uint8, a missing component to 0; gray where one is not finite."""
    finite = np.asarray(np.isfinite(values).all(axis=-1))
    codes = np.zeros((*values.shape[:2], 3), np.uint8)
    codes[..., : values.shape[2]] = np.rint(255.0 * np.clip(np.where(finite[..., None], values, 0.0), 0.0, 1.0))
    codes[~finite] = NOTHING
    return codes


def _spread(plane: Array) -> tuple[Array, float, float]:
    """Return a plane, its finite values mapped from a percentile range to [0, 1], others NaN; and the range."""
    plane = plane.astype(np.float64)
    finite = np.isfinite(plane)
    if not finite.any():
        return np.full(plane.shape, np.nan), np.nan, np.nan
    low, high = (float(v) for v in np.percentile(plane[finite], _RANGE, method="nearest"))
    spread = (np.where(finite, plane, np.nan) - low) / (high - low) if high > low else np.where(finite, 0.5, np.nan)
    return np.clip(spread, 0.0, 1.0), low, high


def _quantity(plane: Array) -> Thumbnail:
    spread, low, high = _spread(plane)
    pixels = color_mapped(np.nan_to_num(spread), "viridis")
    pixels[np.isnan(spread)] = NOTHING
    if np.isnan(low):
        return Thumbnail(pixels, "none is finite")
    gray = "" if np.isfinite(plane).all() else ", gray infinite or NaN"
    return Thumbnail(pixels, f"dark {low:.4g} to light {high:.4g}{gray}")


def _categories(planes: Sequence[Array]) -> Array:
    """Return a color for each number, or tuple of them, that does not depend on the image; 0 is black."""
    state = np.zeros(planes[0].shape, np.uint32)
    nothing = np.ones(planes[0].shape, bool)
    for plane in planes:
        nothing &= plane == 0
        # A multiplicative hash: odd factors, and the high bits folded down, so that neighbors look different.
        state = (state ^ (np.nan_to_num(plane.astype(np.float64)) % 2**32).astype(np.uint32)) * np.uint32(0x9E3779B1)
        state = (state ^ (state >> np.uint32(15))) * np.uint32(0x85EBCA6B)
        state ^= state >> np.uint32(13)
    codes = np.stack([(state >> np.uint32(shift)) & np.uint32(0xFF) for shift in (0, 8, 16)], axis=-1).astype(np.uint8)
    codes = codes // 4 * 3 + 64  # 64 to 253: none as dark as 0
    codes[nothing] = 0
    return codes
