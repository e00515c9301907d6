"""Random scalars of a mesh, and color maps for them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.arrays import Array
from ...scene.model import Mesh, Scalars
from .random_shapes import Random

_MAPS: tuple[Any, ...] = ("viridis", "coolwarm_r", "tab10", ("black", "white"), ("red",))


def random_scalars(rng: Random, kind: str, mesh: Mesh) -> Array:
    """Return scalars of a mesh, of its "vertices", finite and not all equal, or such that its faces' "corners" differ."""
    vertices, faces = len(mesh.verts), len(mesh.faces)
    if kind == "vertices":
        values = rng.normal(size=vertices) if rng.random() < 0.5 else rng.integers(0, 5, vertices).astype(np.float64)
        values[:2] = 0.0, 1.0
        values = values * 10.0 ** rng.uniform(-12, 12) + (1e3 if rng.random() < 0.2 else 0.0)
        return np.asarray(values)
    shape: tuple[int, ...] = (faces, 3) if rng.random() < 0.5 or faces == vertices else (faces,)
    values = rng.normal(size=shape) if rng.random() < 0.5 else rng.integers(0, 4, shape).astype(np.float64)
    if rng.random() < 0.5:
        values *= 10.0 ** rng.uniform(-300, 300, shape if rng.random() < 0.5 else ())
    if rng.random() < 0.5:
        values[rng.random(shape) < 0.2] = rng.choice((np.nan, np.inf, 0.0, 1e308, 5e-324))
    return values


def random_map(rng: Random, kind: str, values: Array) -> Scalars:
    """Return a color map; its ends are the values' own, two of them, or with "corners" also far from them or equal."""
    colormap = _MAPS[rng.integers(len(_MAPS))]
    finite = np.unique(values[np.isfinite(values)])
    clim = None
    if len(finite) > 1 and rng.random() < 0.5:
        clim = tuple(np.sort(rng.choice(finite, 2, replace=False)).tolist())
    elif kind == "corners" and rng.random() < 0.5:
        low = float(rng.choice((0.0, -1.0, 1e300, 1e-300)))
        clim = (low, low if rng.random() < 0.5 else abs(low) * 2.0 + 1e-310)
    return Scalars("data", colormap, clim)
