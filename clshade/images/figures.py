"""Figures without a display and without pyplot, of layers in a grid and others, saved atomically."""

from __future__ import annotations

import io
import itertools
import math
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base import atomic_files
from ..base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .thumbnails import Thumbnail

OURS, OTHER, MUTED = "#1f5fa8", "#c0504d", "gray"
FORMATS = ("png", "pdf", "svg")  # that figures are saved as
VECTOR_DPI = 200  # of pictures within PDF and SVG
# Fonts are embedded as TrueType in PDF, and drawn as outlines in SVG, which holds no fonts; names within an SVG are the same
# on every run.
_VECTOR: dict[Any, Any] = {"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "clshade"}
_NO_DATE = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}

MAX_LAYERS = 60  # in a figure
_PANEL, _TITLE = 3.0, 0.45  # inches: longer side of a panel, and the space above it
_COLUMNS = 4
_LETTERS = 18  # per inch of a panel's title


def blank(width: float, height: float, dpi: int = 110) -> Figure:
    """Create an empty figure; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: str | Path, colors: int | None = None) -> None:
    """Save as PNG, optionally with a palette of `colors` colors: a third of the size; or as PDF or SVG, by the suffix.
    Raises OutputError."""
    kind = Path(path).suffix[1:].lower()
    atomic_files.write_bytes(path, as_vectors(figure, kind) if kind in _NO_DATE else _as_png(figure, colors))


def as_vectors(figure: Figure, kind: str) -> bytes:
    """Return the figure as a file of this kind, pdf or svg: the same bytes for the same figure."""
    from matplotlib import rc_context

    file = io.BytesIO()
    with rc_context(_VECTOR):
        figure.savefig(file, format=kind, dpi=VECTOR_DPI, metadata=_NO_DATE[kind])
    return file.getvalue()


def _as_png(figure: Figure, colors: int | None = None) -> bytes:
    import numpy as np
    from PIL import Image

    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore[attr-defined]
    if colors is not None:
        picture = picture.quantize(colors, dither=Image.Dither.NONE)
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True)
    return file.getvalue()


def panel_size(shape: tuple[int, ...], longer: float = _PANEL) -> tuple[float, float]:
    """Return width and height in inches of a panel for an image of (M, N, ...); strips are widened to be visible."""
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    return (longer, longer * aspect) if aspect < 1.0 else (longer / aspect, longer)


def show_pixels(axes: Any, pixels: Array, title: str) -> None:
    """Show an image with a title, without axes or interpolation; strips are stretched."""
    strip = not 0.25 <= pixels.shape[0] / pixels.shape[1] <= 4.0
    axes.imshow(pixels, aspect="auto" if strip else "equal", interpolation="nearest")
    axes.set_title(title, fontsize=8)
    axes.set_xticks([])
    axes.set_yticks([])


def draw_thumbnails(figure: Any, pictures: Mapping[str, Thumbnail], columns: int) -> None:
    """Draw the thumbnails, each with name and note, in `columns` columns into a figure or a subfigure."""
    rows = math.ceil(len(pictures) / columns)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    letters = max(12, int(_LETTERS * figure.bbox.width / figure.dpi / columns))
    for axes, (name, picture) in zip(panels, pictures.items(), strict=False):
        show_pixels(axes, picture.pixels, f"{plain_text(name)}\n{textwrap.fill(picture.note, letters)}")
    for axes in panels[len(pictures) :]:
        axes.set_axis_off()


def plot_thumbnails(pictures: Mapping[str, Thumbnail]) -> Figure:
    """Return a figure of the thumbnails, the first 60 of them, at most four in a row.

    Notebooks display it as the value of a cell, whether or not pyplot is imported.
    """
    pictures = first_few(pictures)
    columns = min(len(pictures), _COLUMNS)
    width, height = panel_size(next(iter(pictures.values())).pixels.shape)
    figure = blank(columns * width, math.ceil(len(pictures) / columns) * (height + _TITLE), dpi=100)
    draw_thumbnails(figure, pictures, columns)
    vars(figure)["_repr_png_"] = lambda: _as_png(figure)
    return figure


def first_few(pictures: Mapping[str, Thumbnail]) -> dict[str, Thumbnail]:
    """Return the thumbnails that fit into a figure of at most 2^16 pixels a side; the last note counts the others."""
    shown = dict(itertools.islice(pictures.items(), MAX_LAYERS))
    if len(pictures) > MAX_LAYERS:
        name, last = shown.popitem()
        shown[name] = last._replace(note=f"{last.note}; {len(pictures) - MAX_LAYERS} more layers")
    return shown


def plain_text(text: str) -> str:
    """Return a name from a file for a figure: short, and without what matplotlib takes for formulas or line breaks."""
    printable = text if text.isprintable() else ascii(text)
    return (printable if len(printable) <= 48 else printable[:45] + "...").replace("$", r"\$")
