"""Vertices, normals and tangents under the placements of instances, in float64, each operation rounded by itself:
kernels/placements.clh does the same on the device, hence the same bits."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.geometry import row_blocks
from .shading_tables import Real

_BLOCK = 1 << 14  # vectors at once: their temporary arrays stay in the cache


def plain(matrices: Floats) -> Bools:
    """Return which placements (K, 4, 4) are identities, (K,): their vertices are used as they are."""
    same: Bools = (matrices == np.eye(4)).all(axis=(1, 2))
    return same


def mirrors(matrix: Floats) -> bool:
    """Return whether a placement (4, 4) mirrors, see `mirroring`."""
    return bool(mirroring(np.asarray(matrix, np.float64)[None])[0])


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
        mirrored[k] = _determinant(rows[k]) < 0
    return mirrored


def _determinant(rows: Floats) -> Fraction:
    a, b, c, d, e, f, g, h, i = map(Fraction, rows.ravel().tolist())
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)


def _blocks(count: int, rows: int) -> Iterator[slice]:
    """Return slices of so many placements, each of so many vectors."""
    return row_blocks(count, max(1, _BLOCK // max(rows, 1)))


def _products(vectors: Floats, matrices: Floats) -> Floats:
    """Return the products of matrices (..., 3, 3) and vectors (V, 3), which broadcast: (..., V, 3)."""
    x, y, z = vectors.T
    found = np.empty((*np.broadcast_shapes(matrices.shape[:-2], x.shape), 3))
    for i in range(3):
        row = matrices[..., i, :]
        found[..., i] = (row[..., 0] * x + row[..., 1] * y) + row[..., 2] * z
    return found


def placed_points(points: Array, matrices: Floats) -> Array:
    """Return points (V, 3) under placements (K, 4, 4): (K V, 3) float64, or of their own type if nothing moves them."""
    identities = plain(matrices)
    if identities.all():
        return points if len(matrices) == 1 else np.tile(points, (len(matrices), 1))
    wide = np.asarray(points, np.float64)
    found = np.empty((len(matrices), len(points), 3))
    with np.errstate(over="ignore", invalid="ignore"):
        for block in _blocks(len(matrices), len(points)):
            found[block] = _products(wide, matrices[block, None, :3, :3]) + matrices[block, None, :3, 3]
    found[identities] = wide
    return found.reshape(-1, 3)


def placed_along(points: Array, matrices: Floats, axis: int) -> Floats:
    """Return the coordinates along one axis of points (V, 3) under placements (K, 4, 4): (K, V)."""
    x, y, z = np.asarray(points, np.float64).T
    row = matrices[:, axis, :, None]
    with np.errstate(over="ignore", invalid="ignore"):
        found: Floats = ((row[:, 0] * x + row[:, 1] * y) + row[:, 2] * z) + row[:, 3]
    return found


def placed_each(points: Floats, matrices: Floats, identities: Bools) -> Floats:
    """Return points (C, N, 3), those of each row under a placement of its own, (C, 3, 4)."""
    x, y, z = (points[..., k, None] for k in range(3))
    a, b, c, shift = (matrices[:, None, :, k] for k in range(4))
    with np.errstate(over="ignore", invalid="ignore"):
        placed = ((a * x + b * y) + c * z) + shift
    return np.where(identities[:, None, None], points, placed)


def about_one(vectors: Array) -> Floats:
    """Return vectors (V, N) times powers of two, so that their largest components are about 1: products neither overflow
    nor underflow."""
    wide = np.asarray(vectors, np.float64)
    scaled: Floats = np.ldexp(wide, -np.frexp(np.abs(wide).max(axis=1, keepdims=True, initial=0.0))[1])
    return scaled


def directions(matrices: Floats) -> Floats:
    """Return the matrices (K, 3, 3) of placements (K, 4, 4), each times a power of two likewise."""
    rows = matrices[:, :3, :3]
    scaled: Floats = np.ldexp(rows, -np.frexp(np.abs(rows).max(axis=(1, 2), keepdims=True))[1])
    return scaled


def _cofactors(matrices: Floats, mirrored: Bools) -> Floats:
    """Return (K, 3, 3), which transform normals, even under singular placements."""
    m = directions(matrices)
    following = [1, 2, 0], [2, 0, 1]
    a, b = (m[:, rows] for rows in following)
    found = np.empty_like(m)
    for i, (j, k) in enumerate(zip(*following, strict=True)):
        found[:, :, i] = a[:, :, j] * b[:, :, k] - a[:, :, k] * b[:, :, j]
    found[mirrored] = -found[mirrored]
    return found


def unit(vectors: Floats) -> Floats:
    """Return unit vectors (..., 3), 0 for those without a direction."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True, initial=0.0)
        x, y, z = (scaled[..., k] for k in range(3))
        found = scaled / np.sqrt((x * x + y * y) + z * z)[..., None]
    return np.where(np.isfinite(found), found, 0.0)


