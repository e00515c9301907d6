"""The built-in scenes: counts, orientation, closed surfaces, determinism; Newell's teapot against its patches."""

import itertools
import math

import numpy as np
import pytest
from surfaces import border, euler, face_normals, mesh_of, volume, welded

import clshade.scene.builtin.teapot as newell
from clshade.scene.builtin import scenes
from clshade.scene.model import Scene

FIELDS = ("verts", "faces", "colors", "normals", "normal_faces", "uvs", "uv_faces", "instances")


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_every_scene(name):
    """Its names, the same bits from the same call, faces with area, normals of length 1 that agree with the winding."""
    scene, second = (scenes.builtin(name, resolution=(64, 48)) for _ in range(2))
    assert isinstance(scene, Scene)
    assert (scene.name, scene.camera.resolution) == (name, (64, 48))
    assert scene.lights
    assert scenes.BUILTINS[name].__doc__
    for mesh, twin in zip(scene.meshes, second.meshes, strict=True):
        for field in FIELDS:
            a, b = getattr(mesh, field), getattr(twin, field)
            assert (a is None) == (b is None)
            assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes())
        if mesh.material.texture is not None:
            assert mesh.material.texture.image.tobytes() == twin.material.texture.image.tobytes()
        direction = face_normals(mesh)
        assert (np.abs(direction).max(axis=1) > 0.0).all(), mesh.name
        if mesh.normals is None:
            continue
        length = np.sqrt((mesh.normals.astype(np.float64) ** 2).sum(axis=1))
        tolerance = 4.0 * np.finfo(mesh.normals.dtype).eps  # rounding of three squares, a sum and a root, or of storage
        assert np.abs(length - 1.0).max() <= tolerance, mesh.name
        corners = mesh.normals[mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
        assert (np.einsum("fc,fkc->fk", direction, corners) > 0.0).all(), mesh.name


@pytest.mark.parametrize(("triangles", "p", "q"), [(18, 2, 3), (96, 1, 1), (1000, 3, 2), (12345, 5, 8), (100000, 2, 3)])
def test_knot_is_a_closed_torus_of_so_many_triangles(triangles, p, q):
    mesh = scenes.torus_knot(triangles, p, q).meshes[0]
    assert (mesh.verts.dtype, mesh.normals.dtype, mesh.faces.dtype) == (np.float32, np.float32, np.int32)
    assert len(mesh.verts) == len(mesh.faces) // 2
    assert border(mesh.faces) == 0
    assert euler(mesh.faces) == 0
    assert triangles < 1000 or abs(len(mesh.faces) - triangles) <= (0.01 * triangles if triangles % 1000 else 0)
    if triangles >= 12345:
        assert volume(mesh.verts, mesh.faces) > 0.0


def test_icospheres_are_closed_and_converge_to_the_ball():
    errors = []
    for level in range(6):
        mesh = scenes.icosphere(level).meshes[0]
        assert (len(mesh.faces), len(mesh.verts)) == (20 * 4**level, 10 * 4**level + 2)
        assert (border(mesh.faces), euler(mesh.faces)) == (0, 2)
        assert (mesh.normals == mesh.verts).all()
        errors.append(4.0 / 3.0 * math.pi - volume(mesh.verts, mesh.faces))
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    edge = 1.0 / math.sqrt(golden * math.sqrt(5.0)) * 2.0  # of the icosahedron in the unit sphere
    exact = 4.0 / 3.0 * math.pi - 5.0 / 12.0 * (3.0 + math.sqrt(5.0)) * edge**3
    assert math.isclose(errors[0], exact, rel_tol=1e-12)
    ratios = np.array(errors[:-1]) / errors[1:]
    assert errors[-1] > 0.0
    assert (np.abs(ratios[2:] - 4.0) < 0.1).all()  # second order


def test_the_lamp_of_the_soft_room_lights_it():
    scene = scenes.box_room(2, resolution=(40, 30), soft=True)
    light, fill = scene.lights
    lamp = mesh_of(scene, "lamp").verts
    assert (np.cross(light.right, light.up) < 0.0).tolist() == [False, True, False]  # it shines down
    assert light.position[1] < lamp[:, 1].min()
    corners = light.position + [[x, 0.0, z] for x in (-0.4, 0.4) for z in (-0.3, 0.3)]
    assert np.allclose(np.sort(corners[:, [0, 2]], axis=0), np.sort(lamp[:, [0, 2]], axis=0))
    assert (fill.position == scene.camera.eye).all()


# Newell's teapot

PATCHES = {
    "body": (newell.RIM, newell.BODY_UPPER, newell.BODY_LOWER, newell.BOTTOM),
    "lid": (newell.KNOB, newell.LID),
    "handle": (newell.HANDLE_UPPER, newell.HANDLE_LOWER),
    "spout": (newell.SPOUT_LOWER, newell.SPOUT_UPPER),
}


def casteljau(points: np.ndarray, t: float) -> np.ndarray:
    while len(points) > 1:
        points = points[:-1] + t * (points[1:] - points[:-1])
    return points[0]


def surface(patch, round_patch: bool, s: float, t: float) -> np.ndarray:
    """Evaluate a point of a patch of the table by repeated linear interpolation; y up."""
    points = np.array(patch)
    if round_patch:
        points = np.array([[(r, 0, z), (r, k, z), (k, r, z), (0, r, z)] for r, k, z in patch], float)
    x, y, z = casteljau(np.array([casteljau(row, t) for row in points]), s)
    return np.array([x, z, -y])


def test_teapot_points_and_normals_are_those_of_the_table():
    level, h = 5, 1e-5
    parts = newell.parts(level)
    for name, patches in PATCHES.items():
        is_round = name in ("body", "lid")
        for k, patch in enumerate(patches):
            for i, j in itertools.product(range(level + 1), repeat=2):
                # A tube's given half, y <= 0, comes first, in the reverse order of the table.
                s, t = i / level, (j / level if is_round else 1.0 - j / level)
                point, normal = (part[k * level + i, j] for part in parts[name])
                assert np.allclose(point, surface(patch, is_round, s, t), rtol=0.0, atol=1e-14), (name, k, i, j)
                if not (0 < i < level and 0 < j < level):
                    continue
                by_s, by_t = (
                    surface(patch, is_round, s + ds, t + dt) - surface(patch, is_round, s - ds, t - dt)
                    for ds, dt in ((h, 0.0), (0.0, h if is_round else -h))
                )
                across = np.cross(by_s, by_t)
                # Central differences: h^2 times the ratio of third to first derivatives (up to 20), and rounding 1e-16
                # / h.
                expected = across / np.sqrt(across @ across)
                assert np.allclose(normal, expected, rtol=0.0, atol=1e-8), (name, k, i, j)


@pytest.mark.parametrize("level", [2, 3, 10])
def test_teapot_is_free_of_cracks(level):
    scene = scenes.teapot(level)
    assert [mesh.name for mesh in scene.meshes] == ["body", "seat", "lid", "handle", "spout", "floor"]
    assert [scene.face_count, len(mesh_of(scene, "floor").faces)] == [64 * level**2 + 4248, 4248]
    _, faces = welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))
    assert border(faces) == 0
    assert euler(faces) == 2
    for name in ("handle", "spout"):
        verts, faces = welded(mesh_of(scene, name))
        assert border(faces) == 4 * level  # two open ends, inside the body or at the spout's mouth
        assert euler(faces) == 0
        mirrored = verts * [1.0, 1.0, -1.0] + 0.0  # + 0.0: no -0.0
        assert set(map(tuple, verts)) == set(map(tuple, mirrored))


def test_teapot_agrees_with_a_teapot_of_other_make(data_folder):
    """All its vertices are among ours: it has 10 x 10 cells per patch, too."""
    lines = (data_folder / "teapot.obj").read_text().splitlines()
    theirs = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    ours = np.concatenate([positions.reshape(-1, 3) for positions, _ in newell.parts(10).values()])
    furthest = max(np.abs(ours - point).max(axis=1).min() for point in theirs)
    assert furthest < 2e-6  # written with six decimals
