"""Tangents of meshes for normal mapping, equal to those of MikkTSpace; vectorized.

M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited" (2008), describes the tangents that tools for baking normal maps
agree on. A normal map shows what its author saw only with the same tangents.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array, Bools, Faces, Floats, connected_components
from .geometry import next_corners, vertex_normals, welded
from .model import Mesh

_MAX_UV = 2.0**40  # see model.Mesh

_computed: WeakKeyDictionary[Mesh, dict[int, tuple[Floats, Faces]]] = WeakKeyDictionary()


def mesh_tangents(mesh: Mesh, coordinates: int = 0) -> tuple[Array, Faces]:
    """Return the tangents (K, 4) of a mesh and their indices (F, 3), in object space, for a normal map at the set of texture
    coordinates with this number: the mesh's own, else those of `corner_tangents`, kept as long as the mesh lives.

    Rows of 0 are corners without a direction: all corners of a mesh without texture coordinates.
    """
    if mesh.tangents is not None:
        return mesh.tangents, mesh.faces if mesh.tangent_faces is None else mesh.tangent_faces
    if mesh.uvs is None:
        return np.zeros((1, 4)), np.zeros_like(mesh.faces)
    cache = _computed.setdefault(mesh, {})
    if coordinates not in cache:
        normals, normal_faces = mesh.normals, mesh.faces if mesh.normal_faces is None else mesh.normal_faces
        if normals is None:
            normals = vertex_normals(mesh.verts, mesh.faces)
        uvs = (mesh.uvs, *mesh.more_uvs)[coordinates]
        uv_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        unit = _unit(np.asarray(normals, np.float64))
        cache[coordinates] = corner_tangents(mesh.verts, mesh.faces, unit, normal_faces, uvs, uv_faces)
    return cache[coordinates]


def corner_tangents(
    verts: Array, faces: Array, normals: Array, normal_faces: Array, uvs: Array, uv_faces: Array
) -> tuple[Floats, Faces]:
    """Return the tangents at the corners of a mesh, as MikkTSpace computes them.

    verts: (V, 3) finite positions. normals: (K, 3), unit or 0. uvs: (T, 2), with v = 0 at the top row of the image. faces,
    normal_faces, uv_faces: (F, 3) indices into them.
    Returns tangents (G, 4) float64 and tangent_faces (F, 3) int32 indices into them. The first three components are a
    unit vector, perpendicular to the normal, along which u grows; the fourth, 1 or -1, is the side of the bitangent
    w * cross(normal, tangent), along which v falls (glTF 2.0, section 3.7.2.1). Row 0 is 0: it belongs to corners
    without a direction, of faces whose texture coordinates have no area and whose neighbors give none.

    Corners with the same position, normal and texture coordinates count as one vertex. Its faces form groups: those
    connected by edges around it whose texture coordinates wind the same way. A group's tangent is the sum of its faces'
    directions of u, each projected onto the plane of the normal, normalized, and weighted by the face's angle there.
    MikkTSpace's default threshold of 180 degrees is used: nothing else separates directions.
    """
    corners, reals = _vertices(verts, faces, normals, normal_faces, uvs, uv_faces), np.asarray(verts, np.float64)
    # Over a power of two that keeps products within range.
    points = np.ldexp(reals, -int(np.frexp(np.abs(reals).max(initial=0.0))[1]))[faces]
    along, preserving, free = _directions(points, uvs, uv_faces)
    a, b, c = points[:, 0], points[:, 1], points[:, 2]
    real = (a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1)  # the others are never seen
    labels, preserving = _groups(corners, real, preserving, free)
    used = np.zeros(len(labels) + 1, np.int32)
    used[labels] = 1
    used[-1] = 0  # -1, the label of corners without a group
    first, tangent_faces = np.flatnonzero(used), (np.cumsum(used, dtype=np.int32) * used)[labels]
    counts = np.repeat(real & ~free, 3)
    across = np.asarray(normals, np.float64)[normal_faces].reshape(-1, 3)
    shares = _shares(points, across, along, counts)
    sums: Floats = np.stack(
        [np.bincount(tangent_faces[counts], column, len(first) + 1) for column in shares[counts].T], axis=1
    )
    tangents = np.zeros((len(first) + 1, 4))
    tangents[1:, :3] = _unit(sums)[1:]
    tangents[1:, 3] = np.where(preserving[first], -1.0, 1.0)  # v grows downward in the image, the bitangent upward
    tangents[~tangents[:, :3].any(axis=1), 3] = 0.0
    return tangents, tangent_faces.reshape(-1, 3)


def _unit(vectors: Floats) -> Floats:
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
    scaled = np.ldexp(vectors, -np.frexp(largest)[1])
    length = np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    return np.asarray(scaled / np.where(length > 0.0, length, 1.0))


def _vertices(verts: Array, faces: Array, normals: Array, normal_faces: Array, uvs: Array, uv_faces: Array) -> Array:
    """Return (F, 3) numbers of vertices: equal for corners with the same position, normal and texture coordinates."""
    attributes = (verts, faces), (normals, normal_faces), (_usable(uvs), uv_faces)
    numbers = [welded(rows)[1][index].reshape(-1) for rows, index in attributes]
    return welded(np.stack(numbers, axis=1).astype(np.float64))[1].reshape(faces.shape)


def _usable(uvs: Array) -> Array:
    """Return finite float32 texture coordinates; the reference computes in float32, which decides what has no area."""
    return np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -_MAX_UV, _MAX_UV).astype(np.float32)


def _directions(points: Floats, uvs: Array, uv_faces: Array) -> tuple[Floats, Bools, Bools]:
    """Return for faces with corners points (F, 3, 3): the unit direction of u in space (F, 3), or 0; whether their texture
    coordinates are counter-clockwise (F,); and whether they give no directions, so that a face joins its neighbors' groups
    (F,)."""
    t = _usable(uvs)[uv_faces]
    (x1, y1), (x2, y2) = (t[:, 1] - t[:, 0]).T, (t[:, 2] - t[:, 0]).T
    area = x1 * y2 - y1 * x2
    d1, d2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    along = y2[:, None].astype(np.float64) * d1 - y1[:, None].astype(np.float64) * d2
    down = x1[:, None].astype(np.float64) * d2 - x2[:, None].astype(np.float64) * d1
    free = (area == 0.0) | ~along.any(axis=1) | ~down.any(axis=1)
    return np.where(area > 0.0, 1.0, -1.0)[:, None] * _unit(along), area > 0.0, free


def _opposite_edges(corners: Array, real: Bools) -> tuple[Array, Array]:
    """Return pairs of edges (numbered 3 * face + corner that they begin at) that two faces share in opposite directions. If
    several faces share one, the k-th of each direction form a pair."""
    start = corners.reshape(-1).astype(np.int64)
    end = np.roll(corners, -1, axis=1).reshape(-1).astype(np.int64)
    edges = np.flatnonzero(np.repeat(real, 3))
    low, high = np.minimum(start[edges], end[edges]), np.maximum(start[edges], end[edges])
    key = (low * (int(corners.max(initial=0)) + 1) + high) * 2 + (start[edges] > end[edges])
    order = np.argsort(key, kind="stable")
    key, edges = key[order], edges[order]
    rank = np.arange(len(key)) - np.searchsorted(key, key)
    order = np.lexsort((key & 1, rank, key >> 1))
    before, after = order[:-1], order[1:]
    pairs = (key[before] ^ key[after] == 1) & (rank[before] == rank[after])
    return edges[before[pairs]], edges[after[pairs]]


def _groups(corners: Array, real: Bools, preserving: Bools, free: Bools) -> tuple[Array, Bools]:
    """Return labels (3F,) of the corners' groups, each a corner of the group, -1 for none; and (3F,) bool whether a
    corner's face is counter-clockwise in the texture, as its group is."""
    one, two = _opposite_edges(corners, real)
    first, second = np.concatenate([one, next_corners(one)]), np.concatenate([next_corners(two), two])
    join = (free & real).any()
    preserving, free = np.repeat(preserving, 3), np.repeat(free, 3)
    alike = (preserving[first] == preserving[second]) & ~free[first] & ~free[second]
    labels = connected_components(3 * len(corners), first[alike], second[alike]).astype(np.int64)
    labels[free | np.repeat(~real, 3)] = -1
    if join:
        _join_free(labels, preserving, free, first, second)
    return labels, preserving


