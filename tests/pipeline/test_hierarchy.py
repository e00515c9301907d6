"""The hierarchy of casters: its tree, and shadow rays through it against all triangles one by one."""

from __future__ import annotations

import numpy as np
import pytest
from caster_meshes import Mesh, border_points, box, crumpled, joined, lattice, moved, random_points, soup, sphere
from kernel_stages import OTHER_LANES, mask

from clshade.pipeline import hierarchy as hierarchy_module
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.launches import Stages
from clshade.pipeline.programs import build
from clshade.pipeline.struct_layout import HIERARCHY_RUN, SHADOW_GRID, SHADOW_REACH

Array = np.ndarray
ONE_BY_ONE = """
#include "shadow.cl"

kernel void one_by_one(global const float *points, global const int *receivers, global const float *vertices,
                       global const int *faces, global const ShadowLight *lights, global int *dark, int face_count,
                       int stride)
{
    int first = get_global_id(0) * LANES;
    Shadows in = {vertices, faces};
    ShadowReceiver at = receivers_of(points, receivers, stride, first);
    ShadowLight light = lights[0];
    BlockRays block;
    fixeds hit = (fixeds)(0);
    begin_rays(&block, &at, &in, &light, (ints)(-1));
    find_planes(&block);
    for (int triangle = 0; triangle < face_count; ++triangle)
        hit |= casts_shadow(&block.ray, light.w, vertices, faces, triangle, (fixeds)(-1));
    STORE_LANES(hit, dark + first);
}
"""


