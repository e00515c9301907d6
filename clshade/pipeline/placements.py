"""Vertices, normals and tangents under the placements of instances, in float64, each operation rounded by itself:
kernels/placements.clh does the same on the device, hence the same bits."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.geometry import row_blocks
from .shading_tables import Real

_BLOCK = 1 << 14  # vectors at once: their temporary arrays stay in the cache


def plain(matrices: Floats) -> Bools:
    """Return which placements (K, 4, 4) are identities, (K,): their vertices are used as they are."""
    return np.asarray((matrices == np.eye(4)).all(axis=(1, 2)))


def mirroring(matrices: Floats) -> Bools:
    """Return which placements (K, 4, 4) mirror, (K,).

    Decided by the exact sign of the determinant: rounded to float64, that of a placement that flattens may have either
    sign.
    """
    rows = matrices[:, :3, :3]
    scaled = np.ldexp(rows, -np.frexp(np.abs(rows).max(axis=2, keepdims=True))[1])
    a, b, c, d, e, f, g, h, i = scaled.reshape(-1, 9).T
    products = np.stack([a * e * i, b * f * g, c * d * h, -c * e * g, -b * d * i, -a * f * h])
    determinants, sizes = products.sum(axis=0), np.abs(products).sum(axis=0)
    mirrored: Bools = determinants < 0.0
    # Each product has a relative error of at most 2^-52, unless it underflows; so does each of the five sums.
    for k in np.flatnonzero(np.abs(determinants) <= 2.0**-49 * sizes + 1e-300):
        x, y, z = (list(map(Fraction, row)) for row in rows[k].tolist())
        cross = y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]
        mirrored[k] = x[0] * cross[0] + x[1] * cross[1] + x[2] * cross[2] < 0
    return mirrored


@np.errstate(over="ignore", invalid="ignore")
def products(vectors: Floats, matrices: Floats) -> Floats:
    """Return the products of matrices (..., R, 3) and vectors (..., 3), which broadcast: (..., R). The last column of
    matrices (..., R, 4) is added."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    result = np.empty((*np.broadcast_shapes(matrices.shape[:-2], x.shape), matrices.shape[-2]))
    for i in range(matrices.shape[-2]):
        row = matrices[..., i, :]
        result[..., i] = (row[..., 0] * x + row[..., 1] * y) + row[..., 2] * z
        if matrices.shape[-1] == 4:
            result[..., i] += row[..., 3]
    return result


def _placed(
    own: Array,
    vectors: Floats,
    moved: Bools,
    matrices: Floats,
    counts: Integers | None,
    finished: Callable[[Floats], Floats] = lambda products: products,
) -> Array:
    """Return vectors under K placements, (K V, 3): `own` (V, 3) where they are not `moved`, else the products of matrices
    (L, 3, 3 or 4) of those that are and `vectors` (V, 3), `finished`; of the type of `own`. counts: see `placed_points`."""
    if counts is not None:
        rows = np.repeat(moved, counts)
        placed: Array = own.copy()
        placed[rows] = finished(products(vectors[rows], np.repeat(matrices, counts[moved], axis=0)))
        return placed
    placed = np.empty((len(moved), *own.shape), own.dtype)
    numbers = np.flatnonzero(moved)
    placed[~moved] = own
    for block in row_blocks(len(numbers), max(1, _BLOCK // max(len(vectors), 1))):
        placed[numbers[block]] = finished(products(vectors, matrices[block, None]))
    return placed.reshape(-1, 3)


def placed_points(points: Array, matrices: Floats, counts: Integers | None = None) -> Array:
    """Return points (V, 3) under placements (K, 4, 4): (K V, 3) float64, or of their own type if nothing moves them. counts:
    (K,) of the points that each placement has, V in all, once each; None: each has all."""
    moved = ~plain(matrices)
    if not moved.any():
        return points if counts is not None or len(matrices) == 1 else np.tile(points, (len(matrices), 1))
    wide = np.asarray(points, np.float64)
    return _placed(wide, wide, moved, matrices[moved, :3], counts)


def about_one(values: Array) -> Floats:
    """Return vectors (V, N) or matrices (K, 3, 3) times powers of two, so that the largest components of each are about 1:
    products neither overflow nor underflow."""
    wide = np.asarray(values, np.float64)
    axes = tuple(range(1, wide.ndim))
    return np.asarray(np.ldexp(wide, -np.frexp(np.abs(wide).max(axis=axes, keepdims=True, initial=0.0))[1]))


def _cofactors(matrices: Floats, mirrored: Bools) -> Floats:
    """Return (K, 3, 3), which transform normals, even under singular placements."""
    m = about_one(matrices[:, :3, :3])
    following = [1, 2, 0], [2, 0, 1]
    a, b = (m[:, rows] for rows in following)
    cofactors = np.empty_like(m)
    for i, (j, k) in enumerate(zip(*following, strict=True)):
        cofactors[:, :, i] = a[:, :, j] * b[:, :, k] - a[:, :, k] * b[:, :, j]
    cofactors[mirrored] = -cofactors[mirrored]
    return cofactors


def unit(vectors: Floats) -> Floats:
    """Return unit vectors (..., 3), 0 for those without a direction."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True, initial=0.0)
        x, y, z = (scaled[..., k] for k in range(3))
        normalized = scaled / np.sqrt((x * x + y * y) + z * z)[..., None]
    return np.where(np.isfinite(normalized), normalized, 0.0)


def placed_normals(
    normals: Array,
    matrices: Floats,
    mirrored: Bools,
    real: Real = np.float64,
    *,
    is_unit: bool = False,
    counts: Integers | None = None,
) -> Array:
    """Return unit normals under placements (K, 4, 4), 0 for those without a direction: (K V, 3), rounded to `real`.

    normals: (V, 3) in object space. mirrored: (K,), of `mirroring`: the front stays in front. is_unit: whether the normals
    are unit vectors, which an identity leaves as they are. counts: see `placed_points`.
    """
    moved, unplaced = ~plain(matrices), np.empty((len(normals), 3), real)
    if not moved.all():
        for rows in row_blocks(len(normals)):
            wide = np.asarray(normals[rows], np.float64)
            unplaced[rows] = wide if is_unit else unit(wide)
    if not moved.any():
        return unplaced if counts is not None or len(matrices) == 1 else np.tile(unplaced, (len(matrices), 1))
    return _placed(unplaced, about_one(normals), moved, _cofactors(matrices[moved], mirrored[moved]), counts, unit)


def placed_tangents(tangents: Array, matrices: Floats, mirrored: Bools) -> Floats:
    """Return tangents (V, 4) under placements: (K V, 4), unit or 0. A placement that mirrors turns the bitangent round: it
    goes with the surface, as the tangent does, but the product of normal and tangent does not."""
    wide, moved = np.asarray(tangents[:, :3], np.float64), ~plain(matrices)
    sides = np.where(tangents[:, 3] < 0.0, -1.0, 1.0) * np.where(mirrored, -1.0, 1.0)[:, None]
    unplaced, vectors = wide if moved.all() else unit(wide), about_one(wide) if moved.any() else wide
    found = np.empty((sides.size, 4))
    found[:, :3] = _placed(unplaced, vectors, moved, about_one(matrices[moved, :3, :3]), None, unit)
    found[:, 3] = np.where(found[:, :3].any(axis=1), sides.ravel(), 0.0)
    return found