def _join_free(labels: Array, preserving: Bools, free: Bools, first: Array, second: Array) -> None:
    """Let faces without directions join the groups around them, in place: face by face, corner by corner, as the order
    decides which side of the texture such a face takes. Only fans with both kinds of faces are visited."""
    fans = connected_components(len(labels), first, second)
    both = [np.bincount(fans[corners], minlength=len(fans)) > 0 for corners in (free, ~free & (labels >= 0))]
    visited = np.flatnonzero((both[0] & both[1])[fans])
    if not len(visited):
        return
    near: dict[int, list[int]] = {corner: [] for corner in visited.tolist()}
    for a, b in zip(first.tolist(), second.tolist(), strict=True):
        if a in near:
            near[a].append(b)
            near[b].append(a)
    labels[visited] = -1
    settled: set[int] = set()  # faces without directions that have a side
    for start in visited.tolist():
        if free[start] or labels[start] >= 0:
            continue
        side, stack = bool(preserving[start]), [start]
        while stack:
            corner = stack.pop()
            face = corner // 3
            if labels[corner] >= 0:
                continue
            if free[corner] and face not in settled:
                settled.add(face)
                preserving[3 * face : 3 * face + 3] = side
            if preserving[corner] == side:
                labels[corner] = start
                stack += near[corner]


def _shares(points: Floats, normals: Floats, along: Floats, counts: Bools) -> Floats:
    """Return (3F, 3) the corners' contributions to their groups: the direction of u in the plane of the normal, normalized,
    times the corner's angle there. counts: (3F,) the corners that do."""
    shares = np.zeros((len(normals), 3))
    for corner in range(3):
        mine = counts[corner::3]
        normal, here = normals[corner::3][mine], points[mine, corner]
        before = _unit(_in_plane(points[mine, corner - 1] - here, normal))
        after = _unit(_in_plane(points[mine, (corner + 1) % 3] - here, normal))
        angle = np.arccos(np.clip((before * after).sum(axis=1), -1.0, 1.0))
        rows = np.flatnonzero(mine) * 3 + corner
        shares[rows] = _unit(_in_plane(along[mine], normal)) * angle[:, None]
    return shares


def _in_plane(vectors: Floats, normal: Floats) -> Floats:
    return np.asarray(vectors - (vectors * normal).sum(axis=1, keepdims=True) * normal)
