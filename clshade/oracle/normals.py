"""Vertex normals, in world space."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Floats, Reals
from .transform import is_identity, mirroring
from .vectors import cross, length, power_of_two, unit

CANCELED = 2.0**-40  # relative to the sizes of a vertex's faces: a smaller sum has no direction left


def vertex_normals(verts: Reals, faces: Array) -> Floats:
    """Return the normals of a mesh from its shape: at each vertex the sum of its faces' cross products, normalized.

    verts: (V, 3), faces: (F, 3) indices. Returns (V, 3): unit vectors, or 0 at a vertex that has no face, only faces
    without area, or faces that cancel up to rounding (2^-40 of their sizes). A larger face weighs more: its cross
    product is twice its area.
    """
    total = np.zeros((len(verts), 3))
    if len(faces) == 0:
        return total
    first, second = _edges(verts, faces)
    products = cross(first, second)
    np.add.at(total, faces, products[:, None, :])
    sizes = np.zeros(len(verts))
    np.add.at(sizes, faces, np.abs(products).sum(axis=1)[:, None])
    total[np.abs(total).max(axis=1) <= CANCELED * sizes] = 0.0
    return unit(total)


def vertex_normal_errors(verts: Reals, faces: Array) -> Floats:
    """Return how far two computations of `vertex_normals` in float64 may differ: (V,), absolute; 0 where there is no normal.

    A component of a x b is a difference of two products whose factors are rounded differences of coordinates: each
    product is accurate to 3 units of 2^-53, the difference to one more, so the vector to sqrt(2)*3 + 1 < 6 units of
    |a| |b|. That is much more than of |a x b| if a face is a sliver. A sum of m of them rounds m - 1 times. All this
    is relative to the length of the sum, and counts for both sides.
    """
    if len(faces) == 0:
        return np.zeros(len(verts))
    first, second = _edges(verts, faces)
    products, sizes = cross(first, second), length(first) * length(second)
    total, most, count = np.zeros((len(verts), 3)), np.zeros(len(verts)), np.zeros(len(verts))
    np.add.at(total, faces, products[:, None, :])
    np.add.at(most, faces, sizes[:, None])
    np.add.at(count, faces, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = 2.0 * 2.0**-53 * (6.0 + count) * most / length(total)
    return np.where(vertex_normals(verts, faces).any(axis=1), errors, 0.0)


def _edges(verts: Reals, faces: Array) -> tuple[Floats, Floats]:
    """Return the edges (F, 3) from each face's first corner to the others, scaled so that no product overflows."""
    corners = np.asarray(verts, dtype=np.float64)[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scale = power_of_two(np.maximum(np.abs(first), np.abs(second)).max(axis=0))
    return first / scale, second / scale


def placed_normals(normals: Reals, matrix: Floats) -> Floats:
    """Transform normals (K, 3) by placements (..., 4, 4) and normalize them, (..., K, 3): directions go by the inverse
    transpose.

    That is the matrix of cofactors divided by the determinant, of which only the sign matters here: a singular
    placement needs no special case. Zero normals stay zero.
    """
    directions = unit(np.asarray(normals, dtype=np.float64))
    a, b = _rows(matrix)
    cofactors = np.where(mirroring(matrix)[..., None, None], -cross(a, b), cross(a, b))
    placed = unit(directions @ np.swapaxes(cofactors, -2, -1))
    return np.where(is_identity(matrix)[..., None, None], directions, placed)


def _rows(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the rows (..., 3, 3) of placements whose cross products are the cofactors, scaled by a power of two."""
    rows = matrix[..., :3, :3] / power_of_two(np.abs(matrix[..., :3, :3]).max(axis=-2))[..., None, None]
    return rows[..., [1, 2, 0], :], rows[..., [2, 0, 1], :]


def placed_normal_errors(normals: Reals, matrix: Floats, own: Floats | float = 0.0) -> Floats:
    """Return how far two computations of `placed_normals` in float64 may differ: (..., K), absolute; 0 where there is no
    normal. own: how far the normals themselves may differ, (K,).

    A cofactor is a difference of two products, accurate to 2 units of 2^-53 of the sum of their sizes, which is much more
    than the cofactor where the placement is nearly singular. A component of the normal is a sum of three products with
    a normalized direction: 4 units of the direction's components, 1 of each product and 2 of the sums add up to 9. All
    this is relative to the length of the sum, and counts for both sides. What the normals differ by themselves grows at
    most as the cofactors' norm.
    """
    a, b = _rows(matrix)
    cofactors = np.swapaxes(cross(a, b), -2, -1)
    after, before = (np.roll(np.abs(a), -k, axis=-1) * np.roll(np.abs(b), k, axis=-1) for k in (1, 2))
    sizes = np.swapaxes(after + before, -2, -1)
    directions = unit(np.asarray(normals, dtype=np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        rounding = 2.0 * 2.0**-53 * 9.0 * length(np.abs(directions) @ sizes)
        growth = np.linalg.norm(cofactors, axis=(-2, -1))[..., None]
        errors = (rounding + own * growth) / length(directions @ cofactors)
    errors = np.where(placed_normals(normals, matrix).any(axis=-1), errors, 0.0)
    return np.where(is_identity(matrix)[..., None], own, errors)
