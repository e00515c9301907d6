"""Figures of layers in a grid. Imports matplotlib, without pyplot: import this module where a figure is drawn."""

from __future__ import annotations

import io
import itertools
import math
import textwrap
from collections.abc import Mapping
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ..base.arrays import Array
from .thumbnails import Thumbnail

MOST = 60  # layers in a figure

_INCHES = 3.0  # longer side of a panel
_TITLE = 0.45  # inches above it
_COLUMNS = 4
_LETTERS = 18  # per inch of a panel's title


class ShownFigure(Figure):
    """A figure that notebooks display as the value of a cell, whether or not pyplot is imported."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def panel_size(shape: tuple[int, ...], longer: float = _INCHES) -> tuple[float, float]:
    """Return width and height in inches of a panel for an image of (M, N, ...); strips are widened to be visible."""
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    return (longer, longer * aspect) if aspect < 1.0 else (longer / aspect, longer)


def show_pixels(axes: Any, pixels: Array, title: str, **options: Any) -> Any:
    """Show an image with a title, without axes or interpolation; strips are stretched."""
    strip = not 0.25 <= pixels.shape[0] / pixels.shape[1] <= 4.0
    shown = axes.imshow(pixels, aspect="auto" if strip else "equal", interpolation="nearest", **options)
    axes.set_title(title, fontsize=8)
    axes.set_xticks([])
    axes.set_yticks([])
    return shown


def draw_thumbnails(figure: Any, pictures: Mapping[str, Thumbnail], columns: int) -> None:
    """Draw the thumbnails, each with name and note, in `columns` columns into a figure or a subfigure."""
    rows = math.ceil(len(pictures) / columns)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    letters = max(12, int(_LETTERS * figure.bbox.width / figure.dpi / columns))
    for axes, (name, picture) in zip(panels, pictures.items(), strict=False):
        show_pixels(axes, picture.pixels, f"{plain_text(name)}\n{textwrap.fill(picture.note, letters)}")
    for axes in panels[len(pictures) :]:
        axes.set_axis_off()


def plot_thumbnails(pictures: Mapping[str, Thumbnail]) -> ShownFigure:
    """Return a figure of the thumbnails, the first 60 of them, at most four in a row."""
    pictures = first_few(pictures)
    columns = min(len(pictures), _COLUMNS)
    width, height = panel_size(next(iter(pictures.values())).pixels.shape)
    size = (columns * width, math.ceil(len(pictures) / columns) * (height + _TITLE))
    figure = ShownFigure(figsize=size, dpi=100, layout="constrained")
    draw_thumbnails(figure, pictures, columns)
    return figure


def first_few(pictures: Mapping[str, Thumbnail]) -> dict[str, Thumbnail]:
    """Return the thumbnails that fit into a figure of at most 2^16 pixels a side; the last note counts the others."""
    shown = dict(itertools.islice(pictures.items(), MOST))
    if len(pictures) > MOST:
        name, last = shown.popitem()
        shown[name] = last._replace(note=f"{last.note}; {len(pictures) - MOST} more layers")
    return shown


def plain_text(text: str) -> str:
    """Return a name from a file for a figure: short, and without what matplotlib takes for formulas or line breaks."""
    printable = text if text.isprintable() else ascii(text)
    return (printable if len(printable) <= 48 else printable[:45] + "...").replace("$", r"\$")
