"""Tone curves that move the three channels of a color together, float64, and their inverses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..base.arrays import Array, Floats

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


def neutral(x: Array) -> Floats:
    """Map linear colors, (..., 3), non-negative, to [0, 1] by Khronos PBR Neutral."""
    red, green, blue = channels = np.moveaxis(
        x, -1, 0
    )  # the channels' maximum is faster than one along an axis of three
    least = np.minimum(np.minimum(red, green), blue)
    colors: Floats = channels - np.where(least <= 2.0 * _F90, least - least**2 / (4.0 * _F90), _F90)
    peak = np.maximum(np.maximum(colors[0], colors[1]), colors[2])
    some = peak > _START
    high = peak[some]
    mapped = 1.0 - (1.0 - _START) ** 2 / (high + 1.0 - 2.0 * _START)
    kept = 1.0 / (_DESATURATION * (high - mapped) + 1.0)
    colors[:, some] = colors[:, some] * (mapped / high * kept) + mapped * (1.0 - kept)
    return np.moveaxis(colors, 0, -1)


def neutral_inverse(y: Array) -> Floats:
    """Return the linear colors that `neutral` maps to `y`, (..., 3), in [0, 1): exact but for rounding."""
    mapped = y.max(axis=-1, keepdims=True)
    high = np.maximum(mapped, _START)
    peak = (1.0 - _START) ** 2 / (1.0 - high) - 1.0 + 2.0 * _START
    kept = 1.0 / (_DESATURATION * (peak - high) + 1.0)
    colors = np.where(mapped <= _START, y, (y - high * (1.0 - kept)) * (peak / (high * kept)))
    least = np.maximum(colors.min(axis=-1, keepdims=True), 0.0)
    x: Floats = colors + np.where(least <= _F90, np.sqrt(4.0 * _F90 * least) - least, _F90)
    return x


def _toe_and_shoulder(away: Array, scale: float, sign: float) -> Floats:
    """Return away * scale * (1 + sign * bend * |away|^p)^(-1/p), p and bend those of the toe where away < 0, else of the
    shoulder. With scale _SLOPE and sign 1 it is the curve of AgX, about its pivot, and with 1/_SLOPE and -1 its inverse.
    """
    curve = np.empty(away.shape)
    for some, length, power in ((away < 0.0, _PIVOT, _TOE), (away >= 0.0, 1.0 - _PIVOT, _SHOULDER)):
        bend = ((2.0 * _SLOPE * length) ** power - 1.0) / length**power  # so that the curve reaches 0 or 1 at its end
        if sign < 0.0:
            bend /= _SLOPE**power
        part = away[some]
        curve[some] = part * scale * (1.0 + sign * bend * np.abs(part) ** power) ** (-1.0 / power)
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


# Operator: the curve, and its inverse. What remains for each channel is in `tonemap`.
JOINT: dict[str, tuple[Callable[[Array], Floats], Callable[[Array], Floats]]] = {
    "neutral": (neutral, neutral_inverse),
    "agx": (agx, agx_inverse),
}
