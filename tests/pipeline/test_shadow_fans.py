"""Rays from one receiver to many points, through the hierarchy of casters, against all triangles one by one."""

from __future__ import annotations

import numpy as np
import pytest
from caster_meshes import (
    Mesh,
    border_points,
    box,
    crumpled,
    joined,
    lattice,
    moved,
    random_points,
    slivers,
    soup,
    sphere,
)
from kernel_stages import OTHER_LANES, Probe
from shadow_fans import hidden

from clshade.pipeline.hierarchy import Hierarchy
from clshade.pipeline.struct_layout import SHADOW_GRID, SHADOW_REACH

Array = np.ndarray
MANY = 32


def compare(device, hierarchy: Hierarchy, points: Array, receivers: Array, ends: Array, directional=False) -> Array:
    """Check a fan of each receiver by the predicate alone; return which ends are hidden, (K, N)."""
    fans = device, hierarchy, points, receivers, ends, directional
    is_hidden = hidden(*fans)
    wrong = np.argwhere(is_hidden != hidden(*fans, one_by_one=True))
    assert not len(wrong), (wrong[:9], is_hidden[tuple(wrong[0])])
    return is_hidden


MESHES = {
    "soup": soup(100),
    "crumpled": crumpled(12),
    "flat": joined(lattice(8), moved(box(), 0.4, 0.1), moved(lattice(5), 0.1, 0.5)),
    "closed": joined(sphere(8, 10), moved(box(), 2.5), moved(sphere(), -2.0, 0.2)),
    "slivers": joined(slivers(), lattice(4)),
}
# Triangles so small beside the frame that what float32 leaves of their corners counts.
MESHES["fine"] = joined(moved(crumpled(12), 0.71, 0.01), moved(sphere(4, 6), 0.71, 0.003), moved(lattice(1), -0.5))
MESHES["turned"] = joined(lattice(8, True), moved(box(), 0.4, 0.1))


def rounded(mesh: Mesh, offset: float) -> Mesh:
    """Return a mesh as coarse as it is so far from the origin; points on it are no coarser."""
    return (mesh[0] + offset) - offset, mesh[1]


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def ends_for(mesh: Mesh, points: Array, receivers: Array, seed: int) -> dict[str, Array]:
    """Return points (K, MANY, 3) of all kinds: of small lights and large, near and far, and where signs are hard to tell."""
    rng = np.random.default_rng(seed)
    corners = mesh[0][mesh[1]]
    center, shape = mesh[0].mean(axis=0), (len(points), MANY, 3)
    ball = unit(rng.normal(size=shape)) * rng.random((*shape[:2], 1)) ** (1 / 3)
    a, b, c = np.moveaxis(corners[receivers], 1, 0)
    normals = np.nan_to_num(unit(np.cross(b - a, c - a)))[:, None]
    in_plane = (rng.normal(size=shape[:2])[..., None] * (b - a)[:, None]) + rng.normal(size=shape[:2])[..., None] * (
        c - a
    )[:, None]
    # In the planes of triangles, each receiver's in one.
    one = corners[rng.integers(0, len(corners), len(points))]
    weights = rng.normal(size=(*shape[:2], 2))
    on_plane = one[:, :1] + np.einsum("knc,kcx->knx", weights, one[:, 1:] - one[:, :1])
    # Just beside their borders, which float32 does not tell, and twice as far.
    part = rng.random((*shape[:2], 1))
    aimed = corners[rng.integers(0, len(corners), shape[:2])]
    borders = part * aimed[:, :, 0] + (1.0 - part) * aimed[:, :, 1]
    beside = borders + 10.0 ** rng.uniform(-10.0, -4.0, (*shape[:2], 1)) * np.ptp(mesh[0]) * ball
    any_corner = corners[rng.integers(0, len(corners), shape[:2]), rng.integers(0, 3, shape[:2])]
    return {
        "small": center + np.array([0.4, 0.7, 2.5]) + 0.2 * ball,
        "large": center + np.array([0.4, 0.7, 2.5]) + 2.0 * ball,
        "inside": center + 0.5 * ball,
        "far": center + 3e4 * unit(rng.normal(size=3)) + 3e2 * ball,
        "farther": center + 3e12 * (unit(rng.normal(size=3)) + 0.2 * ball),
        "grazing": points[:, None] + in_plane + rng.choice([0.0, 1e-9, 1e-6, -1e-6, 1e-3], (*shape[:2], 1)) * normals,
        "around": points[:, None] + 0.3 * ball,
        "close": points[:, None] + 10.0 ** rng.uniform(-12.0, -4.0, (*shape[:2], 1)) * ball,
        "in planes of triangles": on_plane,
        "on vertices": any_corner,
        "past borders": 2.0 * beside - points[:, None],
        "one on vertices, others around": np.where(np.arange(MANY)[:, None] % 4 == 0, any_corner, center + 2.0 * ball),
    }


