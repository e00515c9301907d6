"""Which pixels a triangle covers, in exact integer arithmetic, and which triangle comes first.

Corners are snapped image coordinates xy (..., 3, 2), int64, in 1/65536 pixel with y up. Column c, row r (from the
bottom) has its center at (65536*c + 32768, 65536*r + 32768).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from .transform import SUBPIXELS, painter_depth

HALF = SUBPIXELS // 2


class Setup(NamedTuple):
    """What is known of triangles before rasterization.

    area: (...) twice the signed area, in 1/65536^2 square pixels, positive when counterclockwise.
    box: (..., 4) columns and rows whose centers the bounding box holds, within the image: first column, first row,
        last column, last row, both ends included; a last below its first means none.
    culled: (...) True where nothing can be drawn: no area, no pixel center in the box, or a culled back face.
    """

    area: Integers
    box: Integers
    culled: Bools


def signed_area(xy: Integers) -> Integers:
    """Return twice the area, int64, positive for counterclockwise corners with y up."""
    a, b, c = xy[..., 0, :], xy[..., 1, :], xy[..., 2, :]
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1])


def setup(xy: Integers, columns: int, rows: int, cull: bool = False) -> Setup:
    """Return area, bounding box and culling of triangles (..., 3, 2) in an image of columns x rows pixels."""
    xy = np.asarray(xy, dtype=np.int64)
    area = signed_area(xy)
    a, b, c = xy[..., 0, :], xy[..., 1, :], xy[..., 2, :]
    first = -((HALF - np.minimum(np.minimum(a, b), c)) // SUBPIXELS)  # the ceiling of (x - HALF) / SUBPIXELS
    last = (np.maximum(np.maximum(a, b), c) - HALF) // SUBPIXELS
    first = np.maximum(first, 0)
    last = np.minimum(last, [columns - 1, rows - 1])
    culled = (area == 0) | (last < first).any(axis=-1)
    if cull:
        culled = culled | (area < 0)
    return Setup(area, np.concatenate([first, last], axis=-1), culled)


def edge_functions(xy: Integers, column: Integers, row: Integers) -> Integers:
    """Evaluate edge functions at pixel centers, (..., 3) int64: positive inside for either winding.

    The leading axes of xy (..., 3, 2), column (...) and row (...) broadcast. Function i belongs to the edge opposite
    corner i; it is twice the area of the triangle that the pixel center makes with that edge, so the three sum to
    the absolute value of `signed_area`. All are 0 for a triangle without area.
    """
    xy = np.asarray(xy, dtype=np.int64)
    px = np.asarray(column, dtype=np.int64) * SUBPIXELS + HALF
    py = np.asarray(row, dtype=np.int64) * SUBPIXELS + HALF
    winding = np.sign(signed_area(xy))
    result = []
    for i in range(3):
        start, end = xy[..., (i + 1) % 3, :], xy[..., (i + 2) % 3, :]
        dx, dy = end[..., 0] - start[..., 0], end[..., 1] - start[..., 1]
        result.append((dx * (py - start[..., 1]) - dy * (px - start[..., 0])) * winding)
    return np.stack(np.broadcast_arrays(*result), axis=-1)


def top_left(xy: Integers) -> Bools:
    """Return (..., 3) bool: whether edge i (opposite corner i) owns the points on it.

    Traversed counterclockwise with y up, a left edge goes down and a top edge goes exactly left.
    """
    xy = np.asarray(xy, dtype=np.int64)
    winding = np.sign(signed_area(xy))
    result = []
    for i in range(3):
        direction = xy[..., (i + 2) % 3, :] - xy[..., (i + 1) % 3, :]
        dx, dy = direction[..., 0] * winding, direction[..., 1] * winding
        result.append((dy < 0) | ((dy == 0) & (dx < 0)))
    return np.stack(result, axis=-1)


def covered(xy: Integers, edges: Integers) -> Bools:
    """Return (...) bool: which pixels with edge functions (..., 3) the triangles (..., 3, 2) cover."""
    inside, touched = edges > 0, edges == 0
    on_edge = touched[..., 0] | touched[..., 1] | touched[..., 2]  # few pixels: the rule is evaluated for these only
    inside[on_edge] |= touched[on_edge] & top_left(np.broadcast_to(xy, (*edges.shape[:-1], 3, 2))[on_edge])
    return inside[..., 0] & inside[..., 1] & inside[..., 2]


def triangle_mask(xy: Integers, columns: int, rows: int) -> Bools:
    """Return the pixels that one triangle (3, 2) covers: (rows, columns) bool, row 0 at the BOTTOM, either winding."""
    edges = edge_functions(xy, np.arange(columns)[None, :], np.arange(rows)[:, None])
    return covered(xy, edges)


def painter_order(z: Floats, alive: Bools) -> Integers:
    """Return indices of the triangles with `alive` (F,) set, front to back, by their corner depths z (F, 3).

    The smallest mean depth comes first; of equal ones the later triangle (-0.0 equals 0.0). NaN comes last.
    """
    index = np.flatnonzero(alive)
    return index[np.lexsort((-index, painter_depth(z[index])))]


def samples(
    xy: Integers, boxes: Integers, limit: int = 1 << 18
) -> Iterator[tuple[Integers, Integers, Integers, Integers]]:
    """Yield every pixel that each triangle covers, in batches of bounded size.

    xy: (K, 3, 2) and boxes: (K, 4) as of `setup`. Yields triangle, column, row, each (S,), and edge functions (S, 3).
    """
    if len(xy) == 0:
        return
    left, bottom, right, top = boxes.T
    width = np.maximum(right - left + 1, 0)
    band = max(1, limit // max(1, int(width.max())))  # rows at a time: one triangle has at most `limit` pixels there
    for start in range(int(bottom.min()), int(top.max()) + 1, band):
        low, high = np.maximum(bottom, start), np.minimum(top, start + band - 1)
        count = width * np.maximum(high - low + 1, 0)
        for batch in _batches(count, limit):
            triangle, offset = _spread(batch, count)
            column = left[triangle] + offset % width[triangle]
            row = low[triangle] + offset // width[triangle]
            edges = edge_functions(xy[triangle], column, row)
            drawn = covered(xy[triangle], edges)
            yield triangle[drawn], column[drawn], row[drawn], edges[drawn]


def samples_at(
    xy: Integers, boxes: Integers, column: Integers, row: Integers, limit: int = 1 << 18
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield which of the given pixels (column, row), (Q,) each, every triangle covers; others take no time.

    xy: (K, 3, 2) and boxes: (K, 4) as of `setup`. Yields triangle and index of the pixel, each (S,), and edge functions
    (S, 3), in batches of bounded size; of one pixel a later batch holds later triangles only.
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
            drawn = covered(xy[triangle], edges)
            yield triangle[drawn], pixel[drawn], edges[drawn]


def _batches(count: Integers, limit: int) -> list[Integers]:
    """Split the indices with a count above 0, in order, into runs whose counts sum to about `limit`."""
    present = np.flatnonzero(count)
    number = (np.cumsum(count[present]) - 1) // limit
    return [run for run in np.split(present, np.flatnonzero(np.diff(number)) + 1) if len(run)]


def _spread(batch: Integers, count: Integers) -> tuple[Integers, Integers]:
    """Repeat each index of the batch as often as its count; also return the repetition's number, from 0."""
    index = np.repeat(batch, count[batch])
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count[batch]) - count[batch], count[batch])
