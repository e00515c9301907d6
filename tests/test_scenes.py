"""The built-in scenes: counts, orientation, closed surfaces, options, determinism."""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter

import numpy as np
import pytest

import clshade.teapot as newell
from clshade import oracle, scenes
from clshade.errors import InputError
from clshade.scene import MAX_FACES, Mesh, Scene, Settings

SMALL = {"resolution": (64, 48)}
FIELDS = ("verts", "faces", "colors", "normals", "normal_faces", "uvs", "uv_faces", "instances")


def mesh_of(scene: Scene, name: str) -> Mesh:
    return next(mesh for mesh in scene.meshes if mesh.name == name)


def face_normals(mesh: Mesh) -> np.ndarray:
    """Cross products, (F, 3), as long as twice the area."""
    a, b, c = (mesh.verts[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def volume(verts: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (verts[faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def welded(*meshes: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """One surface of several meshes; only positions equal bit for bit become one vertex."""
    starts = np.cumsum([0] + [len(mesh.verts) for mesh in meshes])
    verts = np.concatenate([mesh.verts for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)])
    verts, index = np.unique(verts, axis=0, return_inverse=True)
    return verts, index.reshape(-1)[faces]


def directed_edges(faces: np.ndarray) -> Counter:
    return Counter(map(tuple, np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()))


def border(faces: np.ndarray) -> list[tuple[int, int]]:
    """Edges without a partner in the opposite direction; asserts that none is used twice in one direction."""
    edges = directed_edges(faces)
    assert set(edges.values()) == {1}
    return [(a, b) for a, b in edges if (b, a) not in edges]


def euler(faces: np.ndarray) -> int:
    edges = {tuple(sorted(edge)) for edge in directed_edges(faces)}
    return len(np.unique(faces)) - len(edges) + len(faces)


# Every scene


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_builds_a_scene_of_that_name_and_resolution(name):
    scene = scenes.builtin(name, **SMALL)
    assert isinstance(scene, Scene)
    assert scene.name == name
    assert scene.camera.resolution == (64, 48)
    assert scene.lights
    assert scenes.BUILTINS[name] is getattr(scenes, name)
    assert scenes.BUILTINS[name].__doc__


def test_the_teapot_is_the_default():
    scene = scenes.builtin()
    assert scene.name == "teapot"
    assert scene.camera.resolution == (800, 600)


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_the_same_call_gives_the_same_bits(name):
    first, second = scenes.builtin(name), scenes.builtin(name)
    assert len(first.meshes) == len(second.meshes)
    for one, two in zip(first.meshes, second.meshes, strict=True):
        for field in FIELDS:
            a, b = getattr(one, field), getattr(two, field)
            assert (a is None) == (b is None)
            assert a is None or (a.dtype == b.dtype and a.tobytes() == b.tobytes())
        if one.material.texture is not None:
            assert one.material.texture.image.tobytes() == two.material.texture.image.tobytes()


@pytest.mark.parametrize("name", scenes.BUILTINS)
def test_normals_are_unit_and_agree_with_the_winding(name):
    for mesh in scenes.builtin(name).meshes:
        direction = face_normals(mesh)
        assert (np.abs(direction).max(axis=1) > 0.0).all(), mesh.name  # no face without area
        if mesh.normals is None:
            continue
        length = np.sqrt((mesh.normals.astype(np.float64) ** 2).sum(axis=1))
        tolerance = 4.0 * np.finfo(mesh.normals.dtype).eps  # rounding of three squares, a sum and a root, or of storing
        if name != "box_room":
            assert np.abs(length - 1.0).max() <= tolerance, mesh.name
        corners = mesh.normals[mesh.faces if mesh.normal_faces is None else mesh.normal_faces]
        assert (np.einsum("fc,fkc->fk", direction, corners) > 0.0).all(), mesh.name


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("tea", {}, "teapot, torus_knot, icosphere, quads, box_room, course"),
        (None, {}, "name"),
        (["teapot"], {}, "name"),
        ("teapot", {"triangles": 3}, "level, resolution"),
        ("teapot", {"level": 0}, "level"),
        ("teapot", {"level": 2.5}, "level"),
        ("teapot", {"level": "10"}, "level"),
        ("teapot", {"level": 501}, "level"),
        ("teapot", {"resolution": 5}, "resolution"),
        ("teapot", {"resolution": (0, 5)}, "resolution"),
        ("torus_knot", {"triangles": 17}, "triangles"),
        ("torus_knot", {"triangles": MAX_FACES + 1}, "triangles"),
        ("torus_knot", {"triangles": math.nan}, "triangles"),
        ("torus_knot", {"p": 2, "q": 4}, "common divisor"),
        ("torus_knot", {"p": 0}, "p"),
        ("icosphere", {"level": 10}, "level"),
        ("icosphere", {"level": -1}, "level"),
        ("quads", {"count": 0}, "count"),
        ("quads", {"seed": -1}, "seed"),
        ("quads", {"resolution": (1, 2, 3)}, "resolution"),
        ("box_room", {"divisions": True}, "divisions"),
        ("course", {"level": None}, "level"),
    ],
)
def test_bad_options_are_refused_by_name(name, options, told):
    with pytest.raises(InputError, match=told) as caught:
        scenes.builtin(name, **options)
    assert "\n" not in str(caught.value)


# The teapot

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
    """A point of a patch as the table means it, by repeated linear interpolation; y up."""
    points = np.array(patch)
    if round_patch:
        points = np.array([[(r, 0, z), (r, k, z), (k, r, z), (0, r, z)] for r, k, z in patch], float)
    x, y, z = casteljau(np.array([casteljau(row, t) for row in points]), s)
    return np.array([x, z, -y])


@pytest.mark.parametrize("level", [1, 2, 7, 10])
def test_teapot_has_64_triangles_for_each_square_of_its_level(level):
    scene = scenes.teapot(level)
    pot = sum(len(mesh.faces) for mesh in scene.meshes if mesh.name != "floor")
    assert pot == 64 * level**2
    assert len(mesh_of(scene, "floor").faces) == 4248
    assert [mesh.name for mesh in scene.meshes] == ["body", "seat", "lid", "handle", "spout", "floor"]


def test_teapot_points_are_those_of_the_table():
    level = 4
    parts = newell.parts(level)
    for name, patches in PATCHES.items():
        positions = parts[name][0]
        for k, patch in enumerate(patches):
            for i, j in itertools.product(range(level + 1), repeat=2):
                is_round = name in ("body", "lid")
                # A tube's given half, y <= 0, comes first and runs against the order of the table.
                expected = surface(patch, is_round, i / level, j / level if is_round else 1.0 - j / level)
                assert np.allclose(positions[k * level + i, j], expected, rtol=0.0, atol=1e-14), (name, k, i, j)


def test_teapot_normals_are_those_of_the_surface():
    level, h = 5, 1e-5
    parts = newell.parts(level)
    for name, patches in PATCHES.items():
        is_round = name in ("body", "lid")
        for k, patch in enumerate(patches):
            for i, j in itertools.product(range(1, level), repeat=2):
                s, t = i / level, (j / level if is_round else 1.0 - j / level)
                by_s, by_t = (
                    surface(patch, is_round, s + ds, t + dt) - surface(patch, is_round, s - ds, t - dt)
                    for ds, dt in ((h, 0.0), (0.0, h if is_round else -h))
                )
                normal = np.cross(by_s, by_t)
                normal /= np.sqrt(normal @ normal)
                # Central differences: h^2 times third over first derivatives (up to 20), and rounding 1e-16 / h.
                assert np.allclose(parts[name][1][k * level + i, j], normal, rtol=0.0, atol=1e-8), (name, k, i, j)


def test_teapot_poles_have_their_limit_normals():
    parts = newell.parts(6)
    body, lid = parts["body"][1], parts["lid"][1]
    assert np.allclose(lid[0], [0.0, 1.0, 0.0], rtol=0.0, atol=1e-15)
    assert np.allclose(body[-1], [0.0, -1.0, 0.0], rtol=0.0, atol=1e-15)
    positions = parts["lid"][0]
    assert (positions[0] == [0.0, 3.15, 0.0]).all()


@pytest.mark.parametrize("level", [1, 3, 10])
def test_teapot_is_free_of_cracks(level):
    scene = scenes.teapot(level)
    _, faces = welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))
    assert border(faces) == []
    assert euler(faces) == 2
    for name in ("handle", "spout"):
        verts, faces = welded(mesh_of(scene, name))
        assert len(border(faces)) == 4 * level  # the two open ends, inside the body or at the spout's mouth
        assert euler(faces) == 0
        assert (verts * [1.0, 1.0, -1.0] + 0.0).tolist() in [sorted((verts * [1.0, 1.0, -1.0] + 0.0).tolist())] or len(
            np.unique(np.concatenate([verts, verts * [1.0, 1.0, -1.0] + 0.0]), axis=0)
        ) == len(verts)  # its own mirror image, bit for bit


def test_teapot_faces_outwards():
    scene = scenes.teapot()
    assert volume(*welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))) > 0.0
    for name in ("handle", "spout"):
        positions, normals = newell.parts(10)[name]
        middles = positions[:, :-1].mean(axis=1, keepdims=True)
        out = ((positions - middles) * normals).sum(axis=2)
        assert (out[2:-2] > 0.0).all()


