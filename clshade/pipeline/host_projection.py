"""kernels/project.cl on the host, for devices without float64. The same operations, hence the same bits."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from . import struct_layout

_HALF_ULP = 1.5 * 2.0**52  # adding and subtracting it rounds to the nearest integer


def _snap(pixels: Array, view: Array, axis: int) -> Array:
    with np.errstate(invalid="ignore"):
        from_region = pixels - view["guarded"][axis]
        inside = (from_region >= struct_layout.GUARD_LOW) & (from_region <= struct_layout.GUARD_HIGH)
    snapped = (np.where(inside, pixels, 0.0) * (1 << struct_layout.SUBPIXEL_BITS) + _HALF_ULP) - _HALF_ULP
    limit = np.where(from_region > 0.0, struct_layout.SNAP_LIMIT, -struct_layout.SNAP_LIMIT)
    return np.where(inside, snapped - view["first"][axis], limit).astype(np.int32)


def project(positions: Array, view: Array, orthographic: bool, vertices: Array, relative: Array) -> None:
    """Fill `vertices` (V,) struct_layout.SINGLE.Vertex and `relative` (V, 4) float32 from positions (V, 3), world space.

    view: one row of struct_layout.SINGLE.View.
    """
    d = positions.astype(np.float64) - view["eye"]
    m = view["axes"]
    x, y, z = ((d[:, 0] * m[k] + d[:, 1] * m[k + 1]) + d[:, 2] * m[k + 2] for k in (0, 3, 6))
    vertices[:] = 0
    vertices["depth"] = z
    seen = np.flatnonzero(z >= view["near"])
    x, y, z = x[seen], y[seen], z[seen]
    depth = np.minimum(z * view["scale"], struct_layout.MOST_DEPTH)
    with np.errstate(over="ignore", invalid="ignore"):
        if orthographic:
            across, up, w = x / view["plane_width"], y / view["plane_height"], -depth
        else:
            across = (view["focal"] * x) / (z * view["plane_width"])
            up = (view["focal"] * y) / (z * view["plane_height"])
            w = 1.0 / depth
        vertices["x"][seen] = _snap((across + view["principal"][0]) * view["columns"], view, 0)
        vertices["y"][seen] = _snap((up + view["principal"][1]) * view["rows"], view, 1)
    high = w.astype(np.float32)
    vertices["w"][seen], vertices["w_low"][seen] = high, (w - high).astype(np.float32)
    relative[:, :3] = np.clip(d * view["scale"], -struct_layout.MOST_LENGTH, struct_layout.MOST_LENGTH)
    relative[:, 3] = 0.0
