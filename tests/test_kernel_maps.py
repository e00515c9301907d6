"""Normals turned by normal maps, kernel function `turned_normal`: against float64, and where there is no tangent."""

from __future__ import annotations

import numpy as np
from kernel_stages import Probe

TURNED = """
#include "surface.clh"
#define IN(name) LOAD_LANES(name + i)
kernel void turn(global const REAL *nx, global const REAL *ny, global const REAL *nz, global const REAL *tx,
                 global const REAL *ty, global const REAL *tz, global const REAL *a, global const REAL *b,
                 global const REAL *c, global const REAL *r, global const REAL *g, global const REAL *blue,
                 global const REAL *scale, global REAL *out)
{
    int i = get_global_id(0) * LANES;
    reals3 normal = {IN(nx), IN(ny), IN(nz)}, tangent = {IN(tx), IN(ty), IN(tz)};
    reals3 texel = {IN(r), IN(g), IN(blue)};
    reals3 turned = turned_normal(normal, tangent, bitangent_side(IN(a), IN(b), IN(c)), texel, IN(scale));
    REAL x[LANES], y[LANES], z[LANES];
    STORE_LANES(turned.x, x);
    STORE_LANES(turned.y, y);
    STORE_LANES(turned.z, z);
    for (int k = 0; k < LANES; ++k) {
        out[3 * (i + k)] = x[k];
        out[3 * (i + k) + 1] = y[k];
        out[3 * (i + k) + 2] = z[k];
    }
}
"""


def test_normals_are_turned_and_lose_few_digits(device):
    rng = np.random.default_rng(3)
    count = 16 * 60
    normal, tangent = rng.uniform(-1, 1, (2, 3, count)).astype(np.float32)
    sides = rng.integers(-1, 2, (3, count)).astype(np.float32)
    texel = rng.uniform(0, 1, (3, count)).astype(np.float32)
    scale = rng.uniform(-3, 3, count).astype(np.float32)
    inputs = (*normal, *tangent, *sides, *texel, scale)
    probe = Probe(device, TURNED, PBR=1, NORMAL_MAP=1, DIFFUSE=1)
    normals = probe("turn", *inputs, width=3)
    n, t, (x, y, z) = (v.astype(np.float64) for v in (normal, tangent, 2.0 * texel.astype(np.float64) - 1.0))
    side = np.where(sides.sum(axis=0) < 0.0, -1.0, 1.0)
    expected = scale * (x * t + y * side * np.cross(n, t, axis=0)) + z * n
    size = np.abs(scale) * (np.abs(x) + 2.0 * np.abs(y)) + np.abs(z) + 1.0
    some = (sides != 0.0).any(axis=0)
    assert (np.abs(normals.T - expected) <= 8 * 2.0**-24 * size)[:, some].all()
    assert np.array_equal(normals[~some], normal.T[~some])
    assert 0 < some.sum() < count
