"""shadow_predicate.clh and the kernel shadow_rays, against exact integer arithmetic, in scenes that are hard to decide."""

from __future__ import annotations

import numpy as np
import pytest
from caster_meshes import Mesh, border_points, box, joined, lattice, moved, random_points, slivers, soup, sphere
from exact_shadows import DARK, EITHER, LIT, ExactShadows, cross, dot
from kernel_stages import Probe, split

from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.struct_layout import RECEIVER_UNITS, SHADOW_GRID, SHADOW_REACH

Array = np.ndarray
U = 2.0**-24


def compare(device, mesh: Mesh, light: list[float], points: tuple[Array, Array]) -> Array:
    """Check shadows at points on faces against the exact ones; return the exact ones."""
    shadowed = Hierarchy(device, *mesh).shadowed(*points, np.array(light))
    expected = ExactShadows(*mesh).of(*points, np.array(light))
    wrong = np.flatnonzero((expected != EITHER) & (shadowed != (expected == DARK)))
    assert not len(wrong), (wrong, shadowed[wrong], expected[wrong])
    return expected


LIGHTS = {
    "near": [2.0, 1.5, 3.0, 1.0],
    "inside": [0.1, -0.05, 0.2, 1.0],
    "far": [1e9, -2e9, 3e9, 1.0],
    "farther": [1e25, -2e25, 3e25, 1.0],
    "directional": [0.3, 0.5, 1.0, 0.0],
    "along an axis": [0.0, 0.0, 1.0, 0.0],
}
BOXES, GROUND = joined(box(), moved(box(), 3.0)), joined(lattice(), moved(box(), 0.2, 0.1))
CASES = {  # from inside of closed meshes nothing outside is seen, also along edges
    f"{name}, {place}": (mesh, light)
    for name, mesh in {"crossing": soup(), "box": box(), "sphere": sphere()}.items()
    for place, light in LIGHTS.items()
} | {
    "in the plane of triangles": (BOXES, [5.0, 0.5, 1.0, 1.0]),
    "on a vertex": (BOXES, [1.0, 1.0, 1.0, 1.0]),
    "on an edge": (BOXES, [1.0, 1.0, 0.25, 1.0]),
    "just above the ground": (GROUND, [0.4, 0.1, 1e-6, 1.0]),
    "on the ground": (GROUND, [0.4, 0.1, 0.0, 1.0]),
    "far from the origin": (moved(joined(sphere(), moved(box(), 2.0)), 1e9), [1e9 + 4.0, 1e9 + 3.0, 1e9 + 5.0, 1.0]),
    "slivers": (slivers(), [3.0, 2.0, 5.0, 1.0]),
    "small beside large": (
        joined(moved(box(), 0.0, 1e6), moved(sphere(), 1e6 + 2.0)), [1e6 + 9.0, 1e6 + 7.0, 1e6 + 20.0, 1.0]
    ),
}  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize("name", CASES)
def test_shadows_are_the_exact_ones(device, name):
    mesh, light = CASES[name]
    exact = [compare(device, mesh, light, points) for points in (random_points(mesh, 80), border_points(mesh, 50))]
    if ", " in name:
        assert EITHER not in exact[0]
        assert np.count_nonzero(exact[1] == EITHER) <= 10  # the rounding of points on borders decides
    if name.endswith(", near"):
        assert {LIT, DARK} == set(exact[0])


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


@pytest.mark.sampled
@pytest.mark.parametrize("units", [RECEIVER_UNITS, 1, RECEIVER_UNITS + 1])
def test_receivers_off_their_plane(device, units):
    """To either side: by as much as rounding may move them, on a flat mesh, they are as if they were on it."""
    mesh = joined(lattice(4), moved(box(), 0.5, 0.1))
    frame = CasterFrame.around(mesh[0])
    at, receivers = random_points(lattice(4), 40)
    for off in (units, -units):
        points = at + [0.0, 0.0, off * SHADOW_GRID / frame.unit]
        for light in ([1.0, 0.8, 1.5, 1.0], [0.2, 0.1, -1.0, 1.0], [0.3, 0.2, 1e-3, 1.0], [1.0, 0.5, 0.7, 0.0]):
            shadows = compare(device, mesh, light, (points, receivers))
            if units <= RECEIVER_UNITS:
                assert np.array_equal(shadows, compare(device, mesh, light, (at, receivers)))


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


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["sum", "difference", "product"])
def test_pair_arithmetic(device, name):
    """Errors as pair_vectors.clh derives them, and normalized results."""
    a, b = pairs(4000, 7), pairs(4000, 8)
    a[0][::3], a[1][::3] = -np.roll(b[0], 1)[::3], np.roll(b[1], 1)[::3]
    high, low = Probe(device, PAIRS)(name, *a, *b, width=2).T
    outcome, x, y = exactly(high, low), exactly(*a), exactly(*b)
    if name == "product":
        error = np.abs((outcome << 149) - x * y)
        assert (error << 48 <= 6.001 * np.abs(x * y)).all()
    else:
        error = np.abs(outcome - (x + y if name == "sum" else x - y))
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
    snapped = (
        Probe(device, PAIRS)("snapped", high, low, high, low, width=2).astype(np.float64).sum(axis=1) / SHADOW_GRID
    )
    assert np.array_equal(snapped, np.rint(snapped))
    assert np.abs(snapped - (high.astype(np.float64) + low) / SHADOW_GRID).max() <= 1.5


# The bounds of determinants