def test_teapot_body_volume_converges_to_that_of_its_profile():
    """Volume of revolution by Simpson's rule, times the area of Newell's quarter arc over that of a circle."""
    profile = np.concatenate([np.array(patch)[None] for patch in PATCHES["body"]] + [np.array(newell.LID)[None]])
    expected, n = 0.0, 2000
    for patch in (newell.BODY_UPPER, newell.BODY_LOWER, newell.BOTTOM):
        t = np.linspace(0.0, 1.0, n + 1)
        weights = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3], axis=1)
        slopes = np.stack([-3 * (1 - t) ** 2, 3 * (1 - t) * (1 - 3 * t), 3 * t * (2 - 3 * t), 3 * t * t], axis=1)
        r, _, z = np.array(patch).T
        simpson = np.tile([2.0, 4.0], n // 2 + 1)[: n + 1] / (3.0 * n)
        simpson[[0, -1]] = 1.0 / (3.0 * n)
        expected -= float(((weights @ r) ** 2 * (slopes @ z) * simpson).sum())
    k = 0.56  # the arc (1,0) (1,k) (k,1) (0,1): area between it and the center, by Green's theorem
    expected *= 4.0 * (0.5 + 0.3 * k + 0.3 * k - 0.15 * k * k - 0.1) if False else 4.0 * arc_area(k)
    del profile

    def cup(level: int) -> float:
        positions = newell.parts(level)["body"][0][level:]  # from the top of the rim's outside down
        lid = np.broadcast_to([0.0, 2.4, 0.0], positions[:1].shape)
        return grid_volume(np.concatenate([lid, positions]))

    errors = [abs(cup(level) - expected) for level in (8, 16, 32)]
    assert errors[0] < 0.02 * expected
    assert errors[1] < errors[0] / 3.5  # second order
    assert errors[2] < errors[1] / 3.5
