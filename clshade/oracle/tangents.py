"""Tangents at the corners of faces, as MikkTSpace defines them: one group of faces around a vertex after the other."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats
from .vectors import dot, unit


def corner_tangents(points: Floats, normals: Floats, uvs: Floats) -> Floats:
    """Return tangents (F, 3, 4) at the corners of F faces, 0 where they have none.

    points, normals (unit or 0): (F, 3, 3), uvs: (F, 3, 2) at the corners; v = 0 is the top row of the image, and the
    bitangent w * cross(normal, tangent) points up in it. After M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited"
    (2008), section 3.2 and appendix C, with the default threshold of 180 degrees.
    """
    found = np.zeros((len(points), 3, 4))
    if not len(points):
        return found
    vertex = _vertices(points, normals, uvs)
    faces = [f for f in range(len(points)) if len({tuple(p) for p in points[f].tolist()}) == 3]
    along, counter_clockwise, free = _directions(points, uvs)
    shares = np.where(np.array(free)[:, None, None], 0.0, _shares(points, normals, along))
    for members in _groups(vertex, faces, counter_clockwise, free):
        tangent = unit(np.sum([shares[member] for member in members], axis=0))
        if tangent.any():
            side = -1.0 if counter_clockwise[members[0][0]] else 1.0
            for face, corner in members:
                found[face, corner] = *tangent, side
    return found


def _vertices(points: Floats, normals: Floats, uvs: Floats) -> list[list[int]]:
    """Return the number of the vertex at each corner; equal corners are one."""
    seen: dict[tuple[float, ...], int] = {}
    rows = np.concatenate([points, normals, uvs.astype(np.float32)], axis=2) + 0.0
    return [[seen.setdefault(tuple(corner), len(seen)) for corner in face] for face in rows.tolist()]


def _directions(points: Floats, uvs: Floats) -> tuple[Floats, list[bool], list[bool]]:
    """Return per face the unit direction in which u grows, whether its texture coordinates are counter-clockwise, and
    whether they have no area and leave both open. That is decided in float32, as the reference does."""
    texture = uvs.astype(np.float32)
    t1, t2 = texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]
    area = t1[:, 0] * t2[:, 1] - t1[:, 1] * t2[:, 0]
    t1, t2 = t1.astype(np.float64), t2.astype(np.float64)
    d1, d2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    along = t2[:, 1, None] * d1 - t1[:, 1, None] * d2
    down = t1[:, 0, None] * d2 - t2[:, 0, None] * d1
    free = (area == 0.0) | ~along.any(axis=1) | ~down.any(axis=1)
    return unit(np.where(area > 0.0, 1.0, -1.0)[:, None] * along), (area > 0.0).tolist(), free.tolist()


def _neighbors(vertex: list[list[int]], faces: list[int]) -> dict[tuple[int, int], tuple[int, int]]:
    """Return for the edge from a face's corner to the next, (face, corner), the edge of another face that runs the
    other way. An edge that more faces share goes to the first that are free."""
    waiting: dict[tuple[int, int], list[tuple[int, int]]] = {}
    found = {}
    for face in faces:
        for corner in range(3):
            start, end = vertex[face][corner], vertex[face][(corner + 1) % 3]
            others = waiting.get((end, start), [])
            if others:
                other = others.pop(0)
                found[face, corner], found[other] = other, (face, corner)
            else:
                waiting.setdefault((start, end), []).append((face, corner))
    return found


def _groups(
    vertex: list[list[int]], faces: list[int], counter_clockwise: list[bool], free: list[bool]
) -> list[list[tuple[int, int]]]:
    """Return the groups of corners (face, corner) that share a tangent. A free face takes the side of the first group that
    reaches it, which is noted in `counter_clockwise`."""
    neighbor = _neighbors(vertex, faces)
    assigned: set[tuple[int, int]] = set()
    groups = []
    for face in faces:
        for corner in range(3):
            if free[face] or (face, corner) in assigned:
                continue
            side, members, todo = counter_clockwise[face], [], [(face, corner)]
            while todo:
                f, k = todo.pop()
                if (f, k) in assigned:
                    continue
                if free[f] and not any((f, c) in assigned for c in range(3)):
                    counter_clockwise[f] = side
                if counter_clockwise[f] != side:
                    continue
                assigned.add((f, k))
                members.append((f, k))
                for edge in ((f, k), (f, (k + 2) % 3)):  # the two edges at this corner
                    if edge in neighbor:
                        other = neighbor[edge][0]
                        todo.append((other, vertex[other].index(vertex[face][corner])))
            groups.append(members)
    return groups


def _shares(points: Floats, normals: Floats, along: Floats) -> Floats:
    """Return (F, 3, 3) the direction of u in the plane of each corner's normal, normalized, times the face's angle there."""
    first, second = (unit(_in_plane(points[:, [k % 3 for k in (n, n + 1, n + 2)]] - points, normals)) for n in (1, 2))
    angle = np.arccos(np.clip(dot(first, second), -1.0, 1.0))
    shares: Floats = unit(_in_plane(along[:, None], normals)) * angle[..., None]
    return shares


def _in_plane(vector: Floats, normal: Floats) -> Floats:
    return vector - dot(vector, normal)[..., None] * normal
