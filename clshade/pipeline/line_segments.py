"""The segments that edges make in the image: clipped, projected and snapped as the corners of triangles are."""

from __future__ import annotations

import math

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from . import clip
from .camera_space import CameraSpace
from .struct_layout import LINE_INSET, MOST_DEPTH, SAMPLE_BITS, SNAP_LIMIT, SUBPIXEL_BITS, Structs

_LEAST_CELL, _LARGEST_CELL = 10, 12  # bits of 1/256 px: 4 to 16 px
_MOST_CELLS = 1 << 20


def _cut(points: Floats, distance: Floats) -> tuple[Floats, Bools]:
    """Cut segments (L, 2, 3) to where the distance (L, 2) of their points is not negative; of each at least one is not.
    Returns the points, and which are new, (L, 2).

    A crossing is computed from the end nearer the plane: an end 1e38 away costs no digits.
    """
    first = np.abs(distance[:, 0]) <= np.abs(distance[:, 1])
    order = np.where(first[:, None], [0, 1], [1, 0])
    a, b = (np.take_along_axis(points, order[:, [k], None], axis=1)[:, 0] for k in (0, 1))
    da, db = (np.take_along_axis(distance, order[:, [k]], axis=1) for k in (0, 1))
    outside = distance < 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        crossing = a + (da / (da - db)) * (b - a)
    return np.where(outside[..., None], crossing[:, None], points), outside


def _cut_to_guard_band(points: Floats, space: CameraSpace) -> tuple[Floats, Integers]:
    """Cut segments (L, 2, 3) before the eye to the guard band; return those that are left, and their indices."""
    camera, index = space.camera, np.arange(len(points))
    for axis, side, slope, offset in clip.guard_planes(camera):
        depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
        distance = side * (slope * points[..., axis]) + side * offset * depth
        kept = (distance >= 0.0).any(axis=1)
        points, made = _cut(points[kept], distance[kept])
        index = index[kept]
        depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
        points[..., axis] = np.where(made, -offset * depth / slope, points[..., axis])
    return points, index


def _clipped(points: Floats, space: CameraSpace) -> tuple[Floats, Integers]:
    """Clip segments (L, 2, 3), camera space, to the near plane and the guard band. Returns those that are left, (K, 2, 3),
    and their indices (K,)."""
    before = points[..., 2] >= space.near
    index = np.flatnonzero(before.any(axis=1))
    crossing = np.flatnonzero(~before[index].all(axis=1))
    points = points[index]
    cut, made = _cut(points[crossing], points[crossing][..., 2] - space.near)
    cut[..., 2] = np.where(made, space.near, cut[..., 2])
    points[crossing] = cut
    with np.errstate(over="ignore", invalid="ignore"):
        beyond = clip.beyond_guard_band(points, space.camera)
    far = np.flatnonzero(beyond.any(axis=(1, 2)))
    cut, left = _cut_to_guard_band(points[far], space)
    points[far[left]] = cut
    gone = np.zeros(len(points), bool)
    gone[far] = True
    gone[far[left]] = False
    return points[~gone], index[~gone]


def _scaled_w(z: Floats, space: CameraSpace) -> Floats:
    """Return 1/depth, scaled, of depths z, as `project` has it."""
    depth = np.minimum(z * space.scale, MOST_DEPTH)
    return -depth if space.camera.orthographic else 1.0 / depth


def _on_line_grid(snapped: Integers) -> Integers:
    """Round snapped positions to the samples' grid, 1/256 px, on which lines cover them: halves up."""
    shift = SUBPIXEL_BITS - SAMPLE_BITS
    return (snapped + (1 << shift - 1)) >> shift


def segments(
    ends: Integers, positions: Array, vertices: Array, space: CameraSpace, width: int, structs: Structs
) -> tuple[Array, Integers]:
    """Return a table (L,) of `structs.Line`, without what concerns faces, of the edges that may reach the image, and their
    indices (L,).

    ends: (E, 2) indices of positions (V, 3), world space, and of vertices (V,), what `project` makes of them. width: of
    the lines, 1/256 px.
    """
    before = vertices["depth"] >= space.near
    at = np.stack([vertices["x"], vertices["y"]], axis=-1).astype(np.int64)
    whole = (before & (np.abs(at) < SNAP_LIMIT).all(axis=1))[ends].all(axis=1)
    z = np.where(before, vertices["depth"], space.near)  # only those before the near plane are read
    index = np.flatnonzero(whole)
    xy, w = _on_line_grid(at[ends[index]]), _scaled_w(z, space)[ends[index]]
    rest = np.flatnonzero(before[ends].any(axis=1) & ~whole)
    if len(rest):
        points, left = _clipped(space.points(positions[ends[rest]]), space)
        index = np.concatenate([index, rest[left]])
        snapped = clip.snap(clip.image_positions(points, space.camera), space.raster)
        xy = np.concatenate([xy, _on_line_grid(snapped)])
        w = np.concatenate([w, _scaled_w(points[..., 2], space)])
    size = np.array(space.camera.resolution) << SAMPLE_BITS
    reach = (width + 1) // 2
    low, high = np.minimum(xy[:, 0], xy[:, 1]), np.maximum(xy[:, 0], xy[:, 1])
    seen = ((high >= -reach) & (low <= size + reach)).all(axis=1)
    if not seen.all():
        index, xy, w = index[seen], xy[seen], w[seen]
    lines = np.zeros(len(index), structs.Line)
    lines["x"], lines["y"], lines["w"] = xy[..., 0], xy[..., 1], w
    with np.errstate(divide="ignore"):
        dx, dy = (xy[:, 1] - xy[:, 0]).astype(np.float64).T
        lines["inset"] = np.minimum(LINE_INSET / np.sqrt(dx * dx + dy * dy), 0.5)
    return lines, index


def line_grid(lines: Array, space: CameraSpace, width: int, structs: Structs) -> Array:
    """Return the one row of `structs.LineGrid`: cells about as long as the lines (L,), over the image and as far
    around it as a line reaches. The cells change only how long the search for what hides a line takes."""
    reach, size = (width + 1) // 2, np.array(space.camera.resolution, np.int64) << SAMPLE_BITS
    dx, dy = (lines[name][:, 1].astype(np.float64) - lines[name][:, 0] for name in ("x", "y"))
    length = float(np.sqrt(dx * dx + dy * dy).mean()) if len(lines) else 0.0
    bits = min(max(math.ceil(math.log2(max(length, 1.0))), _LEAST_CELL), _LARGEST_CELL)
    while (size >> bits).prod() > _MOST_CELLS:
        bits += 1
    margin = -(-reach // (1 << bits))
    grid = np.zeros(1, structs.LineGrid)
    grid["cell_bits"], grid["margin"], grid["width"] = bits, margin, width
    grid["across"], grid["up"] = (-(-size // (1 << bits)) + 2 * margin).tolist()
    return grid
