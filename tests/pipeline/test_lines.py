"""Lines along edges: the edges of meshes and their kinds, their width in frames, and what hides them."""

from dataclasses import replace

import numpy as np
import pytest
from devices import needs_float64

import clshade
from clshade.errors import InputError
from clshade.oracle import lines as oracle
from clshade.pipeline.lines import always_drawn, face_normals, facing, mesh_edges, outlines
from clshade.pipeline.renderer import render
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, PointLight, Scene, Settings
from clshade.scene.settings import Edges

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # normals point outwards
CUBE_FACES = np.array([corners for a, b, c, d in SIDES for corners in ((a, b, c), (a, c, d))])


def cube(shared: bool = True) -> Mesh:
    """Return a cube from (0, 0, 0) to (1, 1, 1); with `shared` False every face has vertices of its own."""
    if shared:
        return Mesh(CORNERS, CUBE_FACES)
    return Mesh(CORNERS[CUBE_FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3))


# Seen from above.
FLOOR = Mesh([[-3.0, 0, -3.0], [4.0, 0, -3.0], [4.0, 0, 4.0], [-3.0, 0, 4.0]], [[0, 2, 1], [0, 3, 2]])


def scene_of(*meshes: Mesh, eye=(3.1, 2.3, 4.2), lookat=(0.5, 0.5, 0.5), resolution=(60, 45)) -> Scene:
    camera = Camera(eye, lookat, (0.0, 1.0, 0.0), 1.3, (1.0, 4 / 3), resolution)
    return Scene(meshes, camera, PointLight((3.0, 5.0, 4.0), np.ones(3)), 0.3, 0.5)


def count(mesh: Mesh, kind: str, **fields) -> int:
    edges = mesh_edges(mesh.verts, mesh.faces)
    return int(always_drawn(edges, Edges(kind, **fields), face_normals(mesh.verts, mesh.faces)).sum())


def test_kinds_of_edges():
    """A cube has 12 features and 6 diagonals, also if a face winds the other way. Without one triangle three edges are
    boundaries; a fin on an edge makes that one non-manifold, two more open."""
    turned = cube().faces.copy()
    turned[0] = turned[0][::-1]
    fin = Mesh(np.vstack([CORNERS, [[2.0, 2.0, 2.0]]]), np.vstack([CUBE_FACES, [[0, 1, 8]]]))
    for mesh, counts in (
        (cube(), [18, 12, 0, 0]),
        (cube(shared=False), [18, 12, 0, 0]),
        (replace(cube(), faces=turned), [18, 12, 0, 0]),
        (replace(cube(), faces=CUBE_FACES[1:]), [18, 10, 3, 0]),
        (fin, [20, 11, 2, 1]),
    ):
        assert [count(mesh, kind) for kind in ("all", "feature", "boundary", "nonmanifold")] == counts
    assert count(cube(), "feature", angle=91) == 0


def test_silhouettes():
    """From a corner's direction a cube's outline has six edges, from before a side, in perspective, four; no diagonal."""
    mesh = cube()
    edges, normals = mesh_edges(mesh.verts, mesh.faces), face_normals(mesh.verts, mesh.faces)
    views = ((5.0, 6.0, 7.0), None, 6), ((0.5, 0.4, 7.0), None, 4), ((0.5, 0.4, 0.6), None, 0), (0, -np.ones(3), 6)
    for eye, direction, expected in views:
        front = facing(mesh.verts, mesh.faces, normals, np.full(3, eye), direction)
        assert outlines(edges, front).sum() == expected


def test_equal_positions_are_one_vertex_and_minus_zero_is_zero():
    verts = np.array([[0.0, 1, 2], [3, 4, 5], [6, 7, 9], [-0.0, 1, 2], [5, 3, 1]])
    assert mesh_edges(verts, np.array([[0, 1, 2], [1, 3, 4]])).ends.tolist() == [[0, 1], [0, 2], [0, 4], [1, 2], [1, 4]]
    assert len(mesh_edges(np.zeros((0, 3)), np.zeros((0, 3), np.int32))) == 0


def test_host_and_oracle_agree():
    rng = np.random.default_rng(3)
    verts = rng.integers(0, 3, (40, 3)).astype(float)  # many equal ones
    faces = rng.integers(0, 40, (120, 3))
    edges, expected = mesh_edges(verts, faces), oracle.mesh_edges(verts[faces])

    def ends_of(pair: np.ndarray) -> frozenset:
        return frozenset(map(tuple, pair.tolist()))

    ours = {
        ends_of(verts[pair]): set(edges.faces[start : start + count].tolist())
        for pair, start, count in zip(edges.ends, edges.starts, edges.counts, strict=True)
    }
    theirs = {ends_of(pair): set(expected.face[expected.edge == k].tolist()) for k, pair in enumerate(expected.ends)}
    assert ours == theirs
    assert len(ours) > 50


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"kinds": "crease"}, "Edges: kinds: expected one of all, feature"),
        ({"kinds": ()}, "Edges: kinds: expected names of all"),
        ({"width": 0}, "Edges: width: expected pixels above 0, at most 64"),
        ({"width": 65}, "Edges: width: expected pixels above 0, at most 64"),
        ({"angle": 181}, "Edges: angle: expected degrees from 0 to 180"),
        ({"color": (0, -1, 0)}, "Edges: color: expected a name such as white, #rrggbb .sRGB., or three linear numbers"),
        ({"only": 1}, "Edges: only: expected True or False"),
    ],
)
def test_refused_values(fields, expected):
    with pytest.raises(InputError, match=expected):
        Edges(**fields)


