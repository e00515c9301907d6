"""Tone maps in float64, written as the formulas read. See `clshade.images.tonemap` for their sources."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Bytes, Floats, Reals


def _operate(x: Floats, operator: str) -> Floats:
    if operator in ("none", "srgb"):
        return x
    if operator == "reinhard":
        return x / (x + 1)
    if operator == "hable":

        def curve(t: Floats | float) -> Floats:
            shoulder, linear, angle, toe, toe_top, toe_bottom = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
            top = t * (shoulder * t + angle * linear) + toe * toe_top
            bottom = t * (shoulder * t + linear) + toe * toe_bottom
            return np.asarray(top / bottom - toe_top / toe_bottom)

        return curve(2.0 * x) / curve(11.2)
    if operator == "aces":
        return (2.51 * x**2 + 0.03 * x) / (2.43 * x**2 + 0.59 * x + 0.14)
    raise ValueError(operator)


def tonemap(rgb: Reals, operator: str = "srgb", exposure: float = 0.0) -> Bytes:
    """Return codes 0..255 (uint8) of linear values of any shape; +infinity is 255, NaN and negative values are 0."""
    value = np.asarray(rgb, np.float64)
    ordinary = np.isfinite(value) & (value > 0)
    x = np.where(ordinary, value, 0.0) * 2.0**exposure

    y = _operate(x, operator)
    y = np.minimum(np.maximum(y, 0.0), 1.0)

    if operator != "none":
        y = np.where(y <= 0.0031308, y * 12.92, 1.055 * y ** (1 / 2.4) - 0.055)

    code = np.floor(y * 255 + 0.5)
    code = np.where(ordinary, code, 0)
    code = np.where(value == np.inf, 255, code)
    codes: Bytes = code.astype(np.uint8)
    return codes
