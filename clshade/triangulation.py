"""Polygons, strips and fans of vertex indices as triangles, by whole arrays."""

from __future__ import annotations

import numpy as np

from .validation import Array


def fans(corners: Array, counts: Array) -> tuple[Array, Array]:
    """Polygons as fans round their first corner.

    corners: (C,) the polygons' corners, one polygon after the other. counts: (P,) corners of each, at least 3.
    Returns (F, 3) triangles of the same type, in order, and the (F,) polygon of each.
    """
    if len(counts) and (counts == 3).all():
        return corners.reshape(-1, 3), np.arange(len(counts))
    triangles = counts - 2
    polygon = np.repeat(np.arange(len(counts)), triangles)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    start = (np.cumsum(counts) - counts)[polygon]
    return corners[np.stack([start, start + step + 1, start + step + 2], axis=1)], polygon


def strips(indices: Array) -> Array:
    """Triangle strips as triangles, all wound as the first of their strip.

    indices: (N,) whole numbers; -1 ends a strip. Returns (F, 3) of the same type; a strip of less than 3 gives none.
    """
    if len(indices) < 3:
        return np.zeros((0, 3), indices.dtype)
    ends = indices == -1
    place = np.arange(len(indices))
    begin = np.maximum.accumulate(np.where(ends, place + 1, 0))
    first = np.flatnonzero(~(ends[:-2] | ends[1:-1] | ends[2:]))
    odd = (first - begin[first]) & 1
    return indices[np.stack([first, first + 1 + odd, first + 2 - odd], axis=1)]


def single_fan(indices: Array) -> Array:
    """One fan round indices[0] as glTF orders it: (N,) -> (N-2, 3), each i+1, i+2, 0."""
    middle = np.stack([indices[1:-1], indices[2:]], axis=1)
    return np.concatenate([middle, np.broadcast_to(indices[:1], (len(middle),))[:, None]], axis=1)
