"""Figures without a display and without pyplot, saved atomically."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base import atomic_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS, OTHER, MUTED = "#1f5fa8", "#c0504d", "gray"
FORMATS = ("png", "pdf", "svg")  # that figures are saved as
VECTOR_DPI = 200  # of pictures within PDF and SVG
# Fonts are embedded as TrueType in PDF, and drawn as outlines in SVG, which holds no fonts; names within an SVG are the same
# on every run.
_VECTOR: dict[Any, Any] = {"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "clshade"}
_NO_DATE = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


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


def _as_png(figure: Figure, colors: int | None) -> bytes:
    import numpy as np
    from PIL import Image

    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore[attr-defined]
    if colors is not None:
        picture = picture.quantize(colors, dither=Image.Dither.NONE)
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True)
    return file.getvalue()
