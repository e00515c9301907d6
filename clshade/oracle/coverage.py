"""Which pixels a triangle covers, in exact integer arithmetic, which triangle comes first, and where a pixel's samples lie.

Corners are snapped image coordinates xy (..., 3, 2), int64, in 1/65536 pixel with y up. Column c, row r (from the
bottom) has its center at (65536*c + 32768, 65536*r + 32768).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from .transform import SAMPLE_STEPS, SUBPIXELS, painter_depth

HALF = SUBPIXELS // 2
GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0


class Setup(NamedTuple):
    """Triangles before rasterization."""

    area: Integers  # (...) twice the signed area, in 1/65536^2 square pixels, positive when counterclockwise
    # (..., 4) first column, first row, last column, last row of the image whose centers the bounding box holds; a last below
    # its first means none
    box: Integers
    culled: Bools  # (...) where nothing can be drawn: no area, no pixel center in the box, or a culled back face


def signed_area(xy: Integers) -> Integers:
    """Return twice the area, int64, positive for counterclockwise corners with y up."""
    a, b, c = xy[..., 0, :], xy[..., 1, :], xy[..., 2, :]
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1])


def setup(xy: Integers, columns: int, rows: int, cull: Bools | bool = False) -> Setup:
    """Return area, bounding box and culling of triangles (..., 3, 2) in an image of columns x rows pixels. cull: (...) of
    back faces."""
    xy = np.asarray(xy, dtype=np.int64)
    area = signed_area(xy)
    first = np.maximum(-((HALF - xy.min(axis=-2)) // SUBPIXELS), 0)  # the ceiling of (x - HALF) / SUBPIXELS
    last = np.minimum((xy.max(axis=-2) - HALF) // SUBPIXELS, [columns - 1, rows - 1])
    culled = (area == 0) | (last < first).any(axis=-1) | (cull & (area < 0))
    return Setup(area, np.concatenate([first, last], axis=-1), culled)


def edge_functions(xy: Integers, column: Integers, row: Integers) -> Integers:
    """Evaluate edge functions at pixel centers, (..., 3) int64: positive inside for either winding.

    The leading axes of xy (..., 3, 2), column (...) and row (...) broadcast. Function i belongs to the edge opposite
    corner i; it is twice the area of the triangle that the pixel center makes with that edge, so the three sum to
    the absolute value of `signed_area`. All are 0 for a triangle without area.
    """
    px, py = (np.asarray(place, np.int64)[..., None] * SUBPIXELS + HALF for place in (column, row))
    start, (dx, dy) = np.roll(xy, -1, axis=-2), _edges(xy)
    return np.asarray(dx * (py - start[..., 1]) - dy * (px - start[..., 0]))


def _edges(xy: Integers) -> tuple[Integers, Integers]:
    """Return x and y (..., 3) of the edges opposite the corners, traversed counterclockwise."""
    edges = (np.roll(xy, -2, axis=-2) - np.roll(xy, -1, axis=-2)) * np.sign(signed_area(xy))[..., None, None]
    return edges[..., 0], edges[..., 1]


def top_left(xy: Integers) -> Bools:
    """Return (..., 3) bool: whether edge i (opposite corner i) owns the points on it.

    Traversed counterclockwise with y up, a left edge goes down and a top edge goes exactly left.
    """
    dx, dy = _edges(np.asarray(xy, dtype=np.int64))
    return np.asarray((dy < 0) | ((dy == 0) & (dx < 0)))


def covered(xy: Integers, edges: Integers) -> Bools:
    """Return (...) bool: which pixels with edge functions (..., 3) the triangles (..., 3, 2) cover."""
    inside, touched = edges > 0, edges == 0
    on_edge = touched[..., 0] | touched[..., 1] | touched[..., 2]  # few pixels: the rule is evaluated for these only
    inside[on_edge] |= touched[on_edge] & top_left(np.broadcast_to(xy, (*edges.shape[:-1], 3, 2))[on_edge])
    return inside[..., 0] & inside[..., 1] & inside[..., 2]


def triangle_mask(xy: Integers, columns: int, rows: int) -> Bools:
    """Return the pixels that one triangle (3, 2) covers: (rows, columns) bool, row 0 at the BOTTOM, either winding."""
    return covered(xy, edge_functions(xy, np.arange(columns)[None, :], np.arange(rows)[:, None]))


def painter_order(z: Floats, alive: Bools) -> Integers:
    """Return indices of the triangles with `alive` (F,) set, front to back, by their corner depths z (F, 3).

    The smallest mean depth comes first; of equal ones the later triangle (-0.0 equals 0.0). NaN comes last.
    """
    index = np.flatnonzero(alive)
    return index[np.lexsort((-index, painter_depth(z[index])))]


def samples(
    xy: Integers, boxes: Integers, limit: int = 1 << 18
) -> Iterator[tuple[Integers, Integers, Integers, Integers]]:
    """Yield the pixels that each triangle covers, as `samples_at`: triangle, column, row, each (S,), and edge functions
    (S, 3)."""
    columns, rows = boxes[:, 2:].max(axis=0, initial=-1) + 1
    row, column = np.divmod(np.arange(rows * columns), max(columns, 1))
    for triangle, pixel, edges in samples_at(xy, boxes, column, row, limit):
        yield triangle, column[pixel], row[pixel], edges


def samples_at(
    xy: Integers, boxes: Integers, column: Integers, row: Integers, limit: int = 1 << 18
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield which of the pixels (column, row), (Q,) each, the triangles xy (K, 3, 2) cover. boxes: (K, 4), see `Setup`.

    Yields triangle and index of the pixel, each (S,), and edge functions (S, 3), in batches of bounded size; of one pixel a
    later batch holds later triangles only.
    """
    left, bottom, right, top = boxes.T
    stride = int(max(column.max(initial=0), right.max(initial=0))) + 1
    in_reading_order = np.lexsort((column, row))
    place = (row * stride + column)[in_reading_order]
    height = np.maximum(top - bottom + 1, 0)
    for some in _batches(height, limit):
        owner, up = _spread(some, height)  # one entry per row of each triangle's box
        start = (bottom[owner] + up) * stride
        first = np.searchsorted(place, start + left[owner])
        count = np.maximum(np.searchsorted(place, start + right[owner], "right") - first, 0)
        for batch in _batches(count, limit):
            span, offset = _spread(batch, count)
            triangle, pixel = owner[span], in_reading_order[first[span] + offset]
            edges = edge_functions(xy[triangle], column[pixel], row[pixel])
            inside = covered(xy[triangle], edges)
            yield triangle[inside], pixel[inside], edges[inside]


