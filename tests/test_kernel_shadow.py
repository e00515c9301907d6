"""shadow_predicate.clh and the kernel shadow_rays, against exact integer arithmetic, in scenes that are hard to decide."""

from __future__ import annotations

import numpy as np
import pytest
from exact_shadows import DARK, EITHER, LIT, ExactShadows
from kernel_stages import LANES, Probe

from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.struct_layout import SHADOW_GRID, SHADOW_REACH

Array = np.ndarray
Mesh = tuple[Array, Array]
U = 2.0**-24


def random_points(mesh: Mesh, count: int, seed: int = 1) -> tuple[Array, Array]:
    """Return points (K, 3) on random faces, and the faces (K,)."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh
    chosen = rng.integers(0, len(faces), count)
    weights = rng.dirichlet([1.0, 1.0, 1.0], count)
    return (vertices[faces[chosen]] * weights[:, :, None]).sum(axis=1), chosen


def border_points(mesh: Mesh, count: int, seed: int = 2) -> tuple[Array, Array]:
    """Return points on vertices and edges of random faces."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh
    chosen = rng.integers(0, len(faces), count)
    part = rng.choice([0.0, 0.25, 0.5, 1.0], count)
    weights = np.stack([part, 1.0 - part, np.zeros(count)], axis=1)
    weights = rng.permuted(weights, axis=1)
    return (vertices[faces[chosen]] * weights[:, :, None]).sum(axis=1), chosen


def soup(count: int = 60, seed: int = 3) -> Mesh:
    """Return triangles that cross each other."""
    return np.random.default_rng(seed).normal(size=(3 * count, 3)), np.arange(3 * count).reshape(-1, 3)


