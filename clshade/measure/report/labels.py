"""Labels beside the points of a plot, placed so that none overlaps another or a point."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

DIRECTIONS = 16
UNIT = 0.01  # inches; lengths below are multiples of it
PIECE = 6.0  # of sloping lines, about which a box is drawn
PAD = 5.0  # on either side of a label
REACHES = (7.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0)  # from the point to the label's nearest side


class Box(NamedTuple):
    left: float
    bottom: float
    right: float
    top: float

    def overlap(self, other: Box) -> float:
        """Return the area of the intersection."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.top, other.top) - max(self.bottom, other.bottom)
        return width * height if width > 0.0 and height > 0.0 else 0.0

    @property
    def area(self) -> float:
        return (self.right - self.left) * (self.top - self.bottom)


def beside(x: float, y: float, width: float, height: float, reach: float, angle: float) -> Box:
    """Return a box of that size whose nearest side or corner is `reach` away from the point, in direction `angle`."""
    dx, dy = math.cos(angle), math.sin(angle)
    center_x, center_y = x + dx * (reach + width / 2.0), y + dy * (reach + height / 2.0)
    return Box(center_x - width / 2.0, center_y - height / 2.0, center_x + width / 2.0, center_y + height / 2.0)


def placed(
    points: Sequence[tuple[float, float]],
    sizes: Sequence[tuple[float, float]],
    frame: Box,
    obstacles: Sequence[Box] = (),
    radius: float = 5.0,
) -> list[Box]:
    """Place a box for each point's label, in units: near the point, inside the frame, over no label, point or
    obstacle.

    The points with the most neighbors choose first. If no place is free, the one with the least overlap is taken.
    """
    taken = [*obstacles, *(Box(x - radius, y - radius, x + radius, y + radius) for x, y in points)]
    crowd = [sum(1.0 / (1.0 + math.dist(a, b)) for b in points) for a in points]
    boxes: dict[int, Box] = {}
    for k in sorted(range(len(points)), key=lambda k: -crowd[k]):
        best, least = None, math.inf
        for reach in REACHES:
            for step in range(DIRECTIONS):
                box = beside(*points[k], *sizes[k], reach, 2.0 * math.pi * step / DIRECTIONS)
                outside = box.area - box.overlap(frame)
                cost = outside + sum(box.overlap(other) for other in (*boxes.values(), *taken))
                if cost < least:
                    best, least = box, cost
            if least == 0.0:
                break
        boxes[k] = best  # type: ignore[assignment]
    return [boxes[k] for k in range(len(points))]


def _divided(start: Array, end: Array) -> Array:
    """Return points from start to end, (K, 2); no nearer than PIECE to each other if the line slopes."""
    count = 2 + int(min(np.abs(end - start)) / PIECE)
    points: Array = np.linspace(start, end, count)
    return points


def label_points(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    names: Sequence[str],
    lines: Sequence[Sequence[tuple[float, float]]] = (),
    size: float = 8.0,
    **style: Any,
) -> list[Text]:
    """Label the points of axes whose place in the figure is final, and return the labels; a thin line leads to those
    not next to their point.

    lines: the corners of lines, which labels avoid. style: further properties of the
    texts. Places are parts of the figure, whatever resolution it is saved with.
    """
    figure: Any = axes.figure
    unit = UNIT * figure.dpi  # pixels
    points = [tuple(map(float, axes.transData.transform(point) / unit)) for point in zip(x, y, strict=True)]
    texts = [axes.text(0.0, 0.0, name, fontsize=size, transform=None, va="bottom", zorder=5, **style) for name in names]
    extents = [text.get_window_extent(figure.canvas.get_renderer()) for text in texts]
    inside = Box(*axes.get_window_extent(figure.canvas.get_renderer()).extents / unit)
    pieces = [
        Box(*np.minimum(a, b) - 1.0, *np.maximum(a, b) + 1.0)
        for line in lines
        for start, end in itertools.pairwise(axes.transData.transform(line) / unit)
        for a, b in itertools.pairwise(_divided(start, end))
    ]
    sizes = [(each.width / unit + 2.0 * PAD, each.height / unit + 2.0) for each in extents]
    boxes = placed(points, sizes, inside, pieces)  # type: ignore[arg-type]
    to_figure = figure.transFigure.inverted()
    for text, box, point in zip(texts, boxes, points, strict=True):
        text.set_transform(figure.transFigure)
        text.set_position(to_figure.transform(((box.left + PAD) * unit, (box.bottom + 1.0) * unit)))
        near = min(max(point[0], box.left), box.right), min(max(point[1], box.bottom), box.top)
        if math.dist(near, point) > REACHES[1]:
            ends = to_figure.transform(np.array([near, point]) * unit)
            line = axes.plot(*ends.T, color="gray", lw=0.5, transform=figure.transFigure, zorder=1)
            line[0].set_clip_on(False)
    return texts
