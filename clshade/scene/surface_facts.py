"""Counts and sizes of the surface of a scene: its parts, open and branching edges, area."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, connected_components
from .geometry import _cross, _edge_exponent, _edges, row_blocks
from .model import Mesh, Scene
from .normals import welded

MOST_FACES = 1 << 22  # of which shapes and edges are counted: seconds, and some hundred MB


@dataclass(frozen=True)
class SurfaceFacts:
    """Counts and area of all triangles in world space; every instance counts.

    vertices: those of the meshes; positions: different ones. shapes: sets of triangles that are connected by vertices
    at equal positions, of whichever mesh. boundary_edges: edges of one triangle; non_manifold_edges: of more than two;
    a closed surface has neither. Triangles with two equal corners, which have no area, count in none of the three.
    positions, shapes and edges are None for more than MOST_FACES triangles.
    area: in squared scene units.
    """

    vertices: int
    triangles: int
    area: float
    positions: int | None = None
    shapes: int | None = None
    boundary_edges: int | None = None
    non_manifold_edges: int | None = None

    @property
    def closed(self) -> bool | None:
        """Whether there are shapes, and every edge has two triangles; None if edges were not counted."""
        if self.boundary_edges is None:
            return None
        return bool(self.shapes) and not (self.boundary_edges or self.non_manifold_edges)


def surface_facts(scene: Scene) -> SurfaceFacts:
    """Return counts and area of a scene's triangles."""
    vertices = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in scene.meshes)
    triangles = scene.face_count
    area = sum((_area(verts, faces) for mesh in scene.meshes for verts, faces in _placed(mesh)), 0.0)
    if triangles > MOST_FACES:
        return SurfaceFacts(vertices, triangles, area)
    return SurfaceFacts(vertices, triangles, area, *_topology(scene))


def _placed(mesh: Mesh) -> Iterator[tuple[Array, Array]]:
    """Yield the vertices (K, 3) float64 in world space and the faces (F, 3) of some instances after the other; none for a
    mesh without faces."""
    placements = np.asarray(mesh.instances) if len(mesh.faces) else np.zeros((0, 4, 4))
    verts, faces = mesh.verts.astype(np.float64), mesh.faces.astype(np.int64)
    many = max(1, (1 << 14) // len(verts))
    for first in range(0, len(placements), many):
        some = placements[first : first + many]
        placed = verts @ some[:, :3, :3].transpose(0, 2, 1) + some[:, None, :3, 3]
        placed[(some == np.eye(4)).all(axis=(1, 2))] = verts
        starts = len(verts) * np.arange(len(some))
        yield placed.reshape(-1, 3), (faces + starts[:, None, None]).reshape(-1, 3)


def _area(verts: Array, faces: Array) -> float:
    """Return the area of triangles, scaled by a power of two meanwhile so that squares neither overflow nor vanish."""
    exponent, total = _edge_exponent(verts, faces), 0.0
    for block in row_blocks(len(faces)):
        edges = _edges(verts, faces[block], exponent)
        squares = sum(np.square(_cross(edges, axis)) for axis in range(3))
        total += float(np.sqrt(squares).sum())
    with np.errstate(over="ignore", under="ignore"):
        return float(np.ldexp(2.0 * total, 2 * exponent))  # half of the cross product of edges, which are halved


def _topology(scene: Scene) -> tuple[int, int, int, int]:
    """Return the numbers of positions, shapes, boundary and non-manifold edges."""
    points, faces, count = [], [], 0
    for mesh in scene.meshes:
        for verts, own in _placed(mesh):
            points.append(verts)
            faces.append(own + count)
            count += len(verts)
    if not points:
        return 0, 0, 0, 0
    corners = welded(np.concatenate(points))[1][np.concatenate(faces)]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    edges, uses = np.unique(np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end), return_counts=True)
    used = np.unique(corners)
    labels = connected_components(int(used.max(initial=-1)) + 1, edges >> 32, edges & 0xFFFFFFFF)
    shapes = int(np.count_nonzero(labels[used] == used))
    return len(used), shapes, int(np.count_nonzero(uses == 1)), int(np.count_nonzero(uses > 2))