SIDES = """
#include "shadow_predicate.clh"

// Of one lane; `given` holds vectors of pairs.
#define VECTOR(k) {{given[6 * (k)], given[6 * (k) + 3]}, \\
                   {given[6 * (k) + 1], given[6 * (k) + 4]}, \\
                   {given[6 * (k) + 2], given[6 * (k) + 5]}}

kernel void light_sides(global const float *given, global float *out)
{
    given += 24 * get_global_id(0);
    float_pair3 ab = VECTOR(0), ac = VECTOR(1), toward = VECTOR(2), q = VECTOR(3);
    floats3 magnitude;
    float_pair3 normal = fp3_cross(&ab, &ac, &magnitude);
    out[get_global_id(0)] = light_side(&normal, &magnitude, &toward, 0.5f, &q);
}

kernel void heights(global const float *given, global float *out)
{
    given += 24 * get_global_id(0);
    float_pair3 ab = VECTOR(0), ac = VECTOR(1), v = VECTOR(3);
    ShadowRay ray = {.corners = {VECTOR(2)}, .side = 1.0f};
    ray.normal = fp3_cross(&ab, &ac, &ray.magnitude);
    int above = above_receiver(&ray, &v) != 0;
    ray.side = -1.0f;
    out[get_global_id(0)] = above - (above_receiver(&ray, &v) != 0);
}

kernel void centroid_sides(global const float *given, global float *out)
{
    given += 42 * get_global_id(0);
    float_pair3 edge = VECTOR(0), toward = VECTOR(1), pa = VECTOR(2), a = VECTOR(3);
    ShadowRay ray = {.corners = {VECTOR(4), VECTOR(5), VECTOR(6)}, .toward = toward};
    out[get_global_id(0)] = centroid_side(&ray, 0.5f, &a, &pa, &edge);
}
"""


def vectors(rng: np.random.Generator, count: int) -> Array:
    """Return (K, count, 3) Python integers, in units of the grid: each axis of another size."""
    size = np.exp2(rng.uniform(38.0, 44.0, (2000, 1, 3)))
    return 2 * integers_of(rng.normal(size=(2000, count, 3)) * size)


def integers_of(values: Array) -> Array:
    return np.rint(values).astype(np.int64).astype(object)


def beside_plane(rng: np.random.Generator, a: Array, b: Array, bound: int) -> Array:
    """Return vectors (K, 3) whose product with the cross product of a and b is up to three of bound * 2^-48 of its terms."""
    weights = rng.uniform(-1.0, 1.0, (2, len(a), 1))
    inside = integers_of(weights[0] * a.astype(float) + weights[1] * b.astype(float)) // 2 * 2
    normal, size = cross(a, b)
    reach = dot((normal, size), inside)[1].astype(float) * bound * 2.0**-48 * rng.uniform(-3.0, 3.0, len(a))
    axis = np.abs(normal.astype(float)).argmax(axis=1)
    rows = np.arange(len(a))
    inside[rows, axis] += 2 * integers_of(reach / normal[rows, axis].astype(float) / 2.0)
    return inside


def assert_sides(device, name: str, operands: list[Array], value: Array, bound: Array) -> None:
    """Check the signs of values in units of 2^-48: 0 of those within half their bounds, that of those beyond 3/2 of them."""
    parts = split(np.concatenate(operands, axis=1).astype(np.float64) * SHADOW_GRID)
    pairs = np.concatenate([part.reshape(len(value), -1, 3) for part in parts], axis=2).reshape(len(value), -1)
    sides = Probe(device, SIDES, lanes=1)(name, np.ascontiguousarray(pairs))
    share = np.abs(value.astype(float)) * 2.0**48 / bound.astype(float)
    small, large = share < 0.5, share > 1.5
    assert small.sum() > 100 < large.sum()
    assert not sides[small].any()
    assert np.array_equal(sides[large], np.sign(value[large].astype(float)))


def test_signs_of_determinants_beside_their_bounds(device):
    """A bound is that of the terms that are there: neither less nor more."""
    rng = np.random.default_rng(12)
    ab, ac, q = np.moveaxis(vectors(rng, 3), 1, 0)
    x = beside_plane(rng, ab, ac, 25)
    normal, size = cross(ab, ac)
    toward = x + q // 2
    bound = 25 * (size * (abs(toward) + abs(q) // 2)).sum(axis=1)
    assert_sides(device, "light_sides", [ab, ac, toward, q], (normal * x).sum(axis=1), bound)
    x = beside_plane(rng, ab, ac, 22)
    value, magnitude = dot((normal, size), x)
    assert_sides(device, "heights", [ab, ac, q, q + x], value, 22 * magnitude)


def test_sides_of_centroids_beside_their_bounds(device):
    rng = np.random.default_rng(13)
    edge, pa, a, b, c = np.moveaxis(vectors(rng, 5), 1, 0)
    light = vectors(rng, 1)[:, 0]
    toward = light + pa // 2
    x = beside_plane(rng, edge, light, 31)
    corners = np.stack([a + b, a + c, a + x - b - c], axis=1)
    normal, size = cross(edge, light)[0], cross(abs(edge), abs(toward) + abs(pa) // 2)[1]
    bound = 31 * (size * (abs(b) + abs(c) + abs(x - b - c))).sum(axis=1)
    operands = [edge, toward, pa, a, *np.moveaxis(corners, 1, 0)]
    assert_sides(device, "centroid_sides", operands, -(normal * x).sum(axis=1), bound)
