"""Colors as people write them, and color maps: the colors that a map, named or listed, gives to numbers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..base.arrays import Floats
from ..base.spelling import hint
from ..base.validation import sequence, value_error
from .decode import srgb_to_linear

Rgb = tuple[float, float, float]

FORMS = "a name such as white, #rrggbb (sRGB), or three linear numbers R,G,B from 0 on"
MAX_COLORS = 1 << 16
_MAX_VALUE = float(np.finfo(np.float32).max)


def linear_rgb(owner: str, name: str, color: Any) -> Rgb:
    """Return a color as linear RGB.

    color: three linear numbers from 0 to what float32 can hold; or text: such numbers with commas between them, `#rrggbb`
    or `#rgb`, whose codes are decoded from sRGB, or one of Matplotlib's names, which stand for such codes.
    Raises InputError for anything else.
    """
    if not isinstance(color, str):
        return _numbers(owner, name, color, sequence(color) or ())
    rgb, encoded = _parsed(owner, name, color)
    return _as_rgb(srgb_to_linear(np.array(rgb))) if encoded else rgb


def encoded_rgb(owner: str, name: str, color: Any) -> Rgb:
    """Return a color as sRGB-encoded numbers from 0 to 1.

    color: one that Matplotlib understands: a name, "#rrggbb" or three numbers from 0 to 1; or the text "R,G,B", linear.
    Raises InputError for anything else.
    """
    from matplotlib import colors

    if isinstance(color, str) and "," in color:
        rgb, _ = _parsed(owner, name, color)
        if max(rgb) > 1.0:
            raise value_error(owner, name, "three linear numbers R,G,B from 0 to 1", color)
        from .tonemap import srgb_curve

        return _as_rgb(srgb_curve(np.array(rgb)))
    try:
        return _as_rgb(colors.to_rgb(color))
    except (ValueError, TypeError):
        raise value_error(owner, name, "a color such as red, #ff0000 or (1, 0, 0)", color) from None


def checked_colormap(owner: str, name: str, colormap: Any) -> str | tuple[Rgb, ...]:
    """Return the name of a color map, or its sRGB-encoded colors from low to high. Raises InputError for an unknown one."""
    if isinstance(colormap, str):
        from matplotlib import colormaps

        if colormap not in colormaps:
            expected = "a color map of Matplotlib, such as viridis, coolwarm or tab10, or a list of colors"
            raise value_error(owner, name, expected, colormap, hint(colormap, tuple(colormaps)))
        return colormap
    listed = sequence(colormap)
    if listed is None or not 1 <= len(listed) <= MAX_COLORS:
        raise value_error(owner, name, f"a name, or 1 to {MAX_COLORS} colors", colormap)
    return tuple(encoded_rgb(owner, name, color) for color in listed)


def map_colors(colormap: str | tuple[Rgb, ...]) -> Floats:
    """Return the colors of a map, sRGB, (N + 2, 3): below its range, N from low to high, and above.

    Matplotlib's own table: 256 colors for most maps, as many as there are for qualitative ones.
    """
    if isinstance(colormap, str):
        from matplotlib import colormaps

        named = colormaps[colormap]
        table: Floats = np.asarray(named(np.arange(-1, named.N + 1)), np.float64)[:, :3]
        return table
    return np.array([colormap[0], *colormap, colormap[-1]], np.float64)


def _parsed(owner: str, name: str, text: str) -> tuple[Rgb, bool]:
    """Return the color that a text means, and whether it is sRGB-encoded rather than linear."""
    word = text.strip()
    if "," in word:
        return _numbers(owner, name, text, word.split(",")), False
    codes = re.fullmatch("#([0-9a-fA-F]{6}|[0-9a-fA-F]{3})", word)
    if codes:
        digits = codes[1] if len(codes[1]) == 6 else "".join(2 * digit for digit in codes[1])
        return _as_rgb(int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)), True
    from matplotlib import colors

    names = colors.get_named_colors_mapping()
    if word.lower() not in names:
        raise value_error(owner, name, FORMS, text, hint(word.lower(), tuple(colors.CSS4_COLORS)))
    return _as_rgb(colors.to_rgb(names[word.lower()])), True


def _numbers(owner: str, name: str, color: Any, values: Any) -> Rgb:
    """Return three numbers. Raises InputError, which shows the color."""
    try:
        rgb = _as_rgb(values)
    except (TypeError, ValueError):
        rgb = (-1.0, -1.0, -1.0)
    if not all(0.0 <= value <= _MAX_VALUE for value in rgb):
        raise value_error(owner, name, FORMS, color)
    return rgb


def _as_rgb(values: Any) -> Rgb:
    red, green, blue = (float(value) for value in values)
    return red, green, blue
