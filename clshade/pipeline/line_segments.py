"""The segments that edges make in the image: clipped, projected and snapped as the corners of triangles are."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from . import clip
from .camera_space import CameraSpace
from .struct_layout import GUARD_PIXELS, MOST_DEPTH, SUBPIXEL_BITS, TILE_SIZE, Structs

# The visibility of a line is not asked nearer to its ends than this, 1/256 px, nor beyond its middle: at the end itself
# any triangle that shares the vertex is as near.
_INSET = 64


def _keep_inside(points: Floats, distance: Floats) -> tuple[Floats, Bools]:
    """Cut segments (L, 2, 3) to where the distance (L, 2) of their points is not negative. Returns the points, and which
    are new, (L, 2); segments wholly outside must not be given.

    A crossing is computed from the end nearer the plane: an end 1e38 away costs no digits.
    """
    outside = distance < 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        near = np.abs(distance[:, 0]) <= np.abs(distance[:, 1])
        a = np.where(near[:, None], points[:, 0], points[:, 1])
        b = np.where(near[:, None], points[:, 1], points[:, 0])
        da = np.where(near, distance[:, 0], distance[:, 1])
        db = np.where(near, distance[:, 1], distance[:, 0])
        crossing = a + (da / (da - db))[:, None] * (b - a)
    return np.where(outside[..., None], crossing[:, None], points), outside


def _clipped(points: Floats, space: CameraSpace) -> tuple[Floats, Integers]:
    """Clip segments (L, 2, 3), camera space, to the near plane and the guard band. Returns those that are left, (K, 2, 3),
    and their indices (K,)."""
    camera = space.camera
    index = np.flatnonzero((points[..., 2] >= space.near).any(axis=1))
    points, made = _keep_inside(points[index], points[index][..., 2] - space.near)
    points[..., 2] = np.where(made, space.near, points[..., 2])
    lengths = 1.0 if camera.orthographic else camera.focal
    for axis in (0, 1):
        size = camera.resolution[axis]
        slope, center = lengths * size / camera.plane[1 - axis], camera.principal[axis] * size
        for side in (1.0, -1.0):
            depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
            distance = (GUARD_PIXELS + side * center) * depth + side * slope * points[..., axis]
            kept = (distance >= 0.0).any(axis=1)
            if not (distance < 0.0).any():
                continue
            index = index[kept]
            points, made = _keep_inside(points[kept], distance[kept])
            depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
            points[..., axis] = np.where(made, -side * (GUARD_PIXELS + side * center) * depth / slope, points[..., axis])
    return points, index


def segments(ends: Array, space: CameraSpace, width: int, structs: Structs) -> tuple[Array, Integers]:
    """Return a table (L,) of `structs.Line`, without what concerns faces, of the edges that may reach the image, and their
    indices (L,).

    ends: (E, 2, 3) world positions. width: of the lines, 1/256 px.
    """
    points, index = _clipped(space.points(ends), space)
    xy = clip.snap(clip.image_positions(points, space.camera))
    size = np.array(space.camera.resolution) << SUBPIXEL_BITS
    reach = (width + 1) // 2
    seen = ((xy.max(axis=1) >= -reach) & (xy.min(axis=1) <= size + reach)).all(axis=1)
    points, index, xy = points[seen], index[seen], xy[seen]
    lines = np.zeros(len(index), structs.Line)
    lines["x"], lines["y"] = xy[..., 0], xy[..., 1]
    z = np.minimum(points[..., 2] * space.scale, MOST_DEPTH)
    lines["w"] = -z if space.camera.orthographic else 1.0 / z
    with np.errstate(divide="ignore"):
        dx, dy = (xy[:, 1] - xy[:, 0]).astype(np.float64).T
        lines["inset"] = np.minimum(_INSET / np.sqrt(dx * dx + dy * dy), 0.5)
    return lines, index


def line_grid(space: CameraSpace, width: int, structs: Structs) -> Array:
    """Return the one row of `structs.LineGrid`: the tiles of the image and of as many around it as a line reaches."""
    margin = -(-width // (2 * TILE_SIZE << SUBPIXEL_BITS))
    columns, rows = space.camera.resolution
    grid = np.zeros(1, structs.LineGrid)
    grid["margin"], grid["width"] = margin, width
    grid["across"], grid["up"] = -(-columns // TILE_SIZE) + 2 * margin, -(-rows // TILE_SIZE) + 2 * margin
    return grid