def box() -> Mesh:
    """Return a closed cube from -1 to 1."""
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def sphere(rings: int = 6, sides: int = 8) -> Mesh:
    """Return a closed sphere of radius 1."""
    polar = np.linspace(0.0, np.pi, rings + 1)[1:-1]
    around = np.arange(sides) * 2.0 * np.pi / sides
    ring = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(around),
            np.sin(polar)[:, None] * np.sin(around),
            np.repeat(np.cos(polar)[:, None], sides, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    vertices = np.concatenate([[[0.0, 0.0, 1.0]], ring, [[0.0, 0.0, -1.0]]])
    last = len(vertices) - 1
    faces = [(0, 1 + i, 1 + (i + 1) % sides) for i in range(sides)]
    for r in range(rings - 2):
        for i in range(sides):
            a, b = 1 + r * sides + i, 1 + r * sides + (i + 1) % sides
            faces += [(a, a + sides, b + sides), (a, b + sides, b)]
    faces += [(last, last - sides + (i + 1) % sides, last - sides + i) for i in range(sides)]
    return vertices, np.array(faces)


def lattice(side: int = 6, turned: bool = False) -> Mesh:
    """Return a flat square of 2 side^2 triangles, axis-aligned, or turned by some angles."""
    steps = np.arange(side + 1) / side - 0.5
    x, y = np.meshgrid(steps, steps)
    vertices = np.stack([x.reshape(-1), y.reshape(-1), np.zeros(x.size)], axis=1)
    if turned:
        rotation, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
        vertices = vertices @ rotation.T
    a = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    faces = np.concatenate([np.stack([a, a + 1, a + side + 2], 1), np.stack([a, a + side + 2, a + side + 1], 1)])
    return vertices, faces


def joined(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    faces = [f + start for (_, f), start in zip(meshes, first, strict=False)]
    return np.concatenate([v for v, _ in meshes]), np.concatenate(faces)


def moved(mesh: Mesh, by: float, scale: float = 1.0) -> Mesh:
    return mesh[0] * scale + by, mesh[1]


def slivers(seed: int = 6) -> Mesh:
    """Return triangles of which one corner is within 1e-7 to 1e-15 of the opposite edge."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 40, 3))
    along = rng.random((40, 1))
    c = a + along * (b - a) + 10.0 ** rng.uniform(-15.0, -7.0, (40, 1)) * rng.normal(size=(40, 3))
    return np.stack([a, b, c], axis=1).reshape(-1, 3), np.arange(120).reshape(-1, 3)


def compare(device, mesh: Mesh, light: list[float], *, points: tuple[Array, Array] | None = None, lanes=None) -> Array:
    """Check shadows against the exact ones; return the exact ones."""
    at, receivers = points if points is not None else random_points(mesh, 100)
    found = Hierarchy(device, *mesh, lanes=lanes).shadowed(at, receivers, np.array(light))
    expected = ExactShadows(*mesh).of(at, receivers, np.array(light))
    wrong = np.flatnonzero((expected != EITHER) & (found != (expected == DARK)))
    assert not len(wrong), (wrong, found[wrong], expected[wrong])
    return expected


LIGHTS = {
    "near": [2.0, 1.5, 3.0, 1.0],
    "inside": [0.1, -0.05, 0.2, 1.0],
    "far": [1e9, -2e9, 3e9, 1.0],
    "farther": [1e25, -2e25, 3e25, 1.0],
    "directional": [0.3, 0.5, 1.0, 0.0],
    "along an axis": [0.0, 0.0, 1.0, 0.0],
}


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("lanes", LANES)
def test_triangles_that_cross(device, lanes, light):
    expected = compare(device, soup(), light, lanes=lanes)
    assert np.count_nonzero(expected == EITHER) == 0
    assert {LIT, DARK} == set(expected) or np.all(expected == DARK)


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("make", [box, sphere])
def test_closed_meshes(device, make, light):
    """From inside nothing outside is seen, also along edges and from points on edges and vertices."""
    expected = compare(device, make(), light)
    borders = compare(device, make(), light, points=border_points(make(), 100))
    assert np.count_nonzero(expected == EITHER) == 0
    assert np.count_nonzero(borders == EITHER) <= 15  # their rounding decides
    if light is LIGHTS["near"]:
        assert {LIT, DARK} == set(expected)


STIFF = {
    "in the plane of triangles": (joined(box(), moved(box(), 3.0)), [5.0, 0.5, 1.0, 1.0]),
    "on a vertex": (joined(box(), moved(box(), 3.0)), [1.0, 1.0, 1.0, 1.0]),
    "on an edge": (joined(box(), moved(box(), 3.0)), [1.0, 1.0, 0.25, 1.0]),
    "just above the ground": (joined(lattice(), moved(box(), 0.2, 0.1)), [0.4, 0.1, 1e-6, 1.0]),
    "on the ground": (joined(lattice(), moved(box(), 0.2, 0.1)), [0.4, 0.1, 0.0, 1.0]),
    "far from the origin": (moved(joined(sphere(), moved(box(), 2.0)), 1e9), [1e9 + 4.0, 1e9 + 3.0, 1e9 + 5.0, 1.0]),
    "slivers": (slivers(), [3.0, 2.0, 5.0, 1.0]),
    "small beside large": (
        joined(moved(box(), 0.0, 1e6), moved(sphere(), 1e6 + 2.0)), [1e6 + 9.0, 1e6 + 7.0, 1e6 + 20.0, 1.0]
    ),
}  # fmt: skip


@pytest.mark.parametrize(("mesh", "light"), STIFF.values(), ids=STIFF)
def test_stiff_cases(device, mesh, light):
    compare(device, mesh, light)
    compare(device, mesh, light, points=border_points(mesh, 60))


@pytest.mark.parametrize("light", [[0.2, 0.1, 2.0, 1.0], [0.2, 0.1, 1e-3, 1.0], [1.0, 0.0, 1e-6, 0.0]])
@pytest.mark.parametrize("turned", [False, True])
def test_a_flat_mesh_casts_no_shadow_on_itself(device, turned, light):
    mesh = lattice(12, turned)
    if turned:
        rotation, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
        light = [*(rotation @ light[:3]), light[3]]
    hierarchy = Hierarchy(device, *mesh)
    for points in (random_points(mesh, 2000), border_points(mesh, 2000)):
        assert not hierarchy.shadowed(*points, np.array(light)).any()


def test_a_degenerate_triangle_casts_no_shadow(device):
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    line = np.array([[-1.0, 0, 1], [1, 0, 1], [0, 0, 1]])
    mesh = np.concatenate([floor, line]), np.array([[0, 1, 2], [3, 4, 5], [3, 4, 4]])
    light = np.array([0.0, 0.0, 2.0, 1.0])
    assert not Hierarchy(device, *mesh).shadowed(np.zeros((1, 3)), np.array([0]), light).any()


# The arithmetic

PAIRS = """
#include "shadow_predicate.clh"

#define BINARY(name, call)                                                                             \\
    kernel void name(global const float *ah, global const float *al, global const float *bh,           \\
                     global const float *bl, global float *out)                                        \\
    {                                                                                                  \\
        int i = get_global_id(0) * LANES;                                                              \\
        float_pair a = {LOAD_LANES(ah + i), LOAD_LANES(al + i)};                                       \\
        float_pair b = {LOAD_LANES(bh + i), LOAD_LANES(bl + i)};                                       \\
        float_pair c = call(&a, &b);                                                                   \\
        float high[LANES], low[LANES];                                                                 \\
        STORE_LANES(c.high, high);                                                                     \\
        STORE_LANES(c.low, low);                                                                       \\
        for (int lane = 0; lane < LANES; ++lane)                                                       \\
            vstore2((float2)(high[lane], low[lane]), i + lane, out);                                   \\
    }

BINARY(sum, fp_sum)
BINARY(difference, fp_difference)
BINARY(product, fp_product)
#define SNAPPED(a, b) on_grid((a)->high, (a)->low)
BINARY(snapped, SNAPPED)
"""


def pairs(count: int, seed: int) -> tuple[Array, Array]:
    """Return normalized pairs of all magnitudes and signs, some of them close to the previous one."""
    rng = np.random.default_rng(seed)
    high = np.ldexp(rng.uniform(1.0, 2.0, count), rng.integers(-12, 15, count)) * rng.choice([-1.0, 1.0], count)
    high[1::2] = -high[::2] * (1.0 + rng.integers(-3, 4, count // 2) * U)
    high = high.astype(np.float32)
    low = (high * rng.uniform(-U / 2, U / 2, count)).astype(np.float32)
    return high, low


def exactly(high: Array, low: Array) -> Array:
    """Return pairs as Python integers, in units of 2^-149."""
    return np.array([int(float(x) * 2.0**149) + int(float(y) * 2.0**149) for x, y in zip(high, low, strict=True)])


@pytest.mark.parametrize("name", ["sum", "difference", "product"])
def test_pair_arithmetic(device, name):
    """Errors as pair_vectors.clh derives them, and normalized results."""
    a, b = pairs(4000, 7), pairs(4000, 8)
    a[0][::3], a[1][::3] = -np.roll(b[0], 1)[::3], np.roll(b[1], 1)[::3]
    high, low = Probe(device, PAIRS)(name, *a, *b, width=2).T
    found, x, y = exactly(high, low), exactly(*a), exactly(*b)
    if name == "product":
        error = np.abs((found << 149) - x * y)
        assert (error << 48 <= 6.001 * np.abs(x * y)).all()
    else:
        error = np.abs(found - (x + y if name == "sum" else x - y))
        assert (error << 48 <= 3.001 * (np.abs(x) + np.abs(y))).all()
        assert error.any()
    assert (np.abs(low) <= U * np.abs(high)).all()


def test_differences_on_the_grid_are_exact(device):
    rng = np.random.default_rng(9)
    reach = round(SHADOW_REACH / SHADOW_GRID)
    x, y = rng.integers(-reach, reach + 1, (2, 20_000))
    x[::4] = y[::4] + rng.integers(-100, 100, len(x[::4]))
    x[0], y[0] = reach, -reach
    frame = CasterFrame(np.zeros(3), SHADOW_GRID)  # takes integers
    parts = [frame.pairs(np.repeat(v[:, None], 3, axis=1).astype(float)) for v in (x, y)]
    high, low = Probe(device, PAIRS)(
        "difference", *(np.ascontiguousarray(p[:, k]) for p in parts for k in (0, 3)), width=2
    ).T
    assert np.array_equal((high.astype(np.float64) + low) / SHADOW_GRID, x - y)


def test_receivers_snap_to_the_grid(device):
    """Within 3/2 units, onto a multiple, also below the grid and where the high part is none."""
    rng = np.random.default_rng(10)
    value = np.ldexp(rng.uniform(-1.0, 1.0, 20_000), rng.integers(-40, 16, 20_000))
    high = value.astype(np.float32)
    low = (value - high).astype(np.float32)
    found = Probe(device, PAIRS)("snapped", high, low, high, low, width=2).astype(np.float64).sum(axis=1) / SHADOW_GRID
    assert np.array_equal(found, np.rint(found))
    assert np.abs(found - (high.astype(np.float64) + low) / SHADOW_GRID).max() <= 1.5
