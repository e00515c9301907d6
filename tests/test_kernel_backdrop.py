"""backdrop.clh by itself: angles without atan2; radiance in any direction, those of poles, seam and axes too."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_stages import Probe

from clshade.oracle.environment import seen
from clshade.pipeline.shading_tables import backdrop_table, write_backdrop_size
from clshade.pipeline.struct_layout import SINGLE
from clshade.scene.environment import Environment

TEXT = """
#include "backdrop.clh"

kernel void angle(global const float *y, global const float *x, global float *out)
{
    int first = get_global_id(0) * LANES;
    STORE_LANES(half_turns(LOAD_LANES(y + first), LOAD_LANES(x + first)), out + first);
}

kernel void toward(global const float *front, global const float *left, global const float *up,
                   global const Image *image, global const real4 *table, global float *found)
{
    int first = get_global_id(0) * LANES;
    TablePlace place = place_toward(image, LOAD_LANES(front + first), LOAD_LANES(left + first), LOAD_LANES(up + first));
    reals4 c = bilinear_pairs(table, image->backdrop_columns + 2, place.x, place.y);
    float r[LANES], g[LANES], b[LANES];
    STORE_LANES(c.x, r);
    STORE_LANES(c.y, g);
    STORE_LANES(c.z, b);
    for (int lane = 0; lane < LANES; ++lane) {
        found[3 * (first + lane)] = r[lane];
        found[3 * (first + lane) + 1] = g[lane];
        found[3 * (first + lane) + 2] = b[lane];
    }
}
"""
IMAGES = [np.random.default_rng(5).random(shape) ** 3 for shape in ((16, 32, 3), (1, 1, 3), (2, 5, 3))]


def directions() -> np.ndarray:
    """Return front, left and up (K, 3), float32, of lengths about 1, among them all axes, the seam and the poles."""
    rng = np.random.default_rng(7)
    d = rng.normal(size=(600, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    near = np.repeat(axes, 6, axis=0) + 10.0 ** rng.uniform(-9, -2, (36, 1)) * rng.normal(size=(36, 3))
    return np.concatenate([d, axes, [[-1, -0.0, 0], [-1, 0, 0]], near]).astype(np.float32)


def test_angles(device):
    rng = np.random.default_rng(1)
    y, x = (np.float32(10.0 ** rng.uniform(-8, 1, 4000)) for _ in range(2))
    y[:4], x[:4] = (0, 0, 1, 1), (0, 1, 0, 1)
    angles = Probe(device, TEXT, BACKDROP=1)("angle", y, x)
    expected = np.arctan2(y.astype(np.float64), x.astype(np.float64)) / np.pi
    # Four roundings: of the quotient, of the polynomial, of its first coefficient, of their product; or that of the sum.
    assert (np.abs(angles - expected) <= 2.0**-24 * np.minimum(4.0 * expected, 0.75)).all()


@pytest.mark.parametrize("image", IMAGES)
def test_radiance_in_any_direction(device, image):
    environment, row, d = Environment(image), np.zeros(1, SINGLE.Image), directions()
    write_backdrop_size(row[0], environment)
    columns = np.ascontiguousarray(d.T)
    probe = Probe(device, TEXT, BACKDROP=1)
    colors = probe("toward", *columns, row, backdrop_table(environment, SINGLE), width=3)
    world = d[:, [1, 2, 0]].astype(np.float64)  # left is x, up is y, front is z
    expected, budget = seen(environment, world / np.linalg.norm(world, axis=1, keepdims=True), "float32")
    assert (np.abs(colors - expected) <= 16 * 2.0**-24 * budget).all()
