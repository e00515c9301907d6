"""Colors of scalars: interpolated at the pixel, then looked up in a color map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Scene, Settings
from ..scene.scalar_colors import ColorMap, color_map_of
from .corners import Corners, interpolated

# Of the largest position at a face's corners, in units of 2^-24 (2^-53 in float64): how far an interpolated position may
# be off. The weights of two corners are off by 2 * 17 units together, and count for differences of positions, up to twice
# the largest; positions and their differences are rounded, 3, and two fma: 2 * 34 + 3 + 2 = 73, and 3 for the oracle's own.
POSITION_UNITS = 76.0


@dataclass(frozen=True, eq=False)
class MapColors:
    """Colors of pixels by scalars, (K, 3) each: color, 1 where no scalars color the face; most: the largest magnitude of
    the colors that rounding may give; spread: the largest difference of those from the color."""

    color: Floats
    most: Floats
    spread: Floats


def scaled(color_map: ColorMap, scalars: Floats) -> tuple[Floats, Floats]:
    """Return scalars (K, 3) less the map's low end, and the map's width (K,): each row divided by a power of two, so that
    no difference overflows."""
    ends = np.array([color_map.low, color_map.high])
    most = np.maximum(np.abs(np.nan_to_num(scalars)).max(axis=1), np.abs(ends).max())
    exponent = -np.frexp(most)[1] - 1
    low, high = np.ldexp(ends[0], exponent), np.ldexp(ends[1], exponent)
    return np.ldexp(scalars, exponent[:, None]) - low[:, None], high - low


def rows_of(color_map: ColorMap, above_low: Floats, width: Floats) -> Integers:
    """Return the rows of the map's table for numbers given as their distances above its low end, (K,), NaN included."""
    count = color_map.count
    inside = (above_low >= 0.0) & (above_low <= width)
    # The product first: where the quotient is a whole number, it is exact.
    position = np.divide(above_low * count, width, out=np.zeros_like(above_low), where=inside & (width > 0.0))
    row = np.minimum(np.floor(position), count - 1).astype(np.int64) + 1
    row = np.where(above_low < 0.0, 0, row)
    row = np.where(above_low > width, count + 1, row)
    return np.where(np.isnan(above_low), count + 2, row)


def map_colors(
    scene: Scene, settings: Settings, corners: Corners, face: Integers, weights: Floats, unit: Floats
) -> MapColors:
    """Return the colors of pixels on faces `face` (K,) at corner weights (K, 3). unit: (K,) the relative size of a rounding
    of a weight."""
    color = np.ones((len(face), 3))
    found = MapColors(color, color.copy(), np.zeros_like(color))
    if settings.scalars is None:
        return found
    color_map = color_map_of(scene, settings.scalars)
    mapped = np.flatnonzero(mapped_faces(scene, settings, corners, face))
    apart, width = scaled(color_map, corners.scalars[face[mapped]])
    above_low = interpolated(weights[mapped], apart[..., None])[:, 0]
    slack = POSITION_UNITS * unit[mapped] * np.abs(apart).max(axis=1)
    table = color_map.table.astype(np.float64)
    row = rows_of(color_map, above_low, width)
    first, last = (rows_of(color_map, above_low + side * slack, width) for side in (-1.0, 1.0))
    color[mapped] = table[row]
    most, spread = np.abs(table[row]), np.zeros((len(row), 3))
    for step in range(int((last - first).max(initial=0)) + 1):
        other = table[np.minimum(first + step, last)]
        most = np.maximum(most, np.abs(other))
        spread = np.maximum(spread, np.abs(other - table[row]))
    found.most[mapped], found.spread[mapped] = most, spread
    return found


def mapped_faces(scene: Scene, settings: Settings, corners: Corners, face: Integers) -> Bools:
    """Return which of the faces (K,) scalars color."""
    shown = [settings.scalars is not None and settings.scalars.name in mesh.scalars for mesh in scene.meshes]
    return np.array(shown, bool)[corners.mesh[face]]
