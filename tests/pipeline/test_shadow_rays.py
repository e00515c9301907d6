"""Shadow rays through the hierarchy of casters, to one light or in fans, against all triangles one by one; its tree."""

from functools import partial

import numpy as np
import pytest
from caster_meshes import Mesh, border_points, box, crumpled, face_points, joined, lattice, moved, slivers, soup, sphere
from kernel_stages import LANES
from shadow_rays import hidden, one_by_one

from clshade.oracle.transform import unit
from clshade.pipeline import hierarchy as hierarchy_module
from clshade.pipeline.hierarchy import CasterFrame, Hierarchy
from clshade.pipeline.launches import Stages
from clshade.pipeline.struct_layout import HIERARCHY_RUN, SHADOW_GRID, SHADOW_REACH

Array = np.ndarray
MANY = 32  # ends of a fan


def of_all_sizes() -> Mesh:
    """Return triangles from 1e-5 to 3 across."""
    rng = np.random.default_rng(1)
    size = 10.0 ** rng.uniform(-5.0, 0.5, (300, 1, 1))
    verts = rng.normal(size=(300, 1, 3)) + size * rng.normal(size=(300, 3, 3))
    return verts.reshape(-1, 3), np.arange(900).reshape(-1, 3)


MESHES = {
    "soup": soup(100),
    "of all sizes": of_all_sizes(),
    "crumpled": crumpled(16),
    "closed": joined(sphere(8, 10), moved(box(), 2.5), moved(sphere(), -2.0, 0.2)),
    "boxes side by side": joined(*(moved(box(), by, 0.25) for by in np.arange(8) * 0.5)),
    # Lattices close above one another: their receivers have lights close by, and triangles before these.
    "sheets": joined(*(moved(lattice(3), np.array([0.0, 0.0, z])) for z in (0.0, 5e-12, 5e-11, 5e-10, 5e-9))),
    "flat": joined(lattice(8), moved(box(), 0.4, 0.1), moved(lattice(5), 0.1, 0.5)),
    "turned": joined(lattice(8, True), moved(box(), 0.4, 0.1)),
    "slivers": joined(slivers(), lattice(4)),
    # Triangles so small beside the frame that what float32 leaves of their corners counts.
    "fine": joined(moved(crumpled(12), 0.71, 0.01), moved(sphere(4, 6), 0.71, 0.003), moved(lattice(1), -0.5)),
}
each_mesh = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)


neighbors = partial(face_points, seed=3, together=16)


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


def ends_for(mesh: Mesh, points: Array, receivers: Array, seed: int) -> list[tuple[Array, bool]]:
    """Return points (K, MANY, 3) of all kinds: of small lights and large, near and far, and where signs are hard to tell;
    and directions, which are said to be."""
    rng = np.random.default_rng(seed)
    corners = mesh[0][mesh[1]]
    center, shape = mesh[0].mean(axis=0), (len(points), MANY, 3)
    ball = unit(rng.normal(size=shape)) * rng.random((*shape[:2], 1)) ** (1 / 3)
    a, b, c = np.moveaxis(corners[receivers], 1, 0)
    normals = unit(np.cross(b - a, c - a))[:, None]
    u, v = rng.normal(size=(2, *shape[:2], 1))
    in_own_plane = u * (b - a)[:, None] + v * (c - a)[:, None]
    one = corners[rng.integers(0, len(corners), len(points))]
    in_another_plane = one[:, :1] + u * (one[:, 1:2] - one[:, :1]) + v * (one[:, 2:] - one[:, :1])
    # Just beside the borders of triangles, which float32 does not tell, and twice as far.
    part = rng.random((*shape[:2], 1))
    aimed = corners[rng.integers(0, len(corners), shape[:2])]
    borders = part * aimed[:, :, 0] + (1.0 - part) * aimed[:, :, 1]
    beside = borders + 10.0 ** rng.uniform(-10.0, -4.0, (*shape[:2], 1)) * np.ptp(mesh[0]) * ball
    vertices = corners[rng.integers(0, len(corners), shape[:2]), rng.integers(0, 3, shape[:2])]
    large = center + np.array([0.4, 0.7, 2.5])
    around = rng.normal(size=shape)
    ends = [
        large + 0.2 * ball,
        large + 2.0 * ball,
        center + 0.5 * ball,
        center + 3e4 * unit(rng.normal(size=3)) + 3e2 * ball,
        center + 3e12 * (unit(rng.normal(size=3)) + 0.2 * ball),
        points[:, None] + in_own_plane + rng.choice([0.0, 1e-9, 1e-6, -1e-6, 1e-3], (*shape[:2], 1)) * normals,
        points[:, None] + 0.3 * ball,
        points[:, None] + 10.0 ** rng.uniform(-12.0, -4.0, (*shape[:2], 1)) * ball,
        in_another_plane,
        vertices,
        2.0 * beside - points[:, None],
        np.where(np.arange(MANY)[:, None] % 4 == 0, vertices, center + 2.0 * ball),
    ]
    return [*((e, False) for e in ends), (around, True), (around * 0.05 + around[:, :1], True)]


