"""Figures of layers side by side. Imports matplotlib, without pyplot: import it where a figure is drawn."""

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

_INCHES = 3.0  # a panel's longer side
_TITLE = 0.45  # above it
_COLUMNS = 4
_LETTERS = 18  # to an inch of a line above a panel


class ShownFigure(Figure):
    """A figure that notebooks show when it is a cell's value, whether or not pyplot was imported."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def panel_size(shape: tuple[int, ...], longer: float = _INCHES) -> tuple[float, float]:
    """Width and height in inches of a panel for an image of (M, N, ...); strips are stretched until they can be seen."""
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    return (longer, longer * aspect) if aspect < 1.0 else (longer / aspect, longer)


def show_pixels(axes: Any, pixels: Array, title: str, **options: Any) -> Any:
    """An image with a title and nothing else, pixel for pixel where it is large enough."""
    strip = not 0.25 <= pixels.shape[0] / pixels.shape[1] <= 4.0
    shown = axes.imshow(pixels, aspect="auto" if strip else "equal", interpolation="nearest", **options)
    axes.set_title(title, fontsize=8)
    axes.set_xticks([])
    axes.set_yticks([])
    return shown


def draw_thumbnails(figure: Any, pictures: Mapping[str, Thumbnail], columns: int) -> None:
    """The pictures, each with name and note, in rows of so many, into a figure or a part of one."""
    rows = math.ceil(len(pictures) / columns)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    letters = max(12, int(_LETTERS * figure.bbox.width / figure.dpi / columns))
    for axes, (name, picture) in zip(panels, pictures.items(), strict=False):
        show_pixels(axes, picture.pixels, f"{plain_text(name)}\n{textwrap.fill(picture.note, letters)}")
    for axes in panels[len(pictures) :]:
        axes.set_axis_off()


def plot_thumbnails(pictures: Mapping[str, Thumbnail]) -> ShownFigure:
    """A figure of the pictures, the first 60 of them, at most four in a row."""
    pictures = first_few(pictures)
    columns = min(len(pictures), _COLUMNS)
    width, height = panel_size(next(iter(pictures.values())).pixels.shape)
    size = (columns * width, math.ceil(len(pictures) / columns) * (height + _TITLE))
    figure = ShownFigure(figsize=size, dpi=100, layout="constrained")
    draw_thumbnails(figure, pictures, columns)
    return figure


def first_few(pictures: Mapping[str, Thumbnail]) -> dict[str, Thumbnail]:
    """As many as a picture has room for, which has at most 2^16 pixels a side. The last one's note counts the others."""
    shown = dict(itertools.islice(pictures.items(), MOST))
    if len(pictures) > MOST:
        name, last = shown.popitem()
        shown[name] = last._replace(note=f"{last.note}; {len(pictures) - MOST} more layers")
    return shown


def plain_text(text: str) -> str:
    """A name from a file for a figure: matplotlib would take dollar signs for formulas and lines for lines."""
    printable = text if text.isprintable() else ascii(text)
    return (printable if len(printable) <= 48 else printable[:45] + "...").replace("$", r"\$")