def one_by_one(device, hierarchy: Hierarchy, points: Array, receivers: Array, light: Array) -> Array:
    """Return whether rays meet any triangle, by the predicate alone; a multiple of 16 of them."""
    count, frame = len(points), hierarchy.frame
    rays = np.ascontiguousarray(frame.pairs(points).T), receivers.astype(np.int32), frame.light(light)
    values = dict(zip(("points", "receivers", "lights"), (Buffer(device, ray) for ray in rays), strict=True))
    dark = Buffer.empty(device, count, np.int32)
    stages = Stages(device, build(device, mask(), ONE_BY_ONE, lanes=16))
    more = {"dark": dark, "face_count": len(hierarchy.faces.array), "stride": count}
    stages.run("one_by_one", (count // 16, 1), {**vars(hierarchy), **values}, **more)
    return dark.to_host() != 0


def of_all_sizes(seed: int = 1) -> Mesh:
    """Return triangles from 1e-5 to 3 across."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-5.0, 0.5, (300, 1, 1))
    return (rng.normal(size=(300, 1, 3)) + size * rng.normal(size=(300, 3, 3))).reshape(-1, 3), np.arange(900).reshape(
        -1, 3
    )


def neighbors(mesh: Mesh, count: int, seed: int = 3) -> tuple[Array, Array]:
    """Return points of which 16 in sequence lie on a face."""
    rng = np.random.default_rng(seed)
    vertices, faces = mesh
    chosen = np.repeat(rng.integers(0, len(faces), count // 16), 16)
    weights = rng.dirichlet([1.0, 1.0, 1.0], len(chosen))
    return (vertices[faces[chosen]] * weights[:, :, None]).sum(axis=1), chosen


def sheets() -> Mesh:
    """Return lattices 5e-12 to 5e-9 above one another: their receivers have lights close by, and triangles before these."""
    above = [moved(lattice(3), np.array([0.0, 0.0, z])) for z in (0.0, 5e-12, 5e-11, 5e-10, 5e-9)]
    return joined(*above)


MESHES = {
    "soup": soup(200),
    "of all sizes": of_all_sizes(),
    "crumpled": crumpled(16),
    "closed": joined(sphere(12, 16), moved(box(), 2.5), moved(sphere(), -2.0, 0.2)),
    "boxes side by side": joined(*(moved(box(), by, 0.25) for by in np.arange(8) * 0.5)),
    "sheets": sheets(),
}


def lights_for(mesh: Mesh) -> list[Array]:
    rng = np.random.default_rng(4)
    near = [[*(2.0 * rng.normal(size=3)), 1.0] for _ in range(4)]
    lights = [*near, [3e9, 2e9, -1e9, 1.0], [0.2, -0.3, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.5, 0.5, 1e-6, 1.0]]
    lights += [[*mesh[0][5], 1.0], [*mesh[0][mesh[1][3]].mean(axis=0), 1.0], [1e3, 0.25, 0.25, 1.0]]
    vertices, faces = mesh
    points, chosen = neighbors(mesh, 1600)
    for k, distance in enumerate((1e-8, 1e-9, 1e-10, 1e-11)):
        a, b, c = vertices[faces[chosen[400 * k]]]
        normal = np.cross(b - a, c - a)
        lights.append([*(points[400 * k] + distance * normal / np.linalg.norm(normal)), 1.0])
    return [np.array(light) for light in lights]


@pytest.mark.sampled
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_the_same_as_one_by_one(device, mesh):
    hierarchy = Hierarchy(device, *mesh)
    for light in lights_for(mesh):
        for points in (random_points(mesh, 1600), border_points(mesh, 800), neighbors(mesh, 1600)):
            in_shadow = hierarchy.shadowed(*points, light)
            wrong = np.flatnonzero(in_shadow != one_by_one(device, hierarchy, *points, light))
            assert not len(wrong), (light, wrong[:9], in_shadow[wrong[:9]])


@pytest.mark.parametrize("name", ["crumpled", "closed", "boxes side by side"])
def test_points_on_borders_are_dark_where_their_faces_are(device, name):
    """A triangle that touches a face's border casts no shadow there that it does not cast on the face beside it."""
    vertices, faces = MESHES[name]
    hierarchy = Hierarchy(device, vertices, faces)
    points, chosen = border_points(MESHES[name], 1600)
    beside = points + 1e-6 * (vertices[faces[chosen]].mean(axis=1) - points)
    for light in ([0.3, 0.2, 4.0, 1.0], [1.0, 0.4, 0.1, 0.0], [0.2, -0.3, 1.0, 0.0], [-5.0, 0.7, 0.35, 1.0]):
        on_border, on_face = (hierarchy.shadowed(at, chosen, np.array(light)) for at in (points, beside))
        assert not (on_border & ~on_face).any()
        assert (on_border != on_face).mean() < 0.02  # light along a surface: P is rounded


@pytest.mark.long
@pytest.mark.parametrize("distance", [1e-8, 1e-9, 1e-10, 1e-11])
def test_lights_next_to_receivers(device, distance):
    """A triangle halfway to a light that is at the receivers as far as float32 tells, with any number of lanes."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    mesh = joined((floor, np.array([[0, 1, 2]])), (0.5 * floor + [0, 0, 0.5 * distance], np.array([[0, 1, 2]])))
    hierarchies = [Hierarchy(device, *mesh, lanes=lanes) for lanes in (16, 4, 1)]
    rng = np.random.default_rng(12)
    points, receivers = np.zeros((16, 3)), np.zeros(16, int)
    dark = 0
    for spread in (0.1, 1.0, 10.0):
        for _ in range(12):
            center = rng.uniform(-0.3, 0.3, 2)
            points[:, :2] = center + spread * distance * rng.uniform(-1.0, 1.0, (16, 2))
            light = np.array([*center, distance, 1.0])
            expected = one_by_one(device, hierarchies[0], points, receivers, light)
            for hierarchy in hierarchies:
                assert np.array_equal(hierarchy.shadowed(points, receivers, light), expected)
            dark += np.count_nonzero(expected)
    assert 0.2 < dark / (3 * 12 * 16) < 0.9


def test_a_light_at_the_receiver_reaches_it(device):
    """Also where triangles pass less than their bound from it."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    layers = [(floor + [0, 0, z], np.array([[0, 1, 2]])) for z in np.arange(-12, 13) * SHADOW_GRID / 2.0**14]
    hierarchy = Hierarchy(device, *joined(*layers))
    points = np.array([[0.1, -0.2, z] for z in np.arange(-12, 13) * SHADOW_GRID / 2.0**14])
    for k, point in enumerate(points):
        for receiver in (k, 12):
            assert not hierarchy.shadowed(point[None], np.array([receiver]), np.array([*point, 1.0])).any()


def test_triangles_seen_edge_on(device):
    """Float32 does not tell which of their sides the light is on, and rays meet them that seem to pass on the wrong side."""
    rng = np.random.default_rng(11)
    light = np.array([3.0, 2.0, 40.0, 1.0])
    a, b = rng.uniform(-1.0, 1.0, (2, 300, 3)) + [0.0, 0.0, 2.0]
    c = a + rng.random((300, 1)) * (b - a) + 0.05 * (light[:3] - a)
    normal = np.cross(b - a, c - a)
    c += normal / np.linalg.norm(normal, axis=1)[:, None] * 10.0 ** rng.uniform(-8.0, -3.0, (300, 1))
    ground = np.array([[-40.0, -40, -3], [40, -40, -3], [0, 80, -3]])
    blades = np.stack([a, b, c], axis=1)
    mesh = joined((blades.reshape(-1, 3), np.arange(900).reshape(-1, 3)), (ground, np.array([[0, 1, 2]])))
    on_blades = np.einsum("nkc,ncx->nkx", rng.dirichlet([1.0, 1.0, 1.0], (300, 16)), blades).reshape(-1, 3)
    toward = on_blades - light[:3]
    points = light[:3] + toward * ((-3.0 - light[2]) / toward[:, 2])[:, None]
    points[:, 2] = -3.0
    hierarchy = Hierarchy(device, *mesh)
    rays = points, np.full(len(points), 300), light
    in_shadow = hierarchy.shadowed(*rays)
    assert np.array_equal(in_shadow, one_by_one(device, hierarchy, *rays))
    assert in_shadow.mean() > 0.99


@pytest.mark.parametrize("lanes", OTHER_LANES)
def test_packets_of_any_size(device, lanes):
    for mesh in MESHES.values():
        for light in lights_for(mesh):
            points = neighbors(mesh, 3200)
            answers = [Hierarchy(device, *mesh, lanes=count).shadowed(*points, light) for count in (16, lanes)]
            assert np.array_equal(*answers)


def cage(offset: float) -> tuple[Mesh, Array]:
    """Return closed meshes one within another over a ground, whose two faces are the last, and a point within all."""
    rotation, _ = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))
    turned = box()[0] @ rotation.T * 0.6, box()[1]
    ground = np.array([[-40.0, -40, -3], [40, -40, -3], [40, 40, -3], [-40, 40, -3]])
    mesh = joined(sphere(), turned, (ground, np.array([[0, 1, 2], [0, 2, 3]])))
    return (mesh[0] + offset, mesh[1]), np.array([0.05, 0.02, 0.1]) + offset