def test_kinds_alone_are_edges():
    assert Settings(edges=["boundary", "feature"]).edges == Edges(("feature", "boundary"))
    with pytest.raises(InputError, match="Settings: edges: expected Edges, names of all"):
        Settings(edges=3)


@pytest.fixture(autouse=True)
def _device_with_float64(request):
    if "device" in request.fixturenames:
        needs_float64(request.getfixturevalue("device"))


def passes(frame) -> bool:
    report = clshade.check(frame, "all")
    return report.passed and report.complete


def flat_scene(verts, faces, resolution=(32, 32)):
    """Return a scene in pixels: (x, y) of a vertex is its place in the image, z its depth."""
    camera = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, resolution[::-1], resolution, (0, 0), True)
    return replace(scene_of(Mesh(np.array(verts, float) * [-1, 1, 1], np.array(faces))), camera=camera)


def test_lines_have_their_width(device):
    """Lines 3 px wide along pixel borders cover three rows or columns; the rule is closed, so centers at 1.5 count."""
    scene = flat_scene([[8.5, 8.5, 5], [24.5, 8.5, 5], [24.5, 24.5, 5], [8.5, 24.5, 5]], [[0, 1, 2], [0, 2, 3]])
    coverage = render(scene, device=device, edges=Edges("boundary", width=3, only=True)).alpha[::-1] > 0
    rows, columns = np.mgrid[0:32, 0:32]
    inner = np.maximum(abs(rows - 16), abs(columns - 16))
    expected = (inner >= 7) & (inner <= 9)
    corner = (abs(rows - 16) > 8) & (abs(columns - 16) > 8)  # the joins are round: 1 px off both ways is within 1.5
    assert np.array_equal(coverage, expected | (corner & (inner <= 9)))


def test_a_fin_is_drawn_in_its_own_color(device):
    fin = Mesh([[0.0, 1, 1], [1, 1, 1], [0.5, 1.6, 1.2]], [[0, 1, 2]])
    frame = render(scene_of(cube(), fin), device=device, edges="nonmanifold", samples=4)
    assert passes(frame)
    assert (frame.rgb == [1, 0, 0]).all(axis=-1).sum() > 5


@pytest.mark.long
def test_edges_in_a_surface_are_not_stippled(device):
    """A cube stands on a floor: its bottom edges lie in the plane of the floor's triangles, at the same depth but for the
    snapping of all corners."""
    scenes = scene_of(cube(), FLOOR, resolution=(240, 180)), scene_of(cube(), resolution=(240, 180))
    lines, alone = (render(scene, device=device, edges=Edges("feature", only=True)).alpha > 0 for scene in scenes)
    assert np.array_equal(lines, alone)
    assert lines.sum() > 400


def test_nothing_shows_through(device):
    """Behind a wall no line shows, although the mesh behind is finer than pixels and the wall is of slivers."""
    steps = np.linspace(-3, 4, 200)
    verts = np.array([[x, y, 2.0] for x in steps for y in (-3.0, 4.0)])
    faces = np.array([[2 * i + a, 2 * i + b, 2 * i + c] for i in range(199) for a, b, c in ((0, 2, 1), (1, 2, 3))])
    scene = scene_of(cube(), Mesh(verts, faces), eye=(0.5, 0.5, 6.0))
    assert not render(scene, device=device, edges=Edges("feature", only=True)).alpha.any()


def test_a_scene_without_faces(device):
    scene = scene_of(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)))
    assert not render(scene, device=device, edges=Edges("all", only=True)).alpha.any()


def test_far_away_and_end_on(device):
    """Edges seen end-on, exactly and nearly, in coordinates of 1e7."""
    shift = np.array([1e7, -2e7, 3e7])
    mesh = replace(cube(), verts=cube().verts + shift)
    for eye in ([0.5, 0.5, 6.0], [1.0, 1.0, 6.0], [1.0, 1.00001, 4.0]):
        scene = scene_of(mesh, eye=np.array(eye) + shift, lookat=np.array([*eye[:2], 0.0]) + shift)
        assert passes(render(scene, device=device, edges="all", layers=("Z", "id")))


@pytest.mark.long
def test_culled_faces_neither_hide_nor_have_lines(device):
    scene = scene_of(FLOOR, eye=(0.5, -3.0, 4.0))
    for cull in (True, False):
        assert render(scene, device=device, edges=Edges("all", only=True), cull=cull).alpha.any() != cull