@pytest.mark.long
@each_mesh
def test_rays_to_a_light_are_the_same_as_one_by_one(device, mesh):
    hierarchy = Hierarchy(device, *mesh)
    for light in lights_for(mesh):
        for points in (face_points(mesh, 1600), border_points(mesh, 800), neighbors(mesh, 1600)):
            in_shadow = hierarchy.shadowed(*points, light)
            wrong = np.flatnonzero(in_shadow != one_by_one(device, hierarchy, *points, light))
            assert not len(wrong), (light, wrong[:9], in_shadow[wrong[:9]])


@pytest.mark.long
@pytest.mark.parametrize("offset", [0.0, 1e9])
@each_mesh
def test_fans_are_the_same_as_one_by_one(device, mesh, offset):
    # As coarse as it is so far from the origin; points on it are no coarser.
    mesh = (mesh[0] + offset) - offset, mesh[1]
    hierarchy, shares = Hierarchy(device, *mesh), []
    for seed, (points, receivers) in enumerate((face_points(mesh, 48), border_points(mesh, 32))):
        for ends in ends_for(mesh, points, receivers, seed):
            fans = device, hierarchy, points, receivers, *ends
            is_hidden = hidden(*fans)
            wrong = np.argwhere(is_hidden != hidden(*fans, predicate=True))
            assert not len(wrong), (wrong[:9], is_hidden[tuple(wrong[0])])
            shares.append(is_hidden.mean())
    assert offset or 0.02 < np.mean(shares) < 0.98  # far away sheets coincide


@pytest.mark.long
@pytest.mark.parametrize("lanes", LANES[:-1])
def test_rays_of_any_number_of_lanes(device, lanes):
    for mesh in MESHES.values():
        hierarchies = [Hierarchy(device, *mesh, lanes=count) for count in (16, lanes)]
        for light in lights_for(mesh):
            assert np.array_equal(*(every.shadowed(*neighbors(mesh, 3200), light) for every in hierarchies))
        points, receivers = face_points(mesh, 50)
        for ends in ends_for(mesh, points, receivers, 5):
            fans = device, hierarchies[0], points, receivers, *ends
            assert np.array_equal(*(hidden(*fans, lanes=count) for count in (16, lanes)))


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


def test_triangles_seen_edge_on(device):
    """Float32 does not tell which of their sides the light is on, and rays meet them that seem to pass on the wrong side."""
    rng = np.random.default_rng(11)
    light = np.array([3.0, 2.0, 40.0, 1.0])
    a, b = rng.uniform(-1.0, 1.0, (2, 300, 3)) + [0.0, 0.0, 2.0]
    c = a + rng.random((300, 1)) * (b - a) + 0.05 * (light[:3] - a)
    c += unit(np.cross(b - a, c - a)) * 10.0 ** rng.uniform(-8.0, -3.0, (300, 1))
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


