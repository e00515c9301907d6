"""Normals with creases, welding of vertices, and orientation of faces by normals; vectorized."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Faces, Floats, connected_components
from ..base.validation import number
from .geometry import _exponent, _normalized, row_blocks, vertex_normals

# Degrees between two faces, up to which vertices apart at one place are a seam of a smooth surface.
SEAM = 30.0


def crease_normals(verts: ArrayLike, faces: ArrayLike, degrees: float) -> tuple[Floats, Faces]:
    """Return unit normals for the corners of a mesh whose edges with more than `degrees` between their faces are sharp.

    verts: (V, 3) finite positions; vertices at the same position count as one. faces: (F, 3) indices into verts.
    degrees: 0 to 180; at 0 every face is flat.
    Returns normals (K, 3) float64 and normal_faces (F, 3) int32 indices into them. Corners at a vertex that are
    connected by smooth edges share a normal: the sum of their faces' cross products, normalized; 0 where the faces
    have no area.

    Raises InputError unless degrees is a number from 0 to 180.
    """
    degrees = crease_angle("crease_normals", "degrees", degrees)
    verts, faces = np.asarray(verts, np.float64), np.asarray(faces, np.int32)
    cross = _crosses(verts, faces)
    count = len(faces)
    if degrees == 0.0 or not count:
        return _normalized(cross), np.repeat(np.arange(count, dtype=np.int32), 3).reshape(-1, 3)
    first, second = _smooth_pairs(welded(verts)[1][faces], _normalized(cross), math.cos(math.radians(degrees)))
    labels = connected_components(3 * count, first, second)
    used = np.flatnonzero(labels == np.arange(3 * count, dtype=np.int32))
    renumbered = np.zeros(3 * count, np.int32)
    renumbered[used] = np.arange(len(used), dtype=np.int32)
    corners = renumbered[labels]
    sums: Array = np.stack([np.bincount(corners, np.repeat(column, 3), len(used)) for column in cross.T], axis=1)
    return _normalized(sums), corners.reshape(-1, 3)


def seamless_normals(verts: ArrayLike, faces: ArrayLike, degrees: float = SEAM) -> Floats | None:
    """Return unit normals (V, 3) of a mesh whose vertices at one position are joined where there is only a seam.

    A seam is an edge of two faces with at most `degrees` between them whose ends are different vertices at the same places.
    All faces at a vertex share its normal, as in `geometry.vertex_normals`. Returns None if no vertices are joined.

    verts: (V, 3) finite. faces: (F, 3) indices into verts.
    """
    verts, faces = np.asarray(verts), np.asarray(faces, np.int32)
    kept, which = welded(verts)
    if len(kept) == len(verts):
        return None
    cross = _crosses(np.asarray(verts, np.float64), faces)
    pairs = _smooth_pairs(which[faces], _normalized(cross), math.cos(math.radians(degrees)))
    one, two = (faces.reshape(-1)[corners] for corners in pairs)
    apart = one != two
    if not apart.any():
        return None
    labels = connected_components(len(verts), one[apart], two[apart])
    return vertex_normals(verts, labels[faces])[labels]


def crease_angle(owner: str, name: str, value: Any) -> float:
    """Return a crease angle in degrees, from 0 to 180. Raises InputError for anything else."""
    return number(owner, name, value, least=0.0, most=180.0, expected="degrees from 0 to 180")


def _crosses(verts: Array, faces: Array) -> Array:
    """Return (F, 3) cross products of the faces' edges, times a power of two that keeps them in range."""
    a, b, c = (verts[faces[:, corner]] * 0.5 for corner in range(3))
    b, c = b - a, c - a
    scale = -max(_exponent(b), _exponent(c))
    return _cross(np.ldexp(b, scale).T, np.ldexp(c, scale).T)


def _cross(u: Array, v: Array) -> Array:
    """Return (F, 3) cross products of vectors (3, F); np.cross takes ten times as long for a few."""
    return np.stack([u[j] * v[k] - u[k] * v[j] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)


def flat_normals(one: Array, other: Array) -> Floats:
    """Return unit normals (F, 3) of faces with these edges, (3, F) each; 0 for one without area."""
    return _normalized(_cross(one, other))


def _smooth_pairs(faces: Array, normals: Array, least: float) -> tuple[Array, Array]:
    """Return pairs of corners (numbered 3 * face + corner) that share a normal, at both ends of each smooth edge.

    An edge is smooth if the unit `normals` (F, 3) of its two faces have a cosine of at least `least`. If more faces
    share an edge, consecutive ones are paired.
    """
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low.astype(np.int64) << 32 | high
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    one, two = order[same], order[same + 1]
    cosine = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3])
    smooth = (cosine >= least - 1e-12) & (low[one] != high[one])
    one, two = one[smooth], two[smooth]
    # The corner at the vertex of each edge with the lower index, and the one at the other.
    low_ends, high_ends = [], []
    for edge in (one, two):
        after = np.where(edge % 3 == 2, edge - 2, edge + 1)
        forward = start[edge] < end[edge]
        low_ends.append(np.where(forward, edge, after))
        high_ends.append(np.where(forward, after, edge))
    return np.concatenate([low_ends[0], high_ends[0]]), np.concatenate([low_ends[1], high_ends[1]])


def welded(verts: Array) -> tuple[Array, Array]:
    """Merge vertices at equal positions (-0.0 equals 0.0).

    verts: (V, 3) finite. Returns kept (W,), ascending indices of the first vertex at each position, and which (V,)
    int32, the row among these for every vertex.
    """
    bits = (np.ascontiguousarray(verts) + 0.0).view(np.uint32 if verts.dtype == np.float32 else np.uint64)
    hashed = np.zeros(len(verts), np.uint64)
    for column in bits.T:
        hashed = hashed * np.uint64(0x9E3779B97F4A7C15) + column
        for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):  # the finalizer of MurmurHash3
            hashed ^= hashed >> np.uint64(33)
            hashed *= np.uint64(factor)
        hashed ^= hashed >> np.uint64(33)
    _, first, which = np.unique(hashed, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    if not (bits[first[which]] == bits).all():  # a hash collision
        _, first, which = np.unique(bits, axis=0, return_index=True, return_inverse=True)
        which = which.reshape(-1)
    rank = np.argsort(first)
    place = np.empty(len(rank), np.int32)
    place[rank] = np.arange(len(rank), dtype=np.int32)
    return first[rank], place[which]


def against_normals(verts: Array, faces: Array, normals: Array, normal_faces: Array) -> Array:
    """Return (F,) bool: the faces that are clockwise as seen along their normals.

    verts: (V, 3), faces: (F, 3) indices into them. normals, normal_faces: likewise. The cross product of a face is
    compared with the sum of the finite normals at its corners; a face without area, or perpendicular to that sum, is not
    against it.
    """
    against = np.empty(len(faces), bool)
    if not np.isfinite(normals).all():
        normals = np.where(np.isfinite(normals), normals, normals.dtype.type(0.0))
    with np.errstate(over="ignore", invalid="ignore"):  # NaN compares as not against
        for block in row_blocks(len(faces)):
            a, b, c = (verts[corner] for corner in faces[block].T)
            one, two, three = (normals[corner] for corner in normal_faces[block].T)
            against[block] = (np.cross(b - a, c - a) * (one + two + three)).sum(axis=1) < 0.0
    return against
