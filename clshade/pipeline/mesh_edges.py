"""The edges of a scene's faces: which faces share them, and of which kind they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.edges import Edges


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """E edges, of vertices that are welded where their positions are equal.

    ends: (E, 2) indices of positions. starts: (E,) index of each edge's first entry in `faces` and `forward`; the others
    follow. counts: (E,) how many. faces: (K,) faces, ascending for each edge. forward: (K,) whether the face runs along
    the edge from its first end to its second.
    """

    ends: Integers
    starts: Integers
    counts: Integers
    faces: Integers
    forward: Bools

    def __len__(self) -> int:
        return len(self.ends)

    def sums(self, values: Array) -> Integers:
        """Return (E,): the sums of `values` (K,) over the faces of each edge."""
        total = np.concatenate([[0], np.cumsum(values, dtype=np.int64)])
        summed: Integers = total[self.starts + self.counts] - total[self.starts]
        return summed


def weld(positions: Array) -> Integers:
    """Return (V,): for each position (V, 3) the index of the first one equal to it; -0.0 equals 0.0."""
    order = np.lexsort(positions.T)  # stable: of equal ones the first comes first
    ordered = positions[order]
    new = np.ones(len(order), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    welded = np.empty(len(order), np.int64)
    welded[order] = order[new][np.cumsum(new) - 1] if len(order) else order
    return welded


def mesh_edges(positions: Array, faces: Array) -> MeshEdges:
    """Return the edges of faces (F, 3) between positions (V, 3). A face with two corners at the same place has none."""
    corners = weld(positions)[faces]
    a, b, c = corners.T
    whole = np.flatnonzero((a != b) & (b != c) & (c != a))
    corners = corners[whole]
    start, end = corners.reshape(-1), corners[:, [1, 2, 0]].reshape(-1)
    face = np.repeat(whole, 3)
    forward = start < end
    low, high = np.where(forward, start, end), np.where(forward, end, start)
    order = np.lexsort((face, high, low))
    low, high = low[order], high[order]
    new = np.ones(len(order), bool)
    new[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    starts = np.flatnonzero(new)
    counts = np.diff(np.append(starts, len(order)))
    return MeshEdges(np.stack([low[starts], high[starts]], axis=1), starts, counts, face[order], forward[order])


def face_normals(positions: Array, faces: Array) -> Floats:
    """Return (F, 3) float64: the cross products of the faces' sides, not of unit length."""
    p = positions[faces].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        u, v = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        normals: Floats = np.stack(
            [
                u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1],
                u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2],
                u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0],
            ],
            axis=1,
        )
    return normals


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]
    return product


def sharp(edges: MeshEdges, normals: Floats, angle: float) -> Bools:
    """Return (E,) bool: the edges of two faces whose normals (F, 3) differ by more than `angle`, degrees. Faces without
    area have no normal, and faces that wind the other way have it turned."""
    found = np.zeros(len(edges), bool)
    pairs = np.flatnonzero(edges.counts == 2)
    first = edges.starts[pairs]
    a, b = (normals[edges.faces[first + k]] for k in (0, 1))
    turned = np.where(edges.forward[first] == edges.forward[first + 1], -1.0, 1.0)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        a, b = (v / np.abs(v).max(axis=1, initial=0.0, keepdims=True) for v in (a, b))  # squares stay in range
        cosine = turned * _dot(a, b) / np.sqrt(_dot(a, a) * _dot(b, b))
        found[pairs] = cosine < np.cos(np.radians(angle))  # false for NaN
    return found


def always_drawn(edges: MeshEdges, asked: Edges, normals: Floats) -> Bools:
    """Return (E,) bool: the edges of the kinds asked for that do not depend on the camera."""
    found = np.full(len(edges), "all" in asked.kinds)
    if "boundary" in asked.kinds or "silhouette" in asked.kinds:
        found |= edges.counts == 1
    if "nonmanifold" in asked.kinds:
        found |= edges.counts > 2
    if "feature" in asked.kinds:
        found |= sharp(edges, normals, asked.angle)
    return found


def facing(positions: Array, faces: Array, normals: Floats, eye: Floats, axis: Floats | None) -> Integers:
    """Return (F,): 1 for faces seen from the front, -1 for others, 0 for faces without area. axis: (3,) the viewing
    direction of an orthographic camera, else None."""
    if axis is None:
        with np.errstate(over="ignore", invalid="ignore"):
            side = _dot(normals, eye - positions[faces[:, 0]].astype(np.float64))
    else:
        side = _dot(normals, np.broadcast_to(-axis, normals.shape))
    sides: Integers = np.where((normals == 0.0).all(axis=1), 0, np.where(side > 0.0, 1, -1))
    return sides


def outlines(edges: MeshEdges, facing: Integers) -> Bools:
    """Return (E,) bool: the edges whose faces with an area all lie on the same side of them, as seen from the eye."""
    side = np.where(edges.forward, 1, -1) * facing[edges.faces]
    one_side: Bools = np.abs(edges.sums(side)) == edges.sums(side != 0)
    return one_side
