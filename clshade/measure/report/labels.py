"""Labels beside the points of a plot, placed so that they cover little."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array, Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

ANGLES = np.arange(16) * math.pi / 8.0
REACHES = (5.0, 9.0, 15.0, 23.0, 33.0, 45.0)  # from the point to the label's nearest side, in points of 1/72 inch
DOT = 60.0  # square points that covering a dot of a line or a point counts as
PIECES = 40  # dots between two corners of a line


def places(points: Array, sizes: Array, frame: Array, dots: Array) -> Floats:
    """Return the middle of each point's label, (K, 2): where it covers least of other labels and dots, and leaves the frame
    least; of equal places the nearest. points, sizes: (K, 2). frame: left, bottom, right, top. dots: (P, 2)."""
    directions = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
    boxes = np.empty((0, 4))
    for point, size in zip(points, sizes, strict=True):
        middles = np.concatenate([point + directions * (reach + size / 2.0) for reach in REACHES])
        beside = np.hstack([middles - size / 2.0, middles + size / 2.0])
        covered = _overlaps(beside, boxes).sum(axis=1) + size.prod() - _overlaps(beside, frame[None])[:, 0]
        inside = (beside[:, None, :2] <= dots) & (dots <= beside[:, None, 2:])
        best = np.argmin(covered + DOT * inside.all(axis=2).sum(axis=1))
        boxes = np.concatenate([boxes, beside[best : best + 1]])
    return (boxes[:, :2] + boxes[:, 2:]) / 2.0


def _overlaps(boxes: Array, others: Array) -> Floats:
    """Return the areas of the intersections, (K, 4) with (P, 4): (K, P)."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    areas: Floats = np.maximum(np.minimum(boxes[:, None, 2:], others[None, :, 2:]) - low, 0.0).prod(axis=2)
    return areas


def label_points(axes: Axes, points: Sequence[tuple[float, float]], names: Sequence[str]) -> list[Annotation]:
    """Label the points of axes whose place in the figure is final, beside their lines; return the labels."""
    from matplotlib.text import Text

    figure: Any = axes.figure
    unit = figure.dpi / 72.0  # pixels
    at = axes.transData.transform(points) / unit
    corners = [line.get_transform().transform(line.get_xydata()) / unit for line in axes.lines]
    dots = [np.linspace(line[:-1], line[1:], PIECES).reshape(-1, 2) for line in corners]
    style: Any = {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 5}
    style["arrowprops"] = {"arrowstyle": "-", "lw": 0.5, "color": "gray"}
    texts = [axes.annotate(name, point, (0.0, 0.0), **style) for name, point in zip(names, points, strict=True)]
    sizes = np.array([Text.get_window_extent(text).size for text in texts]) / unit + 2.0
    middles = places(at, sizes, axes.get_window_extent().extents / unit, np.concatenate([at, *dots]))
    for text, middle, point in zip(texts, middles, at, strict=True):
        text.set_position(middle - point)
    return texts