def cage(offset: float) -> tuple[Mesh, Array]:
    """Return closed meshes one within another over a ground, whose two faces are the last, and a point within all."""
    rotation, _ = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))
    turned = box()[0] @ rotation.T * 0.6, box()[1]
    ground = np.array([[-40.0, -40, -3], [40, -40, -3], [40, 40, -3], [-40, 40, -3]])
    mesh = joined(sphere(), turned, (ground, np.array([[0, 1, 2], [0, 2, 3]])))
    return (mesh[0] + offset, mesh[1]), np.array([0.05, 0.02, 0.1]) + offset


@pytest.mark.parametrize("offset", [0.0, 1e3, 1e9])
@pytest.mark.parametrize("count", [20_000, pytest.param(1_500_000, marks=pytest.mark.long)])
def test_closed_meshes_do_not_leak(device, offset, count):
    """Rays through a shell's edges and vertices; each shell by itself, so that no other hides the ray."""
    (vertices, faces), light = cage(offset)
    total = 0
    for first, last in ((0, 80), (80, 92)):
        shell = vertices, faces[first:last]
        mesh = vertices, np.concatenate([shell[1], faces[-2:]])
        at, _ = border_points(shell, count, 9)
        toward = at[at[:, 2] < light[2] - 0.1] - light
        corner = vertices[mesh[1][-2, 0]]
        points = light + toward * ((corner[2] - light[2]) / toward[:, 2])[:, None]
        points[:, 2] = corner[2]
        points = points[(np.abs(points[:, :2] - (corner[:2] + 40.0)) < 39.0).all(axis=1)]
        local = points - corner
        receivers = len(mesh[1]) - np.where(local[:, 1] <= local[:, 0], 2, 1)
        assert Hierarchy(device, *mesh).shadowed(points, receivers, np.array([*light, 1.0])).all()
        total += len(points)
    assert total > 0.4 * count


def test_fans_are_the_same_as_lights_by_themselves(device):
    """A fan's points one by one, as positions of point lights that are multiples of the grid."""
    mesh = MESHES["closed"]
    hierarchy = Hierarchy(device, *mesh)
    points, receivers = face_points(mesh, 200)
    grid = SHADOW_GRID / hierarchy.frame.unit
    lights = np.random.default_rng(9).normal(size=(16, 3)) * [0.3, 0.3, 0.1] + [0.5, 0.2, 4.0]
    lights = np.rint((lights - hierarchy.frame.origin) / grid) * grid + hierarchy.frame.origin
    is_hidden = hidden(device, hierarchy, points, receivers, np.broadcast_to(lights, (200, 16, 3)))
    for k, light in enumerate(lights):
        assert np.array_equal(is_hidden[:, k], hierarchy.shadowed(points, receivers, np.append(light, 1.0)))
    assert 0.1 < is_hidden.mean() < 0.9