def _batches(count: Integers, limit: int) -> list[Integers]:
    """Split the indices with a count above 0, in order, into runs whose counts sum to about `limit`."""
    present = np.flatnonzero(count)
    number = (np.cumsum(count[present]) - 1) // limit
    return [run for run in np.split(present, np.flatnonzero(np.diff(number)) + 1) if len(run)]


def _spread(batch: Integers, count: Integers) -> tuple[Integers, Integers]:
    """Repeat each index of the batch as often as its count; also return the repetition's number, from 0."""
    index = np.repeat(batch, count[batch])
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count[batch]) - count[batch], count[batch])


def places(count: int) -> Integers:
    """Return (S, 2) int64: positions within a pixel, 1/256 px from its lower left corner, nearest to its center first.

    x = (i + 1/2)/S for i = 0, ..., S - 1; y = (i modulo n + 1 - x)/n for S = n n = 4, 9, 16, else the fraction of
    1/2 + (i - (S - 1)/2)/phi; rounded to the grid.
    """
    positions, rows = [], {4: 2, 9: 3, 16: 4}.get(count)
    for i in range(count):
        x, y = (i + 0.5) / count, (0.5 + (i - (count - 1) / 2.0) / GOLDEN_RATIO) % 1.0
        if rows is not None:
            y = (i % rows + 1.0 - x) / rows
        positions.append([min(int(np.rint(t * SAMPLE_STEPS)), SAMPLE_STEPS - 1) for t in (x, y)])
    center = (SAMPLE_STEPS // 2, SAMPLE_STEPS // 2)
    return np.array(sorted(positions, key=lambda place: math.dist(place, center)))  # keeps the order of equal ones


def mean_place(lit: Bools) -> Integers:
    """Return the mean of the places of samples, (K, 2) int64, rounded to whole 1/256 px, halves up. lit: (S, K), which
    samples of K pixels, at least one in each."""
    count, total = lit.sum(axis=0)[:, None], lit.T @ places(len(lit))
    return np.asarray((2 * total + count) // (2 * count))