def leaks(device, shell: Mesh, mesh: Mesh, light: Array, count: int) -> tuple[int, int]:
    """Return how many rays, along edges and through vertices of a shell around the light to the ground, are not hidden,
    and how many there are."""
    at, _ = border_points(shell, count, 9)
    down = at[:, 2] < light[2] - 0.1
    toward = at[down] - light
    floor = mesh[0][mesh[1][-1, 0], 2]
    points = light + toward * ((floor - light[2]) / toward[:, 2])[:, None]
    points[:, 2] = floor
    corner = mesh[0][mesh[1][-2, 0]]
    inside = (np.abs(points[:, :2] - (corner[:2] + 40.0)) < 39.0).all(axis=1)
    local = points[inside] - corner
    faces = np.where(local[:, 1] <= local[:, 0], len(mesh[1]) - 2, len(mesh[1]) - 1)
    dark = Hierarchy(device, *mesh).shadowed(points[inside], faces, np.array([*light, 1.0]))
    return int(np.count_nonzero(~dark)), len(dark)


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e9])
@pytest.mark.parametrize("count", [20_000, pytest.param(1_500_000, marks=pytest.mark.long)])
def test_closed_meshes_do_not_leak(device, offset, count):
    """Each shell by itself, so that no other hides the ray."""
    (vertices, faces), light = cage(offset)
    ground = faces[-2:]
    total = 0
    for first, last in ((0, 80), (80, 92)):
        shell = vertices, faces[first:last]
        lost, rays = leaks(device, shell, (vertices, np.concatenate([shell[1], ground])), light, count)
        assert lost == 0
        total += rays
    assert total > 0.4 * count


