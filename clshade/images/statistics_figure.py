"""Figure of an image: exposures from -4 to +4 stops, a luminance histogram, false colors, and all of its layers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Array
from . import figures
from .image_file import Picture
from .layer_plots import draw_thumbnails, first_few, panel_size, plain_text, show_pixels
from .statistics import luminance, stops_of
from .thumbnails import Thumbnail, thinned, thumbnails
from .tonemap import tonemap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STOPS = tuple(range(-4, 5))
NAN, INFINITE, BLACK = (255, 0, 255), (255, 255, 255), (0, 0, 0)  # false colors of values without stops

_SIDE = 480  # most pixels of the image along the longer side of a panel
_PANEL = 2.1  # inches along the longer side of an exposure; false color is twice as long
_TITLE = 0.3
_WIDTH = 13.0  # inches of the figure
_BINS = 120  # of the histogram, at most
_MIDDLE = (0.1, 99.9)  # percentiles of the lit pixels that false colors span


def draw(picture: Picture, title: str) -> Figure:
    """Draw the figure; without a color layer, the layers alone.

    Of a large image every k-th pixel is shown, so that none is averaged away; the histogram counts all of them.
    """
    pictures = first_few(thumbnails(picture.channels, encoded=bool(picture.bits)))
    columns = min(len(pictures), 6)
    rows = math.ceil(len(pictures) / columns)
    panel = _WIDTH / max(columns, 4)
    height = rows * (panel_size(picture.shape, panel)[1] + 2 * _TITLE)
    color = picture.color()
    if color is None:
        figure = _blank(height, title)
        draw_thumbnails(figure, pictures, columns)
        return figure
    upper = 3 * (panel_size(picture.shape, _PANEL)[1] + _TITLE)
    figure = _blank(upper + height, title)
    top, bottom = _parts(figure, 2, 1, height_ratios=[upper, height])
    left, right = _parts(top, 1, 2, width_ratios=[3, 2.6])
    _draw_ladder(left, thinned(color[1], _SIDE))
    _draw_luminance(right, color[1])
    draw_thumbnails(bottom, pictures, columns)
    return figure


def _parts(figure: Any, rows: int, columns: int, **ratios: Any) -> list[Any]:
    return list(figure.subfigures(rows, columns, squeeze=False, **ratios).reshape(-1))


def _blank(height: float, title: str) -> Figure:
    figure = figures.blank(_WIDTH, height + _TITLE, dpi=100)
    figure.suptitle(plain_text(title), fontsize=10)
    return figure


def _draw_ladder(figure: Any, color: Array) -> None:
    """Draw nine exposures of linear (M, N, 3), tone map `srgb`."""
    for axes, stops in zip(figure.subplots(3, 3).reshape(-1), STOPS, strict=True):
        show_pixels(
            axes,
            tonemap(color, "srgb", stops),
            f"{stops:+d} stop{'' if abs(stops) == 1 else 's'}" if stops else "as it is",
        )


def _draw_luminance(figure: Any, color: Array) -> None:
    """Draw false colors and a histogram of linear (M, N, 3), on one scale of stops."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    above, below = figure.subplots(2, 1, height_ratios=[2, 1])
    stops = stops_of(color)
    low, high = _limits(stops)
    colored = false_colors(luminance(thinned(color, _SIDE)), low, high)
    show_pixels(above, colored.pixels, f"luminance, {colored.note}")
    scale = ScalarMappable(Normalize(low, high), "turbo")
    figure.colorbar(scale, ax=above, label="stops, 0 is 1.0")
    _draw_histogram(below, stops, color.shape[0] * color.shape[1])


def _limits(stops: Array) -> tuple[float, float]:
    """Return the range of false colors, in whole stops."""
    if not stops.size:
        return -1.0, 1.0
    low, high = np.percentile(stops, _MIDDLE)
    low, high = math.floor(low), math.ceil(high)
    return low, max(high, low + 1.0)


def false_colors(values: Array, low: float, high: float) -> Thumbnail:
    """Map luminances (M, N) by stops from blue at `low` to red at `high`; those without stops get their own colors."""
    from matplotlib import colormaps

    lit = np.isfinite(values) & (values > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.where(lit, (np.log2(np.where(lit, values, 1.0)) - low) / (high - low), 0.0)
    pixels = np.rint(255.0 * colormaps["turbo"](np.clip(place, 0.0, 1.0))[..., :3]).astype(np.uint8)
    pixels[values <= 0.0] = BLACK
    pixels[np.isinf(values)] = INFINITE
    pixels[np.isnan(values)] = NAN
    return Thumbnail(pixels, "black: 0 or less, magenta: NaN, white: infinite")


def _draw_histogram(axes: Any, stops: Array, pixels: int) -> None:
    """Draw a luminance histogram: bins of a power of two of a stop, the smallest that give at most _BINS."""
    axes.set_xlabel("luminance in stops, 0 is 1.0", fontsize=8)
    axes.set_ylabel("% of pixels", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_title(f"{len(stops) / pixels:.1%} of the pixels are above 0 and finite", fontsize=8)
    if not stops.size:
        return
    width = 0.125
    while (stops.max() - stops.min()) / width > _BINS:
        width *= 2.0
    first = math.floor(stops.min() / width)
    counts = np.bincount((np.floor(stops / width) - first).astype(np.int64))
    axes.bar((first + np.arange(len(counts))) * width, 100.0 * counts / pixels, width, align="edge", color="#1f5fa8")
    axes.set_yscale("log")
