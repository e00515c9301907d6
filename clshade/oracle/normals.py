"""Normals of vertices, how they are placed, and tangents at the corners of faces as MikkTSpace defines them."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Floats, Reals
from .transform import cross, dot, is_identity, length, mirroring, power_of_two, unit

CANCELED = 2.0**-40  # relative to the sizes of a vertex's faces: a smaller sum has no direction left


def vertex_normals(verts: Reals, faces: Array) -> tuple[Floats, Floats]:
    """Return the normals of a mesh from its shape: at each vertex the sum of its faces' cross products, normalized. Also
    return how far two computations in float64 may differ: (V,), absolute; 0 where there is no normal.

    verts: (V, 3), faces: (F, 3) indices. Normals are (V, 3): unit vectors, or 0 at a vertex that has no face, only faces
    without area, or faces that cancel up to rounding (2^-40 of their sizes). A larger face weighs more: its cross
    product is twice its area.

    A component of a x b is a difference of two products whose factors are rounded differences of coordinates: each
    product is accurate to 3 units of 2^-53, the difference to one more, so the vector to sqrt(2)*3 + 1 < 6 units of
    |a| |b|. That is much more than of |a x b| if a face is a sliver. A sum of m of them rounds m - 1 times. All this
    is relative to the length of the sum, and counts for both sides.
    """
    corners = np.asarray(verts, dtype=np.float64)[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    scale = power_of_two(np.maximum(np.abs(first), np.abs(second)).max(axis=0, initial=0.0))
    first, second = first / scale, second / scale  # no product overflows
    products = cross(first, second)
    total, areas, sizes, count = np.zeros((len(verts), 3)), *np.zeros((3, len(verts)))
    np.add.at(total, faces, products[:, None, :])
    np.add.at(areas, faces, np.abs(products).sum(axis=1)[:, None])
    np.add.at(sizes, faces, (length(first) * length(second))[:, None])
    np.add.at(count, faces, 1.0)
    canceled = np.abs(total).max(axis=1) <= CANCELED * areas
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = 2.0 * 2.0**-53 * (6.0 + count) * sizes / length(total)
    return unit(np.where(canceled[:, None], 0.0, total)), np.where(canceled, 0.0, errors)


def placed_normals(normals: Reals, matrix: Floats, error: Floats | float = 0.0) -> tuple[Floats, Floats]:
    """Transform normals (K, 3) by placements (..., 4, 4) and normalize them, (..., K, 3): directions go by the inverse
    transpose. Also return how far two computations in float64 may differ: (..., K), absolute; 0 where there is no normal.
    error: how far the normals themselves may differ, (K,).

    The inverse transpose is the matrix of cofactors divided by the determinant, of which only the sign matters here: a
    singular placement needs no special case. Zero normals stay zero.

    A cofactor is a difference of two products, accurate to 2 units of 2^-53 of the sum of their sizes, which is much more
    than the cofactor where the placement is nearly singular. A component of the normal is a sum of three products with
    a normalized direction: 4 units of the direction's components, 1 of each product and 2 of the sums add up to 9. All
    this is relative to the length of the sum, and counts for both sides. What the normals differ by themselves grows at
    most as the cofactors' norm.
    """
    directions, same = unit(np.asarray(normals, dtype=np.float64)), is_identity(matrix)[..., None]
    rows = matrix[..., :3, :3] / power_of_two(np.abs(matrix[..., :3, :3]).max(axis=-2))[..., None, None]
    a, b = rows[..., [1, 2, 0], :], rows[..., [2, 0, 1], :]
    cofactors = np.swapaxes(cross(a, b), -2, -1)
    placed = unit(directions @ np.where(mirroring(matrix)[..., None, None], -cofactors, cofactors))
    after, before = (np.roll(np.abs(a), -k, axis=-1) * np.roll(np.abs(b), k, axis=-1) for k in (1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        rounding = 2.0 * 2.0**-53 * 9.0 * length(np.abs(directions) @ np.swapaxes(after + before, -2, -1))
        growth = np.linalg.norm(cofactors, axis=(-2, -1))[..., None]
        errors = np.where(placed.any(axis=-1), (rounding + error * growth) / length(directions @ cofactors), 0.0)
    return np.where(same[..., None], directions, placed), np.where(same, error, errors)


# Tangents


def corner_tangents(points: Floats, normals: Floats, uvs: Floats) -> Floats:
    """Return tangents (F, 3, 4) at the corners of F faces, 0 where they have none.

    points, normals (unit or 0): (F, 3, 3), uvs: (F, 3, 2) at the corners; v = 0 is the top row of the image, and the
    bitangent w * cross(normal, tangent) points up in it. After M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited"
    (2008), section 3.2 and appendix C, with the default threshold of 180 degrees.
    """
    tangents = np.zeros((len(points), 3, 4))
    if not len(points):
        return tangents
    vertex = _vertices(points, normals, uvs)
    faces = [f for f in range(len(points)) if len({tuple(p) for p in points[f].tolist()}) == 3]
    along, counter_clockwise, free = _directions(points, uvs)
    shares = np.where(np.array(free)[:, None, None], 0.0, _shares(points, normals, along))
    for members in _groups(vertex, faces, counter_clockwise, free):
        tangent = unit(np.sum([shares[member] for member in members], axis=0))
        if tangent.any():
            side = -1.0 if counter_clockwise[members[0][0]] else 1.0
            for face, corner in members:
                tangents[face, corner] = *tangent, side
    return tangents


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
    opposite = {}
    for face in faces:
        for corner in range(3):
            start, end = vertex[face][corner], vertex[face][(corner + 1) % 3]
            others = waiting.get((end, start), [])
            if others:
                other = others.pop(0)
                opposite[face, corner], opposite[other] = other, (face, corner)
            else:
                waiting.setdefault((start, end), []).append((face, corner))
    return opposite


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
    """Return (F, 3, 3) the direction of u in the plane of each corner's normal, normalized, times the face's angle
    there."""
    first, second = (unit(_in_plane(points[:, [k % 3 for k in (n, n + 1, n + 2)]] - points, normals)) for n in (1, 2))
    angle = np.arccos(np.clip(dot(first, second), -1.0, 1.0))
    return np.asarray(unit(_in_plane(along[:, None], normals)) * angle[..., None])


def _in_plane(vector: Floats, normal: Floats) -> Floats:
    return vector - dot(vector, normal)[..., None] * normal
