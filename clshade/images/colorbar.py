"""A bar of a color map with its values, to the right of an image."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import Bytes
from .colors import Rgb, map_colors

_DPI = 100
_LETTERS = 9.0  # width of the bar, its values and its title, in heights of letters


def _letter(rows: int) -> float:
    """Return the height of letters in pixels."""
    return float(np.clip(rows / 40, 8, 32))


def bar_width(rows: int) -> int:
    """Return by how many pixels the bar widens an image of so many rows."""
    return round(_LETTERS * _letter(rows))


def with_colorbar(
    image: Bytes, colormap: str | tuple[Rgb, ...], ends: tuple[float, float], title: str, ground: Bytes
) -> Bytes:
    """Return an 8-bit image (M, N, 3 or 4) made wider by a bar on a ground of that color, (3,).

    ends: values of the bar's lower and upper end. The image's own pixels stay as they are.
    """
    from . import figures

    rows = len(image)
    letter, width = _letter(rows), bar_width(rows)
    figure = figures.blank(width / _DPI, rows / _DPI, _DPI)
    figure.set_layout_engine("none")
    figure.set_facecolor(tuple(ground / 255.0))
    axes = figure.add_axes((letter / width, 0.06, 1.4 * letter / width, 0.88))
    colors = map_colors(colormap)[1:-1]
    axes.imshow(colors[:, None], aspect="auto", origin="lower", interpolation="nearest", extent=(0, 1, 0, 1))
    ink = "black" if ground @ (0.2126, 0.7152, 0.0722) > 128 else "white"
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.set_yticks(*_ticks(*ends, int(np.clip(rows / (5 * letter), 2, 6))))
    axes.tick_params(colors=ink, labelsize=letter * 72 / _DPI, length=0.3 * letter)
    for spine in axes.spines.values():
        spine.set_color(ink)
    title = figures.plain_text(title)
    size = letter * 72 / _DPI * min(1.0, 1.4 * rows / (letter * max(len(title), 1)))
    figure.text(1.0 - letter / width, 0.5, title, color=ink, rotation=90, ha="center", va="center", fontsize=size)
    figure.canvas.draw()
    bar = np.asarray(figure.canvas.buffer_rgba())[:rows, :width, : image.shape[2]]  # type: ignore[attr-defined]
    return np.concatenate([image, bar], axis=1)


def _ticks(low: float, high: float, count: int) -> tuple[list[float], list[str]]:
    """Return places along the bar, 0 to 1, about `count` of them, and the numbers there: round ones where there are."""
    from matplotlib.ticker import MaxNLocator

    half = 0.5 * high - 0.5 * low  # halves cannot overflow
    if not 1e-300 < half < 1e300:
        return ([0.0, 1.0], [f"{low:g}", f"{high:g}"]) if low < high else ([0.5], [f"{low:g}"])
    ticks = map(float, MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    values = [value for value in ticks if low <= value <= high]
    values = values if len(values) > 1 else [low, high]
    digits = math.log10(max(abs(low), abs(high)) / abs(values[1] - values[0])) if values[1] != values[0] else 4.0
    labels = [f"{value:.{min(max(math.ceil(digits) + 1, 6), 12)}g}" for value in values]
    return [(0.5 * value - 0.5 * low) / half for value in values], labels