@pytest.mark.sampled
@pytest.mark.parametrize("offset", [0.0, 1e3, 1e9])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_the_same_as_one_by_one(device, mesh, offset):
    mesh = rounded(mesh, offset)
    hierarchy = Hierarchy(device, *mesh)
    shares = [
        compare(device, hierarchy, points, receivers, ends).mean()
        for seed, (points, receivers) in enumerate((random_points(mesh, 48), border_points(mesh, 32)))
        for ends in ends_for(mesh, points, receivers, seed).values()
    ]
    assert 0.02 < np.mean(shares) < 0.98


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_directions(device, mesh):
    """All around, and within a narrow cone."""
    hierarchy = Hierarchy(device, *mesh)
    points, receivers = random_points(mesh, 64)
    around = np.random.default_rng(8).normal(size=(len(points), MANY, 3))
    for ends in (around, around * 0.05 + around[:, :1]):
        assert 0.0 < compare(device, hierarchy, points, receivers, ends, directional=True).mean() < 1.0


@pytest.mark.long
@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_fans_of_any_number_of_lanes(device, lanes):
    for mesh in MESHES.values():
        points, receivers = random_points(mesh, 50)
        hierarchy = Hierarchy(device, *mesh)
        for ends in ends_for(mesh, points, receivers, 5).values():
            fans = device, hierarchy, points, receivers, ends
            assert np.array_equal(*(hidden(*fans, lanes=count) for count in (16, lanes)))


def test_the_same_as_lights_by_themselves(device):
    """A fan's points one by one, as positions of point lights that are multiples of the grid."""
    mesh = MESHES["closed"]
    hierarchy = Hierarchy(device, *mesh)
    points, receivers = random_points(mesh, 200)
    grid = SHADOW_GRID / hierarchy.frame.unit
    lights = np.random.default_rng(9).normal(size=(16, 3)) * [0.3, 0.3, 0.1] + [0.5, 0.2, 4.0]
    lights = np.rint((lights - hierarchy.frame.origin) / grid) * grid + hierarchy.frame.origin
    is_hidden = hidden(device, hierarchy, points, receivers, np.broadcast_to(lights, (200, 16, 3)))
    for k, light in enumerate(lights):
        assert np.array_equal(is_hidden[:, k], hierarchy.shadowed(points, receivers, np.append(light, 1.0)))
    assert 0.1 < is_hidden.mean() < 0.9


def test_an_end_at_the_receiver_is_not_hidden(device):
    """Whatever passes through it, and wherever the other ends are."""
    mesh = soup(40)
    points, receivers = random_points(mesh, 32)
    hierarchy = Hierarchy(device, *mesh)
    grid = SHADOW_GRID / hierarchy.frame.unit
    points = np.rint((points - hierarchy.frame.origin) / grid) * grid + hierarchy.frame.origin
    ends = points[:, None] + np.random.default_rng(2).normal(size=(32, 16, 3))
    ends[:, ::3] = points[:, None]
    is_hidden = hidden(device, hierarchy, points, receivers, ends)
    assert not is_hidden[:, ::3].any()
    assert is_hidden[:, 1::3].any()


def test_neighbors_in_the_same_plane_cast_nothing(device):
    """Nor are their triangles asked about one by one: the receiver lies in their planes."""
    mesh = lattice(30)
    points, receivers = random_points(mesh, 400)
    ends = np.random.default_rng(3).normal(size=(400, 16, 3)) + [0.0, 0.0, 1.5]
    assert not hidden(device, Hierarchy(device, *mesh), points, receivers, ends).any()


def test_the_ends_of_a_segment(device):
    """A square halfway hides what is behind it, and nothing before it; a receiver near the frame's border."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = joined((floor, quad), (0.5 * floor + [0.0, 0.0, 0.5], quad))
    hierarchy = Hierarchy(device, *mesh)
    heights = np.array([0.1, 0.4, 0.4999999, 0.5, 0.5000001, 0.6, 1.0, 30.0, 1e20])
    ends = np.array([0.013, 0.021, 1.0]) * heights[:, None]
    is_hidden = hidden(device, hierarchy, np.zeros((1, 3)), np.array([0]), ends[None])
    assert is_hidden[0].tolist() == [False] * 4 + [True] * 5
    assert hierarchy.frame.unit * 1e20 > SHADOW_REACH


SINGLY = """
#include "single_rays.clh"

#define RECEIVER 5

