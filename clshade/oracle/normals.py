"""Vertex normals, in world space."""

from __future__ import annotations

import numpy as np

from .transform import mirrors
from .vectors import Array, cross, power_of_two, unit

CANCELED = 2.0**-40  # of the sizes of a vertex's faces: their sum has no direction left


def vertex_normals(verts: Array, faces: Array) -> Array:
    """Normals of a mesh from its shape: at each vertex the sum of its faces' cross products, normalized.

    verts: (V, 3), faces: (F, 3) indices. Returns (V, 3): unit vectors, or 0 at a vertex that has no face, only faces
    without area, or faces that cancel but for rounding (2^-40 of their sizes). A larger face counts for more: its cross
    product is twice its area.
    """
    total = np.zeros((len(verts), 3))
    if len(faces) == 0:
        return total
    corners = np.asarray(verts, dtype=np.float64)[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scale = power_of_two(np.maximum(np.abs(first), np.abs(second)).max(axis=0))
    products = cross(first / scale, second / scale)
    np.add.at(total, faces, products[:, None, :])
    sizes = np.zeros(len(verts))
    np.add.at(sizes, faces, np.abs(products).sum(axis=1)[:, None])
    total[np.abs(total).max(axis=1) <= CANCELED * sizes] = 0.0
    return unit(total)


def placed_normals(normals: Array, matrix: Array) -> Array:
    """Given normals (K, 3) under a placement (4, 4), normalized: directions go by the inverse transpose.

    That is the matrix of cofactors divided by the determinant, of which only the sign matters here: a singular
    placement needs no special case. Zero normals stay zero.
    """
    normals = np.asarray(normals, dtype=np.float64)
    if np.array_equal(matrix, np.eye(4)):
        return unit(normals)
    rows = matrix[:3, :3] / power_of_two(np.abs(matrix[:3, :3]).max(axis=0))
    cofactors = np.stack([cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])])
    if mirrors(matrix):
        cofactors = -cofactors
    return unit(unit(normals) @ cofactors.T)
