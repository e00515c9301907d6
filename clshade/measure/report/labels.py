"""Labels beside the points of a plot, placed so that none overlaps another or a point."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array, Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

DIRECTIONS = 16
UNIT = 0.01  # inches; lengths below are multiples of it
RADIUS = 5.0  # of a point
PIECE = 6.0  # of sloping lines, about which a box is drawn
PAD = 5.0  # on either side of a label
REACHES = (7.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0)  # from the point to the label's nearest side


def placed(points: Array, sizes: Array, frame: Array, obstacles: Array) -> Floats:
    """Return a box for each point's label, (K, 4): near the point, inside the frame, over no other label and no obstacle;
    if no place is free, where it covers least.

    points, sizes: (K, 2). frame, obstacles: (4,) and (P, 4). Boxes are left, bottom, right, top. The points with the most
    neighbors choose first.
    """
    boxes = np.empty((len(points), 4))
    taken = obstacles
    crowd = [sum(1.0 / (1.0 + math.dist(a, b)) for b in points) for a in points]
    for k in sorted(range(len(points)), key=lambda k: -crowd[k]):
        beside = np.array([_beside(points[k], sizes[k], *place) for place in _places()])
        outside = np.prod(sizes[k]) - _overlaps(beside, frame[None])[:, 0]
        boxes[k] = beside[np.argmin(outside + _overlaps(beside, taken).sum(axis=1))]
        taken = np.concatenate([taken, boxes[k : k + 1]])
    return boxes


def _places() -> list[tuple[float, float]]:
    """Return reaches and angles, the nearest first."""
    return [(reach, 2.0 * math.pi * step / DIRECTIONS) for reach in REACHES for step in range(DIRECTIONS)]


def _beside(point: Array, size: Array, reach: float, angle: float) -> Array:
    """Return a box of that size whose nearest side or corner is `reach` away from the point, in direction `angle`."""
    middle = point + np.array([math.cos(angle), math.sin(angle)]) * (reach + size / 2.0)
    return np.concatenate([middle - size / 2.0, middle + size / 2.0])


def _overlaps(boxes: Array, others: Array) -> Array:
    """Return the areas of the intersections, (K, 4) with (P, 4): (K, P)."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    areas: Array = np.maximum(high - low, 0.0).prod(axis=2)
    return areas


def _along(line: Array) -> list[Array]:
    """Return boxes about a line with corners (N, 2), small ones where it slopes."""
    found = []
    for start, end in itertools.pairwise(line):
        ends = np.linspace(start, end, 2 + int(np.abs(end - start).min() / PIECE))
        found += [np.concatenate([np.minimum(a, b) - 1.0, np.maximum(a, b) + 1.0]) for a, b in itertools.pairwise(ends)]
    return found


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

    lines: the corners of lines, which labels avoid. style: further properties of the texts. Places are parts of the
    figure, whatever resolution it is saved with.
    """
    figure: Any = axes.figure
    unit, renderer = UNIT * figure.dpi, figure.canvas.get_renderer()  # pixels
    texts = [axes.text(0.0, 0.0, name, fontsize=size, transform=None, va="bottom", zorder=5, **style) for name in names]
    if not texts:
        return []
    points = axes.transData.transform(np.column_stack([x, y])) / unit
    extents = np.array([text.get_window_extent(renderer).size for text in texts]) / unit
    pieces = [piece for line in lines for piece in _along(axes.transData.transform(line) / unit)]
    obstacles = np.array([*pieces, *np.hstack([points - RADIUS, points + RADIUS])])
    frame = axes.get_window_extent(renderer).extents / unit
    to_figure = figure.transFigure.inverted()
    for text, box, point in zip(
        texts, placed(points, extents + (2.0 * PAD, 2.0), frame, obstacles), points, strict=True
    ):
        text.set_transform(figure.transFigure)
        text.set_position(to_figure.transform((box[:2] + (PAD, 1.0)) * unit))
        near = np.clip(point, box[:2], box[2:])
        if math.dist(near, point) > REACHES[1]:
            ends = to_figure.transform(np.array([near, point]) * unit)
            line = axes.plot(*ends.T, color="gray", lw=0.5, transform=figure.transFigure, zorder=1)
            line[0].set_clip_on(False)
    return texts