def test_what_is_at_the_receiver_reaches_it(device):
    """A light, and the ends of fans, wherever the others are; also where triangles pass less than their bound from it."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    heights = np.arange(-12, 13) * SHADOW_GRID / 2.0**14
    hierarchy = Hierarchy(device, *joined(*[(floor + [0, 0, z], np.array([[0, 1, 2]])) for z in heights]))
    for k, z in enumerate(heights):
        for receiver in (k, 12):
            point = np.array([0.1, -0.2, z])
            assert not hierarchy.shadowed(point[None], np.array([receiver]), np.array([*point, 1.0])).any()
    mesh = soup(40)
    points, receivers = face_points(mesh, 32)
    hierarchy = Hierarchy(device, *mesh)
    grid = SHADOW_GRID / hierarchy.frame.unit
    points = np.rint((points - hierarchy.frame.origin) / grid) * grid + hierarchy.frame.origin
    ends = points[:, None] + np.random.default_rng(2).normal(size=(32, 16, 3))
    ends[:, ::3] = points[:, None]
    is_hidden = hidden(device, hierarchy, points, receivers, ends)
    assert not is_hidden[:, ::3].any()
    assert is_hidden[:, 1::3].any()


def test_neighbors_in_the_same_plane_cast_nothing(device):
    mesh = lattice(30)
    points, receivers = face_points(mesh, 400)
    ends = np.random.default_rng(3).normal(size=(400, 16, 3)) + [0.0, 0.0, 1.5]
    assert not hidden(device, Hierarchy(device, *mesh), points, receivers, ends).any()


def test_the_ends_of_a_segment(device):
    """A square halfway hides what is behind it, and nothing before it; a receiver near the frame's border."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    hierarchy = Hierarchy(device, *joined((floor, quad), (0.5 * floor + [0.0, 0.0, 0.5], quad)))
    heights = np.array([0.1, 0.4, 0.4999999, 0.5, 0.5000001, 0.6, 1.0, 30.0, 1e20])
    ends = np.array([0.013, 0.021, 1.0]) * heights[:, None]
    is_hidden = hidden(device, hierarchy, np.zeros((1, 3)), np.array([0]), ends[None])
    assert is_hidden[0].tolist() == [False] * 4 + [True] * 5
    assert hierarchy.frame.unit * 1e20 > SHADOW_REACH


# The hierarchy of casters: its tree, its order, and the frame of its coordinates


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
    return float(((lower.max(axis=0) - upper.min(axis=0)) / np.ptp(np.concatenate([lower, upper]), axis=0)).min())


@pytest.mark.parametrize("count", [17, 300, 4096, 9000])
def test_runs_are_halved_down_to_the_leaves(device, monkeypatch, count):
    """What each part puts first lies before the rest along some axis, but for what is within one of 64 steps. Parts begin
    with whole leaves, and above 256 triangles with whole nodes."""
    monkeypatch.setattr(hierarchy_module, "_TOGETHER", 4096)  # several launches
    mesh = soup(count)
    centroids = mesh[0][mesh[1]].mean(axis=1)[leaves_of(Hierarchy(device, *mesh))[1].reshape(-1)[:count]]

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


def test_indices_of_many_bits(device, monkeypatch):
    """As many as so many faces need: the curve is then coarser, and the same triangles cast the same shadows."""
    mesh = crumpled(16)
    expected = Hierarchy(device, *mesh)
    assert [hierarchy_module._index_bits(count) for count in (0, 2**26, 2**26 + 1, 2**29)] == [26, 26, 27, 29]
    monkeypatch.setattr(hierarchy_module, "_index_bits", lambda count: 40)
    hierarchy = Hierarchy(device, *mesh)
    corners, faces = leaves_of(hierarchy)
    assert np.array_equal(np.unique(faces), np.arange(len(mesh[1])))
    assert np.array_equal(corners, hierarchy.vertices.array[:, 0, :3][mesh[1]][faces])
    assert not np.array_equal(faces, leaves_of(expected)[1])
    rays = *face_points(mesh, 1600), np.array([0.3, -0.2, 0.4, 1.0])
    assert np.array_equal(hierarchy.shadowed(*rays), expected.shadowed(*rays))


def test_triangles_that_cast_nothing(device):
    """Those with two equal corners or one that is not finite are left out, the others stay; none may be left."""
    vertices, faces = box()
    vertices = np.concatenate([vertices, [[np.nan, 0, 0], [0, np.inf, 0]]])
    faces = np.concatenate([faces, [[0, 1, 8], [9, 2, 3], [0, 0, 1], [1, 2, 1]]])
    hierarchy = Hierarchy(device, vertices, faces)
    assert np.array_equal(np.unique(leaves_of(hierarchy)[1]), np.arange(12))
    point, light = np.array([[0.0, 0.0, -1.0]]), np.array([0.0, 0.0, 3.0, 1.0])
    assert hierarchy.shadowed(point, [0], light).all()
    assert not Hierarchy(device, vertices[:8], faces[-1:]).shadowed(point, [0], light).any()


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
