"""Clipping in camera space: near plane and guard band. Triangles that need neither pass through unchanged.

A crossing is computed from the edge's end points in a canonical order (nearer the plane, then smaller (x, y, z),
first), so that the triangles on both sides of an edge share it, and an end 1e38 away costs no digits. Attributes at clip
points are interpolated by their barycentric coordinates in the original triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.camera import Camera
from .transform import project, snap

GUARD = (-8191.0, 24575.0)  # pixels: differences of snapped coordinates then stay below 2^31


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles ready for rasterization, in the order of their faces."""

    face: Integers  # (K,) that they belong to
    xy: Integers  # (K, 3, 2) snapped corners, int64
    z: Floats  # (K, 3) corner depths, all > 0
    weights: Floats  # (K, 3, 3), rows are corners: weights of the face's original corners, whose sum is 1


def clip_polygon(points: Floats, weights: Floats, distance: Floats) -> tuple[Floats, Floats, Bools]:
    """Clip a polygon against one plane by Sutherland and Hodgman's algorithm.

    points: (n, 3), weights: (n, 3), distance: (n,) signed, >= 0 is inside. Returns the points and weights of the part
    inside, and which of them are crossings, (m,) bool.
    """
    inside: list[tuple[Floats, Floats, bool]] = []
    for i in range(len(points)):
        j = (i + 1) % len(points)
        if distance[i] >= 0.0:
            inside.append((points[i], weights[i], False))
        if (distance[i] >= 0.0) != (distance[j] >= 0.0):
            first = (abs(distance[i]), points[i].tolist()) <= (abs(distance[j]), points[j].tolist())
            a, b = (i, j) if first else (j, i)
            t = distance[a] / (distance[a] - distance[b])
            inside.append((points[a] + t * (points[b] - points[a]), weights[a] + t * (weights[b] - weights[a]), True))
    if not inside:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, bool)
    polygon, inherited, crossings = zip(*inside, strict=True)
    return np.array(polygon), np.array(inherited), np.array(crossings)


def clip_near(points: Floats, weights: Floats, near: float) -> tuple[Floats, Floats]:
    """Return the part with z >= near."""
    points, weights, crossing = clip_polygon(points, weights, points[:, 2] - near)
    points[crossing, 2] = near
    return points, weights


def clip_guard(points: Floats, weights: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """Return the part with u and v in the guard band; needs z > 0. Inside of its left, right, lower and upper plane is
    side*(slope*x + offset*z) >= 0, as u = slope*x/z + principal; orthographic z is 1."""
    for axis, side, limit in ((0, 1.0, GUARD[0]), (0, -1.0, GUARD[1]), (1, 1.0, GUARD[0]), (1, -1.0, GUARD[1])):
        slope = (1.0 if camera.orthographic else camera.focal) * camera.resolution[axis] / camera.plane[1 - axis]
        offset = camera.principal[axis] * camera.resolution[axis] - limit
        depth = 1.0 if camera.orthographic else points[:, 2]
        distance = side * (slope * points[:, axis]) + side * offset * depth
        points, weights, crossing = clip_polygon(points, weights, distance)
        # A crossing lies on the plane; on an edge from -1e38 to 1e38 no digit of that is left.
        depth = 1.0 if camera.orthographic else points[crossing, 2]
        points[crossing, axis] = -offset * depth / slope
        if len(points) == 0:
            break
    return points, weights


def beyond_guard(uv: Floats) -> Bools:
    """Return which triangles (or polygons) have a vertex outside the guard band; uv: (..., n, 2)."""
    return np.asarray(~((uv >= GUARD[0]) & (uv <= GUARD[1])).all(axis=(-1, -2)))


def clip_face(corners: Floats, near: float, camera: Camera) -> list[tuple[Floats, Floats]]:
    """Clip one triangle, camera space (3, 3), into a list of (points (3, 3), weights (3, 3)): none to a few triangles."""
    points, weights = corners, np.eye(3)
    if (points[:, 2] < near).any():
        points, weights = clip_near(points, weights, near)
    if len(points) == 0:
        return []
    uv = project(points, camera)
    if (uv < 0.0).all(axis=0).any() or (uv > np.array(camera.resolution)).all(axis=0).any():
        return []  # wholly to one side of the image
    if beyond_guard(uv):
        points, weights = clip_guard(points, weights, camera)
    fan = [[0, i, i + 1] for i in range(1, len(points) - 1)]
    return [(points[f], weights[f]) for f in fan if np.isfinite(points[f]).all()]


def pieces(corners: Floats, near: float, camera: Camera) -> Pieces:
    """Clip, project and snap triangles (F, 3, 3) of camera-space corners."""
    in_front = corners[:, :, 2] >= near
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        simple = in_front.all(axis=1) & ~beyond_guard(project(corners, camera))
        uncut = np.flatnonzero(simple)
        faces, points = [uncut], [corners[uncut]]
        weights = [np.broadcast_to(np.eye(3), (len(uncut), 3, 3))]
        for k in np.flatnonzero(in_front.any(axis=1) & ~simple):
            for piece_points, piece_weights in clip_face(corners[k], near, camera):
                faces.append(np.array([k]))
                points.append(piece_points[None])
                weights.append(piece_weights[None])
    face, point = np.concatenate(faces), np.concatenate(points)
    order = np.argsort(face, kind="stable")
    return Pieces(
        face=face[order],
        # Rounding can put a crossing of an edge 1e36 long beyond the guard band: clamp it, as `snap` requires.
        xy=snap(np.clip(project(point[order], camera), *GUARD)),
        z=point[order][:, :, 2],
        weights=np.concatenate(weights)[order],
    )