// Rays to points that are `toward` away from the first `point`.
SingleRays rays_of(global const float *toward, global const float *point)
{
    float each[3][LANES];
    for (int lane = 0; lane < LANES; ++lane)
        for (int k = 0; k < 3; ++k)
            each[k][lane] = toward[3 * (get_global_id(0) * LANES + lane) + k];
    ShadowRay ray;
    ray.toward.x.high = LOAD_LANES(each[0]), ray.point.x.high = (floats)(point[0]);
    ray.toward.y.high = LOAD_LANES(each[1]), ray.point.y.high = (floats)(point[1]);
    ray.toward.z.high = LOAD_LANES(each[2]), ray.point.z.high = (floats)(point[2]);
    SingleRays rays;
    find_single_rays(&rays, &ray, (fixeds)(RECEIVER), 1.0f, 0);
    return rays;
}

kernel void triangles(global const float *toward, global const float *point, global const float *leaf, global uint *out)
{
    SingleRays rays = rays_of(toward, point);
    LeafCorners corners;
    find_leaf_corners(&corners, &rays, leaf);
    for (int lane = 0; lane < LANES; ++lane) {
        uint sure, opened = triangles_met_by(&rays, lane, &corners, leaf, &sure);
        out[2 * (get_global_id(0) * LANES + lane)] = opened;
        out[2 * (get_global_id(0) * LANES + lane) + 1] = sure;
    }
}

kernel void boxes(global const float *toward, global const float *point, global const float *node, global uint *out)
{
    SingleRays rays = rays_of(toward, point);
    for (int lane = 0; lane < LANES; ++lane)
        out[get_global_id(0) * LANES + lane] = children_met_by(&rays, lane, node);
}
"""


def bits_of(numbers: Array) -> Array:
    """Return the lowest 16 bits of numbers (K,), the lowest first: (K, 16) bool."""
    return (numbers[:, None] >> np.arange(16, dtype=np.uint32) & 1) == 1


@pytest.mark.parametrize("lanes", OTHER_LANES[:1] + (16,))
def test_single_rays_are_decided_without_the_predicate(device, lanes):
    """But for those that pass within rounding of a border, in coordinates that fill the frame."""
    rng = np.random.default_rng(6)
    point, toward = rng.uniform(-1e4, 1e4, 3).astype(np.float32), rng.normal(size=(4000, 3)).astype(np.float32)
    toward *= np.float32(3e4)
    corners = rng.uniform(-4e4, 4e4, (16, 3, 3)).astype(np.float32)
    leaf = np.concatenate([corners.reshape(16, 9).T, np.arange(16, dtype=np.int32).view(np.float32)[None]])
    opened, sure = map(
        bits_of, Probe(device, SINGLY, lanes=lanes)("triangles", toward, point, leaf, width=2, dtype=np.uint32).T
    )
    a, b, c = (corners[:, k].astype(float) - point for k in range(3))
    ray = toward.astype(float)[:, None]
    volumes = np.stack([(np.cross(*ends) * ray).sum(axis=2) for ends in ((b, c), (c, a), (a, b))], axis=-1)
    total = volumes.sum(axis=2)
    share, way = volumes / total[..., None], (np.cross(b - a, c - a) * a).sum(axis=1) / total
    from_border = np.minimum(share.min(axis=2), np.minimum(way, 1.0 - way))
    expected = (from_border > 0.0) & (np.arange(16) != 5)
    clear = abs(from_border) > 1e-3
    assert clear.mean() > 0.98
    assert np.array_equal(opened[clear], expected[clear])
    assert np.array_equal(sure[clear], expected[clear])
    assert not (sure & ~opened).any()
    assert expected.mean() > 0.01


@pytest.mark.parametrize("lanes", OTHER_LANES[:1] + (16,))
def test_boxes_that_single_rays_meet(device, lanes):
    """And no others, but for rounding; also rays along axes."""
    rng = np.random.default_rng(7)
    point, toward = rng.uniform(-1e4, 1e4, 3).astype(np.float32), rng.normal(size=(4000, 3)).astype(np.float32)
    toward *= np.float32(3e4)
    toward[::5, 1], toward[::7, 0] = 0.0, 0.0
    ends = rng.uniform(-4e4, 4e4, (16, 2, 3)).astype(np.float32)
    low, high = ends.min(axis=1), ends.max(axis=1)
    node = np.concatenate([low.T, high.T])
    is_met = bits_of(Probe(device, SINGLY, lanes=lanes)("boxes", toward, point, node, dtype=np.uint32))

    def met(wider: float) -> Array:
        with np.errstate(divide="ignore"):
            ways = [
                (side - point.astype(float))[None] / toward.astype(float)[:, None]
                for side in (low - wider, high + wider)
            ]
        start, end = np.minimum(*ways).max(axis=2), np.maximum(*ways).min(axis=2)
        return np.maximum(start, 0.0) <= np.minimum(end, 1.0)

    assert not (met(0.0) & ~is_met).any()
    assert not (is_met & ~met(1.0)).any()
    assert 0.02 < is_met.mean() < 0.5