def placed_normals(
    normals: Array, matrices: Floats, mirrored: Bools, real: Real = np.float64, *, is_unit: bool = False
) -> Array:
    """Return unit normals under placements (K, 4, 4), 0 for those without a direction: (K V, 3), rounded to `real`.

    normals: (V, 3) in object space. mirrored: (K,), of `mirroring`: the front stays in front. is_unit: whether the normals
    are unit vectors, which an identity leaves as they are.
    """
    identities = plain(matrices)
    found = np.empty((len(matrices), len(normals), 3), real)
    if identities.any():
        for rows in row_blocks(len(normals)):
            wide = np.asarray(normals[rows], np.float64)
            found[identities, rows] = wide if is_unit else unit(wide)
    moved = np.flatnonzero(~identities)
    if len(moved):
        scaled, cofactors = about_one(normals), _cofactors(matrices[moved], mirrored[moved])
        for block in _blocks(len(moved), len(normals)):
            found[moved[block]] = unit(_products(scaled, cofactors[block, None]))
    return found.reshape(-1, 3)


def points_by_mesh(points: Array, matrices: Floats, counts: Integers) -> Array:
    """Return points (V, 3) of meshes, as many as `counts` (K,) of each, under their placements (K, 4, 4), with the bits of
    `placed_points`: (V, 3) float64, or of their own type if nothing moves them."""
    identities = plain(matrices)
    if identities.all():
        return points
    placed: Array = np.array(points, np.float64)
    moved = np.repeat(~identities, counts)
    own = np.repeat(matrices[~identities], counts[~identities], axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        placed[moved] = _products(placed[moved], own[:, :3, :3]) + own[:, :3, 3]
    return placed


def normals_by_mesh(
    normals: Array,
    matrices: Floats,
    mirrored: Bools,
    counts: Integers,
    real: Real = np.float64,
    *,
    is_unit: bool = False,
) -> Array:
    """Return unit normals (V, 3) of meshes under their placements as `points_by_mesh`, with the bits of `placed_normals`."""
    identities = plain(matrices)
    wide = np.asarray(normals, np.float64)
    found = np.array(wide if is_unit else unit(wide), real)
    if not identities.all():
        moved = np.repeat(~identities, counts)
        own = np.repeat(_cofactors(matrices[~identities], mirrored[~identities]), counts[~identities], axis=0)
        found[moved] = unit(_products(about_one(wide[moved]), own))
    return found


def placed_tangents(tangents: Array, matrices: Floats, mirrored: Bools) -> Floats:
    """Return tangents (V, 4) under placements: (K V, 4), unit or 0. A placement that mirrors turns the bitangent round: it
    goes with the surface, as the tangent does, but the product of normal and tangent does not."""
    wide, identities = np.asarray(tangents[:, :3], np.float64), plain(matrices)
    sides = np.where(tangents[:, 3] < 0.0, -1.0, 1.0) * np.where(mirrored, -1.0, 1.0)[:, None]
    found = np.zeros((len(matrices), len(wide), 4))
    if identities.any():
        found[identities, :, :3] = unit(wide)
    moved = np.flatnonzero(~identities)
    if len(moved):
        scaled, m = about_one(wide), directions(matrices[moved])
        for block in _blocks(len(moved), len(wide)):
            found[moved[block], :, :3] = unit(_products(scaled, m[block, None]))
    found[:, :, 3] = np.where(found[:, :, :3].any(axis=2), sides, 0.0)
    return found.reshape(-1, 4)