# The tree


def leaves_of(hierarchy: Hierarchy) -> tuple[Array, Array]:
    """Return corners (L, 16, 3, 3) and faces (L, 16) of the leaves."""
    rows = hierarchy.leaves.to_host().reshape(-1, 10, 16)
    return rows[:, :9].transpose(0, 2, 1).reshape(-1, 16, 3, 3), np.ascontiguousarray(rows[:, 9]).view(np.int32)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 256, 257, 4096, 4097])
def test_tree(device, count):
    """Every triangle is in one leaf, every box is that of what lies below."""
    mesh = soup(count)
    hierarchy = Hierarchy(device, *mesh)
    corners, faces = leaves_of(hierarchy)
    assert np.array_equal(np.unique(faces), np.arange(count))
    assert len(faces) == -(-count // 16)
    assert np.array_equal(corners, hierarchy.vertices.array[:, 0, :3][mesh[1]][faces])
    table = hierarchy.casters.array[0]
    boxes = np.stack([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
    for level in range(table["levels"]):
        first, size = table["first_node"][level], -(-len(boxes) // 16)
        nodes = hierarchy.nodes.array[first : first + size].reshape(-1, 2, 3, 16).transpose(0, 3, 1, 2)
        children = nodes.reshape(-1, 2, 3)
        assert np.array_equal(children[: len(boxes)], boxes)
        assert (children[len(boxes) :, 0] > children[len(boxes) :, 1]).all()
        boxes = np.stack([nodes[:, :, 0].min(axis=1), nodes[:, :, 1].max(axis=1)], axis=1)
    assert len(boxes) == 1


def overlap(lower: Array, upper: Array) -> float:
    """Return by how much two sets of points (K, 3) overlap along the axis where they do least, as a share of both."""
    size = np.ptp(np.concatenate([lower, upper]), axis=0)
    return float(((lower.max(axis=0) - upper.min(axis=0)) / size).min())


@pytest.mark.parametrize("count", [17, 300, 4096, 9000])
def test_runs_are_halved_down_to_the_leaves(device, monkeypatch, count):
    """What each part puts first lies before the rest along some axis, but for what is within one of 64 steps. Parts begin
    with whole leaves, and above 256 triangles with whole nodes."""
    monkeypatch.setattr(hierarchy_module, "_TOGETHER", 4096)  # several launches
    mesh = soup(count)
    hierarchy = Hierarchy(device, *mesh)
    centroids = mesh[0][mesh[1]].mean(axis=1)[leaves_of(hierarchy)[1].reshape(-1)[:count]]

    def check(points: Array) -> None:
        if len(points) > 16:
            unit = 256 if len(points) > 256 else 16
            first = -(-len(points) // (2 * unit)) * unit
            assert overlap(points[:first], points[first:]) <= 1 / 64
            check(points[:first])
            check(points[first:])

    for start in range(0, count, HIERARCHY_RUN):
        check(centroids[start : start + HIERARCHY_RUN])


def test_neighbors_along_the_curve(device, monkeypatch):
    """Of triangles one per cell, in the order before that of runs, each lies in a cell next to that of the one before."""
    run = Stages.run
    monkeypatch.setattr(
        Stages, "run", lambda self, name, *rest, **extra: name == "hierarchy_runs" or run(self, name, *rest, **extra)
    )
    cells = np.stack(np.meshgrid(*[np.arange(16)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    small = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.1]]) + 0.45
    vertices = (cells[:, None] + small).reshape(-1, 3)
    end = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]]) + 0.001  # the frame is as large as all cells
    ends = np.concatenate([end, 16.0 - end])
    mesh = np.concatenate([vertices, ends]), np.arange(len(vertices) + len(ends)).reshape(-1, 3)
    faces = leaves_of(Hierarchy(device, *mesh))[1].reshape(-1)
    along = cells[faces[(faces < len(cells)) & (np.arange(len(faces)) < len(mesh[1]))]]
    assert len(along) == 4096
    assert (np.abs(np.diff(along, axis=0)).sum(axis=1) == 1).all()


@pytest.mark.parametrize("bits", [27, 29, 40])
def test_indices_of_many_bits(device, monkeypatch, bits):
    """As many as so many faces need: the curve is then coarser, and the same triangles cast the same shadows."""
    mesh = MESHES["crumpled"]
    expected = Hierarchy(device, *mesh)
    monkeypatch.setattr(hierarchy_module, "_index_bits", lambda count: bits)
    hierarchy = Hierarchy(device, *mesh)
    corners, faces = leaves_of(hierarchy)
    assert np.array_equal(np.unique(faces), np.arange(len(mesh[1])))
    assert np.array_equal(corners, hierarchy.vertices.array[:, 0, :3][mesh[1]][faces])
    if bits == 40:
        assert not np.array_equal(faces, leaves_of(expected)[1])
    points = neighbors(mesh, 1600)
    for light in lights_for(mesh)[:3]:
        assert np.array_equal(hierarchy.shadowed(*points, light), expected.shadowed(*points, light))


def test_bits_of_the_index():
    """26, which leave all of the curve's, and one more from 2^26 faces on."""
    bits = [hierarchy_module._index_bits(n) for n in (0, 1, 2**24 + 1, 2**26, 2**26 + 1, 2**29)]
    assert bits == [26, 26, 26, 26, 27, 29]


def test_memory(device):
    assert Hierarchy(device, *sphere(50, 100)).nbytes <= 64 * 9800


def test_triangles_that_cast_nothing(device):
    """Those with two equal corners or one that is not finite are left out, the others stay."""
    vertices, faces = box()
    vertices = np.concatenate([vertices, [[np.nan, 0, 0], [0, np.inf, 0]]])
    faces = np.concatenate([faces, [[0, 1, 8], [9, 2, 3], [0, 0, 1], [1, 2, 1]]])
    hierarchy = Hierarchy(device, vertices, faces)
    assert np.array_equal(np.unique(leaves_of(hierarchy)[1]), np.arange(12))
    point = np.array([[0.0, 0.0, -1.0]])
    assert hierarchy.shadowed(point, [0], np.array([0.0, 0.0, 3.0, 1.0])).all()


def test_no_casters(device):
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    hierarchy = Hierarchy(device, vertices, np.array([[0, 0, 1]]))
    assert not hierarchy.shadowed(np.zeros((20, 3)), np.zeros(20, int), np.array([0.0, 0.0, 1.0, 1.0])).any()


@pytest.mark.parametrize("offset", [0.0, 1e9])
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_frame(offset, scale):
    """Coordinates fill the range, and are within half a unit of the grid of what they stand for."""
    vertices = (np.random.default_rng(5).normal(size=(100, 3)) * [1.0, 0.1, 0.01] + offset) * scale
    frame = CasterFrame.around(vertices)
    pairs = frame.pairs(vertices).astype(np.float64)
    coordinates = pairs[:, :3] + pairs[:, 3:]
    assert SHADOW_REACH / 2 <= np.abs(coordinates).max() <= SHADOW_REACH
    assert np.array_equal(coordinates * 2.0**31, np.rint(coordinates * 2.0**31))
    assert np.abs(coordinates - (vertices - frame.origin) * frame.unit).max() <= 2.0**-32
