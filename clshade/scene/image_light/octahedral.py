"""Octahedral maps: the sphere as a square, without seams and with a few operations per lookup.

A direction d is divided by |x| + |y| + |z|; x and y of the upper half (z >= 0) fill the inner diamond of the square
[-1, 1]^2, the lower half is folded outward. Cigolle et al., A Survey of Efficient Representations for Independent Unit
Vectors, JCGT 2014. Beyond an edge the map goes on turned by half a turn about the middle of the edge.
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import Floats, Integers


def directions(side: int) -> Floats:
    """Return the unit directions (side, side, 3) of the texels' centers; the first axis is y."""
    center = (np.arange(side) + 0.5) * (2.0 / side) - 1.0
    x, y = np.broadcast_arrays(center[None, :], center[:, None])
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    d = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    return np.asarray(d / np.sqrt((d * d).sum(axis=-1, keepdims=True)))


def positions(d: Floats) -> tuple[Floats, Floats]:
    """Return x and y in [-1, 1] of directions (..., 3) of any length but 0."""
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    ax, ay = np.abs(x), np.abs(y)
    inverse = 1.0 / (ax + ay + np.abs(z))
    ax, ay = ax * inverse, ay * inverse
    below = z < 0.0
    px, py = np.where(below, 1.0 - ay, ax), np.where(below, 1.0 - ax, ay)
    return np.copysign(px, x), np.copysign(py, y)


def texels(d: Floats, side: int) -> Integers:
    """Return the indices (...) of the texels that directions (..., 3) fall into, row by row."""
    x, y = (np.minimum(((p + 1.0) * (side / 2)).astype(np.int64), side - 1) for p in positions(d))
    return y * side + x


def padded(level: Floats, width: int = 1) -> Floats:
    """Return a map (side, side, ...) with a border of `width` texels that continues it."""
    turned_x = level[::-1, :][:, :width], level[::-1, :][:, -width:]
    wide = np.concatenate([turned_x[0][:, ::-1], level, turned_x[1][:, ::-1]], axis=1)
    top, bottom = wide[:width, ::-1][::-1], wide[-width:, ::-1][::-1]
    return np.concatenate([top, wide, bottom], axis=0)


def lookup(level: Floats, d: Floats) -> Floats:
    """Return the bilinear means (..., C) of a map (side, side, C) in directions (..., 3)."""
    side = len(level)
    wide = padded(level)
    x, y = (p * (side / 2) + (side / 2 + 0.5) for p in positions(d))
    column, row = (np.clip(np.floor(p).astype(np.int64), 0, side) for p in (x, y))
    across, down = (x - column)[..., None], (y - row)[..., None]
    top = wide[row, column] * (1.0 - across) + wide[row, column + 1] * across
    bottom = wide[row + 1, column] * (1.0 - across) + wide[row + 1, column + 1] * across
    return top * (1.0 - down) + bottom * down
