"""Newell's teapot: its patches, its surface against their definition, its volume, cracks and images."""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path

import numpy as np
import pytest
from surfaces import border, euler, mesh_of, volume, welded

import clshade.scene.builtin.teapot as newell
from clshade import oracle
from clshade.scene.builtin import scenes
from clshade.scene.model import Settings

SMALL = {"resolution": (64, 48)}

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


@pytest.mark.parametrize("level", [2, 7, 10])
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
                # A tube's given half, y <= 0, comes first, in the reverse order of the table.
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
                # Central differences: h^2 times the ratio of third to first derivatives (up to 20), and rounding 1e-16
                # / h.
                assert np.allclose(parts[name][1][k * level + i, j], normal, rtol=0.0, atol=1e-8), (name, k, i, j)


def test_teapot_poles_have_their_limit_normals():
    parts = newell.parts(6)
    body, lid = parts["body"][1], parts["lid"][1]
    assert np.allclose(lid[0], [0.0, 1.0, 0.0], rtol=0.0, atol=1e-15)
    assert np.allclose(body[-1], [0.0, -1.0, 0.0], rtol=0.0, atol=1e-15)
    positions = parts["lid"][0]
    assert (positions[0] == [0.0, 3.15, 0.0]).all()


@pytest.mark.parametrize("level", [2, 3, 10])
def test_teapot_is_free_of_cracks(level):
    scene = scenes.teapot(level)
    _, faces = welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))
    assert border(faces) == 0
    assert euler(faces) == 2
    for name in ("handle", "spout"):
        verts, faces = welded(mesh_of(scene, name))
        assert border(faces) == 4 * level  # two open ends, inside the body or at the spout's mouth
        assert euler(faces) == 0
        mirrored = verts * [1.0, 1.0, -1.0] + 0.0  # + 0.0: no -0.0
        assert set(map(tuple, verts)) == set(map(tuple, mirrored))


def test_teapot_faces_outwards():
    scene = scenes.teapot()
    assert volume(*welded(*(mesh_of(scene, name) for name in ("body", "seat", "lid")))) > 0.0
    for name in ("handle", "spout"):
        tube = newell.parts(10)[name][0]
        first, last = (np.broadcast_to(tube[k].mean(axis=0), tube[:1].shape) for k in (0, -1))  # closed by cones
        assert volume(*scenes._welded(np.concatenate([first, tube, last]))[:2]) > 0.0


def polynomial(four) -> np.poly1d:
    t = np.poly1d([1.0, 0.0])
    a, b, c, d = map(float, four)
    return a * (1 - t) ** 3 + 3 * b * t * (1 - t) ** 2 + 3 * c * t**2 * (1 - t) + d * t**3


def integral(function: np.poly1d) -> float:
    return float(np.polyint(function)(1.0))


def test_teapot_body_volume_converges_to_that_of_its_profile():
    x, y = polynomial((1.0, 1.0, 0.56, 0.0)), polynomial((0.0, 0.56, 1.0, 1.0))
    section = 4.0 * 0.5 * integral(x * y.deriv() - y * x.deriv())  # of radius 1
    assert abs(section - math.pi) < 0.03
    expected = 0.0
    for patch in (newell.BODY_UPPER, newell.BODY_LOWER, newell.BOTTOM):
        radius, inner, height = np.array(patch).T
        assert np.allclose(inner, 0.56 * radius)
        expected -= section * integral(polynomial(radius) ** 2 * polynomial(height).deriv())

    def meshed(level: int) -> float:
        below_rim = newell.parts(level)["body"][0][level:]
        lid = np.broadcast_to([0.0, 2.4, 0.0], below_rim[:1].shape)
        return volume(*scenes._welded(np.concatenate([lid, below_rim]))[:2])

    errors = [abs(meshed(level) - expected) for level in (8, 16, 32)]
    assert errors[0] < 0.01 * expected
    assert errors[1] < errors[0] / 3.8  # second order: a quarter per level
    assert errors[2] < errors[1] / 3.8


