"""The table of clipped triangles, as the kernels read it."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from ..scene.camera import Camera
from ..scene.image_part import raster_of
from . import clip
from .struct_layout import MOST_DEPTH, Structs


def piece_table(
    points: Array,
    faces: Array,
    uvs: Array | None,
    camera: Camera,
    structs: Structs,
    *,
    near: float,
    scale: float,
    depth_test: bool,
) -> Array:
    """Clip faces to the near plane and the guard band: (C,) of `structs.Piece`.

    points: (K, 3, 3) the faces' corners, camera space, scene units. faces: (K,) their numbers. uvs: (K, 3, 4) texture
    coordinates of the corners as double-singles (u, v, low parts of u, v), or None. near: scene units. scale: of depths.
    depth_test: sort by the nearest corner of each piece, else by the mean depth of its face.
    """
    cut = clip.clip(points, camera, near)
    table = np.zeros(len(cut.source), structs.Piece)
    z = points[..., 2]
    if depth_test:
        table["key_depth"] = cut.points[..., 2].min(axis=1)
    else:
        table["key_depth"] = (((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)[cut.source]
    z_scaled = np.minimum(cut.points[..., 2] * scale, MOST_DEPTH)
    w = -z_scaled if camera.orthographic else 1.0 / z_scaled
    table["w"], table["w_low"] = w, w - w.astype(structs.real)
    snapped = clip.snap(clip.image_positions(cut.points, camera), raster_of(camera))
    table["x"], table["y"] = snapped[..., 0], snapped[..., 1]
    table["face"] = faces[cut.source]
    weights = cut.weights.reshape(-1, 9)
    table["weights"], table["weights_low"] = weights, weights - weights.astype(structs.real)
    if uvs is not None:
        parts = uvs.astype(np.float64)
        uv = np.einsum("cjk,ckd->cjd", cut.weights, (parts[..., :2] + parts[..., 2:])[cut.source]).reshape(-1, 6)
        table["uv"], table["uv_low"] = uv, uv - uv.astype(structs.real)
    return table
