"""environment.clh by itself: lookups in octahedral maps, and irradiance, against NumPy, in every lane."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_stages import OTHER_LANES, Probe, bits

from clshade.pipeline.shading_tables import environment_tables
from clshade.pipeline.struct_layout import SINGLE
from clshade.scene.environment import Environment
from clshade.scene.image_light import bilinear, image_light

TEXT = """
#include "surface.clh"

#define LOOKED_UP(name, expression)                                                                                \\
    kernel void name(global const float *x, global const float *y, global const float *z, global const int *level, \\
                     global const real4 *radiance, global const Environment *environment, global float *found)     \\
    {                                                                                                              \\
        int first = get_global_id(0) * LANES;                                                                      \\
        reals3 d = {LOAD_LANES(x + first), LOAD_LANES(y + first), LOAD_LANES(z + first)};                          \\
        fixeds levels = LOAD_LANES(level + first);                                                                 \\
        Lighting lighting;                                                                                         \\
        lighting.environment = environment;                                                                        \\
        lighting.radiance = radiance;                                                                              \\
        float r[LANES], g[LANES], b[LANES];                                                                        \\
        expression;                                                                                                \\
        for (int lane = 0; lane < LANES; ++lane) {                                                                 \\
            found[3 * (first + lane)] = r[lane];                                                                   \\
            found[3 * (first + lane) + 1] = g[lane];                                                               \\
            found[3 * (first + lane) + 2] = b[lane];                                                               \\
        }                                                                                                          \\
    }

LOOKED_UP(around, reals px; reals py; octahedral(d, &px, &py); reals4 c = blurred(&lighting, levels, px, py);
          STORE_LANES(c.x, r); STORE_LANES(c.y, g); STORE_LANES(c.z, b))
LOOKED_UP(diffuse, reals3 c = irradiance(&lighting, d); STORE_LANES(c.x, r); STORE_LANES(c.y, g); STORE_LANES(c.z, b))
"""
IMAGE = np.random.default_rng(6).random((64, 128, 3)) ** 3
ENVIRONMENT = Environment(IMAGE)
ON_EDGES = [[0, 0, -1], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, -1], [-1, -1, 0], [-0.0, 1, -1]]


def directions() -> np.ndarray:
    """Return directions (K, 3), float32, of any length, among them all axes and folds."""
    rng = np.random.default_rng(7)
    d = rng.normal(size=(500, 3)) * 10.0 ** rng.uniform(-3, 3, (500, 1))
    return np.concatenate([d, ON_EDGES]).astype(np.float32)


def run(device, name: str, d: np.ndarray, levels: np.ndarray, lanes: int | None = None) -> np.ndarray:
    probe = Probe(device, TEXT, lanes=lanes, LIT=1, PBR=1, DIFFUSE=1, SPECULAR=1, ENVIRONMENT=1)
    row, table = environment_tables(ENVIRONMENT, 1.0, SINGLE)
    return probe(name, *np.ascontiguousarray(d.T), levels.astype(np.int32), table, row, width=3)


@pytest.mark.long
def test_levels_in_any_direction(device):
    d = directions()
    levels = np.arange(len(d)) % 9
    colors = run(device, "around", d, levels)
    for number, level in enumerate(image_light(ENVIRONMENT).levels):
        mine = levels == number
        # A place in the map is right to some roundings of its side in texels; the colors around it are at most 1.
        expected = bilinear(level, d[mine].astype(np.float64))
        np.testing.assert_allclose(colors[mine], expected, atol=8 * len(level) * 2.0**-24)


def test_irradiance_of_unit_normals(device):
    n = directions().astype(np.float64)
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    irradiance = run(device, "diffuse", n, np.zeros(len(n)))
    x, y, z = n.T.astype(np.float64)
    expected = (
        np.stack([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=1) @ image_light(ENVIRONMENT).irradiance
    )
    np.testing.assert_allclose(irradiance, expected, rtol=1e-5)


@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_lanes_do_not_matter(device, lanes):
    d = directions()
    for name in ("around", "diffuse"):
        one, second = (run(device, name, d, np.arange(len(d)) % 9, lanes) for lanes in (None, lanes))
        np.testing.assert_array_equal(bits(one), bits(second))
