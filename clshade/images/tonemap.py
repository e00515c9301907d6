"""Tone mapping: linear HDR radiance to the 8-bit codes of a display image, exactly rounded and fast.

Most operators act on each channel independently and are nondecreasing, so the 8-bit code is a step function of the
input, described by 255 thresholds. They are computed once per (operator, exposure) by bisection over the bit patterns of
floats with the float64 formula; each pixel then needs one table lookup and gets exactly the formula's code. Operators
that mix channels (JOINT) are evaluated in float64; only what follows, channel by channel, is a table.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Bytes, Floats, Reals
from ..base.validation import choice
from ..errors import InputError

Operator: TypeAlias = Literal["none", "srgb", "reinhard", "hable", "aces", "neutral", "agx"]
OPERATORS: tuple[Operator, ...] = get_args(Operator)
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
MAX_EXPOSURE = 300.0  # stops; all of float32, denormals included, lies within 277 stops of 1

_LIGHT, _DARK = 204, 153  # codes of a checkerboard, as image editors draw it
_SQUARE = 8  # pixels
_TABLE_EXPOSURE = 100.0  # stops; beyond, thresholds approach the denormals, where table entries are too coarse
_SATURATED = 1e30  # every operator reaches its last code far below; keeps squares finite
_LOW_BITS = 15  # a table entry covers the float32 values that differ only in their last 15 bits
_BLOCK = 1 << 15  # values per pass, so that the buffers stay in the cache

# Khronos PBR Neutral: Fresnel reflection at normal incidence, where compression starts, speed of desaturation.
_F90, _START, _DESATURATION = 0.04, 0.8 - 0.04, 0.15

# AgX: stops below and above middle grey, slope of the curve there, its powers towards black and white.
_GREY, _BELOW, _ABOVE = 0.18, 10.0, 6.5
_SLOPE, _TOE, _SHOULDER = 2.0, 3.0, 3.25
_PIVOT = _BELOW / (_BELOW + _ABOVE)
_PRIMARIES = np.array([[0.64, 0.30, 0.15], [0.33, 0.60, 0.06], [0.03, 0.10, 0.79]])  # Rec. 709: columns x, y, z
_WHITE = np.array([0.3127, 0.3290, 0.3583])  # D65
_RANGE = 0.8  # of the inset primaries' distances from white, those of Rec. 709 being 1

# The inset primaries' colors in Rec. 709: each row of the second term is the primaries' shares of white's X + Y + Z.
_INSET = _RANGE * np.eye(3) + (1.0 - _RANGE) * np.linalg.solve(_PRIMARIES, _WHITE)
_OUTSET = np.linalg.inv(_INSET)


def srgb_curve(linear: Array) -> Array:
    """Encode linear values in [0, 1] with the exact sRGB transfer curve of IEC 61966-2-1, float64."""
    linear = np.asarray(linear, np.float64)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1.0 / 2.4) - 0.055)


def neutral(x: Array) -> Floats:
    """Map linear colors, (..., 3), non-negative, to [0, 1] by Khronos PBR Neutral."""
    # The channels' maximum is faster than one along an axis of three.
    red, green, blue = channels = np.moveaxis(x, -1, 0)
    low = np.minimum(np.minimum(red, green), blue)
    colors: Floats = channels - np.where(low <= 2.0 * _F90, low - low**2 / (4.0 * _F90), _F90)
    peak = np.maximum(np.maximum(colors[0], colors[1]), colors[2])
    bright = peak > _START
    high = peak[bright]
    mapped = 1.0 - (1.0 - _START) ** 2 / (high + 1.0 - 2.0 * _START)
    saturation = 1.0 / (_DESATURATION * (high - mapped) + 1.0)
    colors[:, bright] = colors[:, bright] * (mapped / high * saturation) + mapped * (1.0 - saturation)
    return np.moveaxis(colors, 0, -1)


def neutral_inverse(y: Array) -> Floats:
    """Return the linear colors that `neutral` maps to `y`, (..., 3), in [0, 1): exact but for rounding."""
    mapped = y.max(axis=-1, keepdims=True)
    high = np.maximum(mapped, _START)
    peak = (1.0 - _START) ** 2 / (1.0 - high) - 1.0 + 2.0 * _START
    saturation = 1.0 / (_DESATURATION * (peak - high) + 1.0)
    colors = np.where(mapped <= _START, y, (y - high * (1.0 - saturation)) * (peak / (high * saturation)))
    low = np.maximum(colors.min(axis=-1, keepdims=True), 0.0)
    x: Floats = colors + np.where(low <= _F90, np.sqrt(4.0 * _F90 * low) - low, _F90)
    return x


def _toe_and_shoulder(away: Array, scale: float, sign: float) -> Floats:
    """Return away * scale * (1 + sign * bend * |away|^p)^(-1/p), p and bend those of the toe where away < 0, else of the
    shoulder. With scale _SLOPE and sign 1 it is the curve of AgX, about its pivot, and with 1/_SLOPE and -1 its inverse.
    """
    curve = np.empty(away.shape)
    for branch, length, power in ((away < 0.0, _PIVOT, _TOE), (away >= 0.0, 1.0 - _PIVOT, _SHOULDER)):
        bend = ((2.0 * _SLOPE * length) ** power - 1.0) / length**power  # so that the curve reaches 0 or 1 at its end
        if sign < 0.0:
            bend /= _SLOPE**power
        part = away[branch]
        curve[branch] = part * scale * (1.0 + sign * bend * np.abs(part) ** power) ** (-1.0 / power)
    return curve


def agx(x: Array) -> Floats:
    """Map linear colors, (..., 3), non-negative, by AgX without a look, to about [0, 1], encoded for a display of
    exponent 2.2.
    """
    inset = np.maximum(x @ _INSET.T, _GREY * 2.0**-_BELOW)
    stops = np.minimum(np.log2(inset / _GREY), _ABOVE)
    y: Floats = (_toe_and_shoulder(stops / (_BELOW + _ABOVE), _SLOPE, 1.0) + 0.5) @ _OUTSET.T
    return y


def agx_inverse(y: Array) -> Floats:
    """Return non-negative linear colors that `agx` maps to `y`, (..., 3), or near it where there are none."""
    curved = np.clip(y @ _INSET.T, 0.0, 1.0)
    stops = _toe_and_shoulder(curved - 0.5, 1.0 / _SLOPE, -1.0) * (_BELOW + _ABOVE)
    x: Floats = np.maximum((_GREY * 2.0**stops) @ _OUTSET.T, 0.0)
    return x


# Operator: the curve, and its inverse. What remains for each channel is in _CURVES.
JOINT: dict[str, tuple[Callable[[Array], Floats], Callable[[Array], Floats]]] = {
    "neutral": (neutral, neutral_inverse),
    "agx": (agx, agx_inverse),
}


def _hable(x: Array) -> Array:
    # Shoulder strength, linear strength, linear angle, toe strength, toe numerator, toe denominator.
    a, b, c, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
    return (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f


_CURVES: dict[str, Callable[[Array], Array]] = {  # of those without one, the identity
    "reinhard": lambda x: x / (1.0 + x),
    "hable": lambda x: _hable(2.0 * x) / _hable(np.array(11.2)),
    "aces": lambda x: (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14),
    "agx": lambda x: np.minimum(x, 1.0) ** 2.2,
}


def _exposed(values: Array, exposure: float) -> Floats:
    """Return non-negative float64 values at an exposure, +infinity replaced by a value that is white in every operator."""
    with np.errstate(over="ignore", under="ignore"):
        x: Floats = np.minimum(values * 2.0**exposure, _SATURATED)
    return x


def _encoded(x: Array, operator: str) -> Array:
    """Evaluate the curve of a single channel: 0 to 1."""
    y = np.clip(_CURVES[operator](x) if operator in _CURVES else x, 0.0, 1.0)
    return y if operator == "none" else srgb_curve(y)


def _thresholds(operator: str, exposure: float, dtype: type) -> Array:
    """Return bit patterns, int64 (255,), of the smallest `dtype` values whose codes are at least 1, 2, ... 255."""
    integer: type = np.int32 if dtype is np.float32 else np.int64
    # Bit patterns of non-negative floats are ordered like the floats. Zero has code 0, infinity 255: they bracket all.
    low = np.zeros(255, np.int64)
    high = np.full(255, np.array(np.inf, dtype).view(integer), np.int64)
    while (high - low > 1).any():
        middle = low + (high - low) // 2
        values = middle.astype(integer).view(dtype).astype(np.float64)
        reached = np.floor(255.0 * _encoded(_exposed(values, exposure), operator) + 0.5) >= np.arange(1, 256)
        high = np.where(reached, middle, high)
        low = np.where(reached, low, middle)
    return high


@functools.lru_cache(maxsize=32)
def _table(operator: str, exposure: float) -> Array:
    """Return uint32 (2^17,), indexed by the upper 17 bits of a float32; adding the lower 15 carries into the code.

    Neighboring thresholds are at least 1/254.5 apart, relative to their size (operator `none`; the others' are wider
    apart), and an entry of normal floats covers at most 1/256 of its values' size: so no entry holds two thresholds.
    An entry is (code at its start) * 2^15, plus what makes the sum carry from the threshold on, if it holds one.
    """
    size = 1 << _LOW_BITS
    thresholds = _thresholds(operator, exposure, np.float32)
    entries = 1 << (32 - _LOW_BITS)
    infinity = 0x7F800000 >> _LOW_BITS
    starts = np.arange(infinity, dtype=np.int64) * size
    table = np.zeros(entries, np.uint32)  # stays 0 for NaN, and for negative values, whose top bit is set
    table[:infinity] = np.searchsorted(thresholds, starts, side="right") * size
    inside = thresholds[(thresholds % size != 0) & (thresholds < infinity * size)]
    owners = inside // size
    if (np.diff(owners) == 0).any():
        raise AssertionError("tone map: two thresholds in one table entry")
    table[owners] += (size - inside % size).astype(np.uint32)
    # Infinity (last bits 0) gets 255; the NaNs beside it carry to 256, which is 0 in eight bits.
    table[infinity] = 255 * size + (size - 1)
    table.flags.writeable = False
    return table


@functools.lru_cache(maxsize=32)
def _thresholds64(operator: str, exposure: float) -> Array:
    return _thresholds(operator, exposure, np.float64).view(np.float64)


def _map32(values: Array, codes: Array, table: Array) -> None:
    bits = values.view(np.uint32)
    entry = np.empty(_BLOCK, np.intp)
    sums, low = np.empty(_BLOCK, np.uint32), np.empty(_BLOCK, np.uint32)
    for start in range(0, len(bits), _BLOCK):
        block = bits[start : start + _BLOCK]
        n = len(block)
        np.right_shift(block, np.uint32(_LOW_BITS), out=entry[:n], casting="unsafe")
        np.take(table, entry[:n], out=sums[:n], mode="clip")
        np.bitwise_and(block, np.uint32((1 << _LOW_BITS) - 1), out=low[:n])
        np.add(sums[:n], low[:n], out=sums[:n])
        np.right_shift(sums[:n], np.uint32(_LOW_BITS), out=sums[:n])
        codes[start : start + n] = sums[:n]  # keeps the low eight bits


@functools.lru_cache(maxsize=32)
def _buckets(operator: str) -> tuple[Array, Array]:
    """Return for each multiple of 1/4096 from 0 to 1 its code, uint8, and the next threshold, float64: thresholds are
    further apart than that."""
    thresholds = _thresholds64(operator, 0.0)
    codes = np.searchsorted(thresholds, np.arange(4097) / 4096.0, side="right")
    if (np.diff(codes) > 1).any():
        raise AssertionError("tone map: two thresholds in one bucket")
    return codes.astype(np.uint8), np.append(thresholds, np.inf)[codes]


def _map_joint(rgb: Array, codes: Array, operator: str, stops: float) -> None:
    forward, (starts, thresholds) = JOINT[operator][0], _buckets(operator)
    for start in range(0, len(rgb), _BLOCK):
        # Curves take one channel after the other.
        block = np.array(rgb[start : start + _BLOCK].T, np.float64, order="C").T
        x = _exposed(np.where(block > 0.0, block, 0.0), stops)  # NaN is not above 0
        y = np.clip(forward(x), 0.0, 1.0)
        bucket = (y * 4096.0).astype(np.intp)
        codes[start : start + _BLOCK] = np.where(np.isnan(block), 0, starts[bucket] + (y >= thresholds[bucket]))


def checked(operator: str, exposure: float) -> float:
    """Return the exposure in stops. Raises InputError for an operator or exposure that `tonemap` refuses."""
    choice("tonemap", "operator", operator, OPERATORS)
    try:
        stops = float(exposure)
    except (TypeError, ValueError, OverflowError):
        stops = math.nan
    if not abs(stops) <= MAX_EXPOSURE:
        raise InputError(f"tonemap: exposure: expected stops from -300 to 300, found {exposure!r}")
    return stops


def tonemap(rgb: ArrayLike, operator: Operator = "srgb", exposure: float = 0.0) -> Bytes:
    """Convert a linear image to an 8-bit display image.

    rgb: (M, N, 3), linear radiance, any floats (float32 is the fast case; float64 is not rounded to float32 first).
    operator: y of x = rgb * 2^exposure, channel by channel:
        `none`      y = x, and no sRGB curve after it
        `srgb`      y = x
        `reinhard`  y = x / (1 + x). Reinhard et al., "Photographic Tone Reproduction for Digital Images", SIGGRAPH
                    2002, equation 3, on each channel instead of the luminance.
        `hable`     y = h(2x) / h(11.2), h(t) = (t(At + CB) + DE) / (t(At + B) + DF) - E/F with A..F = 0.15, 0.50,
                    0.10, 0.20, 0.02, 0.30. J. Hable, "Filmic Tonemapping Operators", filmicworlds.com, 2010.
        `aces`      y = x(2.51x + 0.03) / (x(2.43x + 0.59) + 0.14). K. Narkowicz, "ACES Filmic Tone Mapping Curve",
                    2016: a fit, without its optional factor 0.6.
      or of the three channels together, whose highlights fade to white instead of changing their hue:
        `neutral`   Khronos PBR Neutral, 2024: base colors under white light keep their values, up to 0.8.
        `agx`       T. Sobotka's AgX, 2022, without a look: 10 stops below middle grey to 6.5 above; the curve's own
                    formula, with the outset of B. Wrensch, "Minimal AgX Implementation", 2024, and exponent 2.2.
      y is then clamped to [0, 1] and, except for `none`, encoded by the exact sRGB curve (IEC 61966-2-1).
    exposure: stops, -300 to 300; +1 doubles the radiance. Applied before the operator.

    Returns uint8 (M, N, 3), floor(255 * encoded + 0.5): to the nearest code, halves up, never off by one against the
    formula in float64 (for float64 values and for `neutral` and `agx`: unless within the formula's own rounding, 1e-13,
    of a step). NaN gives 0, +infinity 255. Negative values give 0; the operators of three channels together count
    them, and NaN, as 0. Row order is kept.
    Raises InputError for another shape, type, operator or exposure.
    """
    rgb = np.asarray(rgb)
    stops = checked(operator, exposure)
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype not in (np.float16, np.float32, np.float64):
        raise InputError(
            f"tonemap: rgb: expected floats of shape (M, N, 3), found shape {rgb.shape} and type {rgb.dtype}"
        )
    return mapped(rgb, operator, stops)


def mapped(values: Array, operator: Operator, exposure: float) -> Bytes:
    """Return `tonemap` of floats, (..., 3) if the operator is in JOINT, else of any shape; arguments are checked already."""
    codes = np.empty(values.shape, np.uint8)
    if operator in JOINT:
        _map_joint(values.reshape(-1, 3), codes.reshape(-1, 3), operator, exposure)
        return codes
    exact = values.dtype == np.float64 or abs(exposure) > _TABLE_EXPOSURE
    with np.errstate(invalid="ignore"):  # a signaling NaN
        flat = np.ascontiguousarray(values, dtype=np.float64 if exact else np.float32).reshape(-1)
    if not exact:
        _map32(flat, codes.reshape(-1), _table(operator, exposure))
        return codes
    for start in range(0, len(flat), _BLOCK):
        block = flat[start : start + _BLOCK]
        steps = np.searchsorted(_thresholds64(operator, exposure), block, side="right")
        codes.reshape(-1)[start : start + _BLOCK] = np.where(np.isnan(block), 0, steps)
    return codes


def display_values(rgb: ArrayLike, operator: Operator = "srgb", exposure: float = 0.0) -> Floats:
    """Return what `tonemap` rounds to 8 bits: float64 of the same shape, 0 to 1, for outputs of more bits.

    NaN gives 0, negative values count as 0. Raises InputError for an operator or exposure that `tonemap` refuses.
    """
    stops = checked(operator, exposure)
    values = np.asarray(rgb, np.float64)
    x = _exposed(np.where(values > 0.0, values, 0.0), stops)
    encoded = _encoded(JOINT[operator][0](x) if operator in JOINT else x, operator)
    return np.where(np.isnan(values), 0.0, encoded)


def radiance(codes: Array, operator: Operator = "srgb", exposure: float = 0.0) -> Floats:
    """Invert `tonemap`: codes uint8 (..., 3) to float64 of that shape.

    The middle of the values that have the code; for 255 the smallest, as everything brighter has it too.
    """
    stops = checked(operator, exposure)
    edges = np.concatenate([[0.0], _thresholds64(operator, 0.0 if operator in JOINT else stops), [0.0]])
    edges[-1] = edges[-2]
    if operator in JOINT:  # its inverse rounds
        edges[-2:] *= 1.0 + 1e-9
    values: Floats = ((edges[:-1] + edges[1:]) / 2.0)[codes]
    if operator in JOINT:
        with np.errstate(over="ignore"):
            values = JOINT[operator][1](values) * 2.0**-stops
    return values


# Images over nothing: straight alpha from premultiplied colors, and what shows through.


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
