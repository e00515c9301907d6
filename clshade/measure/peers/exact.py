"""The exact answer: what is at the center of each pixel, in float64, from the vertices as they are.

Unlike the oracle's, its projected vertices are on no grid, so that renderers that have one are not favored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Bools, Floats, Integers
from ...scene.model import Scene
from ...scene.seen_points import in_image, pixel_rays
from .drawing import lambert, mesh_of

# Pixels whose center is no farther than this from an edge are on it. Projected places are right to 1e-12 or so of a pixel in
# scenes about the origin; coordinates of 1e6 are exact differences.
TIE = 1e-6
SAME = 1e-7  # relative: depths of triangles that share an edge, where the center is on it
PAIRS = 1 << 20  # of triangles and pixels, considered at a time
CORNERS = ((1, 2), (2, 0), (0, 1))  # edge k is opposite corner k
_AROUND = np.arange(8) * (np.pi / 4.0) + 0.1  # directions in which what is about a center on an edge is looked up


class Exact(NamedTuple):
    """covered: (M, N). tied: (M, N), where the center is on an edge, and either answer is right. depth: (M, N), +inf where
    nothing is. rgb: (M, N, 3). Row 0 is at the top."""

    covered: Bools
    tied: Bools
    depth: Floats
    rgb: Floats


class _Hits(NamedTuple):
    """Pixels, counted row by row from the top, with a triangle that covers the center or has it on an edge, (K,) each.
    inside: whether it covers it. weights: (K, 3) of its corners, and depth, along the viewing direction."""

    pixel: Integers
    face: Integers
    inside: Bools
    depth: Floats
    weights: Floats


def exact(scene: Scene) -> Exact:
    """Return the exact image of a scene of one mesh, all of it before the eye, under one light."""
    camera, (verts, normals, faces) = scene.camera, mesh_of(scene)
    columns, rows = camera.resolution
    places, z = in_image(camera, verts.astype(np.float64) - camera.eye)
    found = [_hits(places, z, faces, part, columns) for part in _candidates(places, faces, columns, rows)]
    hits = _joined(found)
    sure, nearest, owner = _nearest(hits, hits.inside, rows * columns)
    any_, nearest_any, owner_any = _nearest(hits, np.ones(len(hits.pixel), bool), rows * columns)
    tied = np.where(sure, nearest_any < nearest * (1.0 - SAME), any_)
    doubtful = np.flatnonzero(tied)
    in_front = hits.depth <= nearest_any[hits.pixel] * (1.0 + SAME)
    closed = _surrounded(hits, in_front, places, faces, doubtful, columns)
    tied[doubtful[closed]] = False
    owner = np.where(sure & (nearest <= nearest_any), owner, owner_any)
    depth, rgb = np.full(rows * columns, np.inf), np.zeros((rows * columns, 3))
    shown = np.flatnonzero(any_)
    mine = owner[shown]
    depth[shown] = hits.depth[mine]
    mixed = (normals[faces[hits.face[mine]]].astype(np.float64) * hits.weights[mine, :, None]).sum(axis=1)
    rays, origins = (each.reshape(-1, 3)[shown] for each in pixel_rays(camera))
    points = origins + depth[shown, None] * rays / camera.focal
    rgb[shown] = lambert(mixed, points, scene)
    shape = rows, columns
    return Exact(any_.reshape(shape), tied.reshape(shape), depth.reshape(shape), rgb.reshape(*shape, 3))


def _joined(parts: Sequence[_Hits]) -> _Hits:
    """Return the hits of all parts."""
    return _Hits._make(np.concatenate(columns) for columns in zip(*parts, strict=True))


def _candidates(places: Floats, faces: Array, columns: int, rows: int) -> Iterator[tuple[Integers, Integers]]:
    """Yield triangles and pixels, (K,) each, whose center is in the triangle's box, with TIE about it."""
    corners = places[faces]
    low = np.maximum(np.ceil(corners.min(axis=1) - 0.5 - TIE), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1) - 0.5 + TIE), [columns - 1, rows - 1]).astype(np.int64)
    size = np.maximum(high - low + 1, 0)
    count = size[:, 0] * size[:, 1]
    kept = np.flatnonzero(count)
    number = np.cumsum(count[kept]) // PAIRS
    for part in np.split(kept, np.flatnonzero(np.diff(number)) + 1):
        face = np.repeat(part, count[part])
        step = np.arange(len(face)) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
        column, row = low[face, 0] + step % size[face, 0], low[face, 1] + step // size[face, 0]
        yield face, row * columns + column


def _distances(corners: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return the signed distances in pixels of points (K, 2) from the edges of triangles (K, 3, 2), (K, 3), positive inside,
    and twice the areas of the triangles that they make with these, (K, 3)."""
    apart = corners - points[:, None]
    areas: Floats = np.stack([_cross(apart[:, i], apart[:, j]) for i, j in CORNERS], axis=1)
    whole = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas *= np.sign(whole)[:, None]
    lengths = np.stack([np.linalg.norm(corners[:, j] - corners[:, i], axis=1) for i, j in CORNERS], axis=1)
    distances: Floats = areas / np.where(lengths > 0.0, lengths, 1.0)
    return distances, areas


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def _hits(places: Floats, z: Floats, faces: Array, pairs: tuple[Integers, Integers], columns: int) -> _Hits:
    face, pixel = pairs
    centers = _centers(pixel, columns)
    distances, areas = _distances(places[faces[face]], centers)
    kept = (distances >= -TIE).all(axis=1) & (areas.sum(axis=1) > 0.0)
    face, pixel, distances, areas = face[kept], pixel[kept], distances[kept], areas[kept]
    weights: Floats = np.maximum(areas, 0.0) / z[faces[face]]  # perspective: affine weights over depths
    total: Floats = np.maximum(areas, 0.0).sum(axis=1)
    depth: Floats = total / weights.sum(axis=1)
    return _Hits(pixel, face, (distances > TIE).all(axis=1), depth, weights / weights.sum(axis=1, keepdims=True))


def _centers(pixel: Integers, columns: int) -> Floats:
    return np.stack([pixel % columns, pixel // columns], axis=1).astype(np.float64) + 0.5


def _nearest(hits: _Hits, among: Bools, count: int) -> tuple[Bools, Floats, Integers]:
    """Return for each of `count` pixels whether any of these hits is there, the least depth, and the hit that has it."""
    index = np.flatnonzero(among)
    depth, owner = np.full(count, np.inf), np.full(count, -1)
    np.minimum.at(depth, hits.pixel[index], hits.depth[index])
    first = index[hits.depth[index] == depth[hits.pixel[index]]]
    owner[hits.pixel[first]] = first
    return owner >= 0, depth, owner


def _surrounded(hits: _Hits, among: Bools, places: Floats, faces: Array, pixels: Integers, columns: int) -> Bools:
    """Return which pixels (Q,), whose center is on an edge, have triangles of these hits all around the center: none may
    leave it out."""
    index = np.flatnonzero(among & np.isin(hits.pixel, pixels))
    order = np.searchsorted(pixels, hits.pixel[index])
    corners, centers = places[faces[hits.face[index]]], _centers(hits.pixel[index], columns)
    closed = np.ones(len(pixels), bool)
    for angle in _AROUND:
        probe = centers + 4.0 * TIE * np.array([np.cos(angle), np.sin(angle)])
        held = (_distances(corners, probe)[0] >= 0.0).all(axis=1)
        closed &= np.bincount(order[held], minlength=len(pixels)) > 0
    return closed
