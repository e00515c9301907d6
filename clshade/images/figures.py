"""Figures without a display and without pyplot, saved atomically."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..base import atomic_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS, OTHER, MUTED = "#1f5fa8", "#c0504d", "gray"


def blank(width: float, height: float, dpi: int = 110) -> Figure:
    """Create an empty figure; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: str | Path, colors: int | None = None) -> None:
    """Save as PNG, optionally with a palette of `colors` colors: a third of the size. Raises OutputError."""
    from PIL import Image

    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore[attr-defined]
    if colors is not None:
        picture = picture.quantize(colors, dither=Image.Dither.NONE)
    with atomic_files.replacing(path) as file:
        picture.save(file, "PNG", optimize=True)
