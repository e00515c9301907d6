"""Picture of a graded image: itself, the right one and the difference; and what is left after the best explanation."""

from __future__ import annotations

import io
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Floats
from ...images import compare_figure, figures
from ...images.image_file import Group
from .grade import Grade, Right, explained_codes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PANEL, _TITLE, _BAR = 3.6, 0.75, 0.9  # inches
_LETTERS = 110  # of a title, in a line


def draw(result: Grade, right: Right) -> Figure:
    """Draw image, right one and difference; below them the right one with the mistakes in its place."""
    image = _group(result.image)
    verdict = "right within 1/255" if result.right else f"not right: {result.differ:,} pixels differ"
    rows = [(verdict, "the right image", _group(right.codes))]
    if best := result.best:
        mistake = best.label if best.claimed else f"not explained; nearest: {best.label}"
        these = "this mistake" if len(best.changes) == 1 else "these mistakes"
        rows.append((mistake, f"the right image with {these}", _group(explained_codes(right, result.image, best))))
    width, height = figures.panel_size(result.image.shape, _PANEL)
    figure = figures.blank(3 * width + _BAR, len(rows) * (height + _TITLE), dpi=100)
    parts = figure.subfigures(len(rows), 1, squeeze=False)[:, 0]
    for part, (title, caption, expected) in zip(parts, rows, strict=True):
        part.suptitle(textwrap.fill(title, _LETTERS), fontsize=10, fontweight="bold")
        panels = part.subplots(1, 3)
        compare_figure.draw_row(part, panels, (image, expected), True, ("your image", caption))
    return figure


def _group(codes: Floats) -> Group:
    planes = np.moveaxis(codes.astype(np.float32) / np.float32(255.0), 2, 0)
    return Group("RGB", ("R", "G", "B"), tuple(planes))


def as_png(result: Grade, right: Right) -> bytes:
    """Return the picture as a PNG file."""
    file = io.BytesIO()
    draw(result, right).savefig(file, format="png")
    return file.getvalue()
