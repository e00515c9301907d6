"""Color maps: the colors that a map, named or listed, gives to numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.arrays import Floats
from ..base.spelling import hint
from ..base.validation import sequence, value_error
from .colors import Rgb, encoded_rgb

MOST_COLORS = 1 << 16


def rgb_of(owner: str, name: str, color: Any) -> Rgb:
    """Return a color that Matplotlib understands, a name, "#rrggbb" or three numbers from 0 to 1, as sRGB numbers. A text
    may also be "R,G,B", linear."""
    from matplotlib import colors

    if isinstance(color, str) and "," in color:
        return encoded_rgb(owner, name, color)
    try:
        red, green, blue = colors.to_rgb(color)
    except (ValueError, TypeError):
        raise value_error(owner, name, "a color such as red, #ff0000 or (1, 0, 0)", color) from None
    return float(red), float(green), float(blue)


def checked_colormap(owner: str, name: str, colormap: Any) -> str | tuple[Rgb, ...]:
    """Return the name of a color map, or its colors from low to high. Raises InputError for an unknown one."""
    if isinstance(colormap, str):
        from matplotlib import colormaps

        if colormap not in colormaps:
            expected = "a color map of Matplotlib, such as viridis, coolwarm or tab10, or a list of colors"
            raise value_error(owner, name, expected, colormap, hint(colormap, tuple(colormaps)))
        return colormap
    listed = sequence(colormap)
    if listed is None or not 1 <= len(listed) <= MOST_COLORS:
        raise value_error(owner, name, f"a name, or 1 to {MOST_COLORS} colors", colormap)
    return tuple(rgb_of(owner, name, color) for color in listed)


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
