"""Directions and solid angles of an image in latitude and longitude."""

from __future__ import annotations

import numpy as np

from ...base.arrays import Array, Floats
from ..environment import Environment


def row_edges(rows: int) -> Floats:
    """Return the angles from the top, (rows + 1,), between which the rows lie."""
    edges: Floats = np.linspace(0.0, np.pi, rows + 1)
    return edges


def column_edges(columns: int) -> Floats:
    """Return the longitudes, (columns + 1,), between which the columns lie: from pi on the left to -pi."""
    edges: Floats = np.linspace(np.pi, -np.pi, columns + 1)
    return edges


def solid_angles(rows: int, columns: int) -> Floats:
    """Return the solid angle of the pixels of each row, (rows,), steradian."""
    edges = row_edges(rows)
    middle = (edges[1:] + edges[:-1]) / 2.0
    angles: Floats = 2.0 * np.sin(middle) * np.sin(np.pi / (2.0 * rows)) * (2.0 * np.pi / columns)
    return angles


def radiance(environment: Environment, directions: Floats) -> Floats:
    """Return the radiance (..., 3) from directions (..., 3) of any length but 0, each of its own pixel."""
    rows, columns, _ = environment.image.shape
    front, left, up = np.moveaxis(directions @ environment.axes.T, -1, 0)
    u = 0.5 - np.arctan2(left, front) / (2.0 * np.pi)
    v = np.arctan2(np.hypot(front, left), up) / np.pi
    row = np.minimum((v * rows).astype(np.int64), rows - 1)
    column = np.minimum((u * columns).astype(np.int64), columns - 1)
    found: Array = environment.image[row, column].astype(np.float64) * environment.intensity
    return found