def test_teapot_has_newells_dimensions():
    """The surface's, not those of the control points: the spout's tip at 3.434, the widest circle beyond 2 by the
    arc."""
    scene = scenes.teapot(40)
    verts = np.concatenate([mesh.verts for mesh in scene.meshes if mesh.name != "floor"])
    assert np.allclose(verts.min(axis=0), [-3.0, 0.0, -2.0], rtol=0.0, atol=1e-4)
    assert np.allclose(verts.max(axis=0), [3.434, 3.15, 2.0], rtol=0.0, atol=1e-3)


def test_teapot_patches_join_smoothly():
    """Along a profile or a tube the direction is continuous where patches meet, so mistyped numbers are detected."""
    for patches in PATCHES.values():
        for first, second in itertools.pairwise(patches):
            first, second = np.array(first), np.array(second)
            assert (first[3] == second[0]).all()
            before, after = first[3] - first[2], second[1] - second[0]
            cosine = (before * after).sum(-1) / np.sqrt((before**2).sum(-1) * (after**2).sum(-1))
            assert (cosine > 1.0 - 1e-9).all()


def test_teapot_agrees_with_a_teapot_of_other_make():
    """All its vertices are among ours: it has 10 x 10 cells per patch, too."""
    path = Path(os.environ.get("CLSHADE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "teapot.obj"
    if not path.exists():
        pytest.skip(f"needs {path}; CLSHADE_DATA names its folder")
    theirs = np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], float)
    ours = np.concatenate([positions.reshape(-1, 3) for positions, _ in newell.parts(10).values()])
    furthest = max(np.abs(ours - point).max(axis=1).min() for point in theirs)
    assert furthest < 2e-6  # written with six decimals


def test_teapot_stands_on_its_floor_in_the_light():
    scene = scenes.teapot()
    floor = mesh_of(scene, "floor")
    assert (floor.verts[:, 1] == 0.0).all()
    assert floor.colors.min() >= 0.0
    assert floor.colors.max() <= 1.0
    key, orange, blue = (light.intensity for light in scene.lights)
    assert np.ptp(key) < 0.2
    assert orange[0] > 3.0 * orange[2]
    assert blue[2] > 3.0 * blue[0]
    assert len({mesh.material.name for mesh in scene.meshes}) == 5
    camera = scene.camera  # nothing needs clipping
    forward = (camera.lookat - camera.eye) / np.linalg.norm(camera.lookat - camera.eye)
    assert min(((mesh.verts - camera.eye) @ forward).min() for mesh in scene.meshes) > 1.0


def test_teapot_shadows_lie_away_from_the_light():
    points = np.array([[0.0, 0.0, 0.0], [-3.2, 0.0, 0.0], [4.2, 0.0, 0.0], [0.0, 0.0, 4.0]])
    above, right = newell.shadows([np.array([0.0, 1000.0, 0.0]), np.array([20.0, 14.0, 0.0])], points)
    assert above[0] > 0.95
    assert above[1] < 0.2  # 0.2 beside the handle: the softened edge of its shadow
    assert above[2:].tolist() == [0.0, 0.0]
    assert right[:2].min() > 0.9
    assert right[2:].tolist() == [0.0, 0.0]


def test_teapot_has_highlights_beyond_one():
    scene = scenes.teapot(4, resolution=(80, 60))
    rgb = oracle.render(scene, Settings()).rgb
    assert rgb.max() > 1.5
    assert 0.003 < (rgb.max(axis=2) > 1.0).mean() < 0.1  # highlights, not an overexposed image
    assert np.median(rgb) < 0.5


@pytest.mark.parametrize(
    ("make", "shape"),
    [
        (newell.body_image, (512, 512, 3)),
        (newell.lid_image, (256, 256, 3)),
        (newell.tube_image, (256, 128, 3)),
        (newell.marble_image, (384, 384, 3)),
        (newell.swirl_image, (256, 256, 3)),
    ],
)
def test_images_are_colors_that_repeat_without_a_seam(make, shape):
    image = make()
    assert image.shape == shape
    assert image.dtype == np.float32
    assert image.min() >= 0.0
    assert image.max() <= 1.0
    assert image.std() > 0.02
    assert (image * 4096.0 == np.rint(image * 4096.0)).all()
    seam = np.abs(image[:, 0] - image[:, -1]).mean()
    inside = np.abs(np.diff(image, axis=1)).mean(axis=(0, 2))
    assert seam <= 1.5 * inside.max()
