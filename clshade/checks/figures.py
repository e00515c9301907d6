"""Figures without a display and without pyplot, saved whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .. import atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS, OTHER, MUTED = "#1f5fa8", "#c0504d", "gray"


def blank(width: float, height: float) -> Figure:
    """An empty figure; inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path, dpi: int = 110) -> None:
    """As PNG. Raises OutputError when it cannot be written."""
    with atomic.replacing(path) as file:
        figure.savefig(file, format="png", dpi=dpi)
