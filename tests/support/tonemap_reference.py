"""Tone maps in float64, written as the formulas read. See `clshade.images.tonemap` for their sources."""

import numpy as np

from clshade.base.arrays import Bytes, Floats, Reals


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
            return top / bottom - toe_top / toe_bottom

        return curve(2.0 * x) / curve(11.2)
    if operator == "aces":
        return (2.51 * x**2 + 0.03 * x) / (2.43 * x**2 + 0.59 * x + 0.14)
    if operator == "neutral":
        return np.apply_along_axis(_neutral, -1, x)
    if operator == "agx":
        return _agx(x)
    raise ValueError(operator)


def _neutral(color: Floats) -> Floats:
    """Map one color, (3,), as Khronos's specification of PBR Neutral reads."""
    x = float(color.min())
    f = x - x**2 / (4 * 0.04) if x <= 2 * 0.04 else 0.04
    p, start = (color - f).max(), 0.76
    out = color - f
    if p > start:
        p_n = 1 - (1 - start) ** 2 / (p + 1 - 2 * start)
        g = 1 / (0.15 * (p - p_n) + 1)
        out = out * p_n / p * g + p_n * (1 - g)
    return out


def _agx(x: Floats) -> Floats:
    """Map colors, (..., 3): log2 of the colors in inset primaries, a sigmoid of two powers, the inset undone."""
    white = np.array([0.3127, 0.3290])
    rec709 = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
    inset = np.linalg.inv(_to_xyz(rec709, white)) @ _to_xyz(white + 0.8 * (rec709 - white), white)
    encoded = np.clip((np.log2(np.maximum(x @ inset.T, 1e-30) / 0.18) + 10) / 16.5, 0, 1)
    pivot = 10 / 16.5

    def curve(t: float) -> float:
        power, length = (3.0, pivot) if t < pivot else (3.25, 1 - pivot)
        scale = ((2 * length) ** -power * ((2 * length / 0.5) ** power - 1)) ** (-1 / power)
        u = 2 * abs(t - pivot) / scale
        return float(0.5 + np.sign(t - pivot) * scale * u / (1 + u**power) ** (1 / power))

    y = np.vectorize(curve, otypes=[float])(encoded) @ np.linalg.inv(inset).T
    return np.clip(y, 0, 1) ** 2.2


def _to_xyz(primaries: Floats, white: Floats) -> Floats:
    """Return the matrix, (3, 3), from linear RGB to XYZ, for chromaticities x, y and a white of Y = 1."""
    *columns, target = (np.array([x / y, 1.0, (1 - x - y) / y]) for x, y in (*primaries, white))
    matrix = np.stack(columns, axis=1)
    return matrix * np.linalg.solve(matrix, target)


def tonemap(rgb: Reals, operator: str = "srgb", exposure: float = 0.0) -> Bytes:
    """Return codes 0..255 (uint8) of linear values, (..., 3) if the operator mixes channels, else of any shape.

    +infinity is 255, NaN is 0; negative values are 0, before an operator that mixes channels.
    """
    value = np.asarray(rgb, np.float64)
    joint = operator in ("neutral", "agx")
    ordinary = np.isfinite(value) & (value > 0)
    with np.errstate(over="ignore"):
        x = np.where(ordinary, value, 0.0) * 2.0**exposure
    if joint:
        x = np.minimum(np.where(value == np.inf, np.inf, x), 1e30)
    y = np.clip(_operate(x, operator), 0.0, 1.0)
    if operator != "none":
        y = np.where(y <= 0.0031308, y * 12.92, 1.055 * y ** (1 / 2.4) - 0.055)
    code = np.floor(y * 255 + 0.5)
    code = np.where(np.isnan(value) | ~(ordinary | joint), 0, code)
    return np.where(value == np.inf, 255, code).astype(np.uint8)
