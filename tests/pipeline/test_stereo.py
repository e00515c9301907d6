"""Depths lead to points: under cameras from a matrix K and a pose, and as the disparities of stereo pairs."""

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

from clshade.cli.main import main
from clshade.images import exr
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

FLIPS = {"opencv": np.diag([1.0, 1.0, 1.0]), "opengl": np.diag([1.0, -1.0, -1.0])}


def pose_at(eye, target) -> np.ndarray:
    """Return the OpenCV pose (4, 4) (x right, y down, z forward), camera to world, that looks at a target."""
    z = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), eye
    return pose


def project(k: np.ndarray, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the pixels (P, 2) of world points (P, 3) under K and an OpenCV pose."""
    x, y, z = ((points - pose[:3, 3]) @ pose[:3, :3]).T
    return np.stack([k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]], axis=1)


@pytest.mark.parametrize(("convention", "pixel_center"), [("opencv", 0.5), ("opengl", 0)])
def test_depth_reprojects_into_another_view(device, convention, pixel_center):
    """Every pixel's Z leads to a point of the surface; in a second view it is within 1/12000 px of the true point,
    the intersection of the pixel's ray with the surface.

    Vertices are snapped to 1/65536 px, which moves them by up to 1/131072 px along either axis, and Z as if the surface
    had moved with them. Both cameras see the planes at less than 60 degrees from their normals and with equal K, so a
    point moves at most as far in the second image as in the first. Z has up to 10 roundings of 2^-24, of 100 px of
    parallax.
    """
    rng = np.random.default_rng(7)
    k = np.array([[410.0, 0.0, 157.3], [0.0, 395.0, 121.9], [0.0, 0.0, 1.0]])
    first, second = pose_at([0.3, 0.4, 6.0], [0.0, 0.1, 0.0]), pose_at([-0.8, 1.0, 6.5], [0.1, 0.0, 0.0])
    # Four triangles around a point in front: planes of different slopes, with corners away from pixel centers.
    rim = np.array([[-1.3, -1.1], [1.2, -0.9], [1.4, 1.0], [-1.2, 1.3]]) + rng.uniform(-0.1, 0.1, (4, 2))
    verts = np.vstack([[0.07, -0.05, 0.6], np.column_stack([rim, rng.uniform(-0.2, 0.2, 4)])])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    pose = first.copy()
    pose[:3, :3] = first[:3, :3] @ FLIPS[convention]
    camera = Camera.from_matrix(k, pose, (320, 240), pixel_center=pixel_center, convention=convention)
    frame = rendered(Scene(Mesh(verts, faces), camera), shader="nolight", layers=("Z", "id"), device=device)
    depth, face = frame["Z"].astype(np.float64), frame["id"].astype(int) - 1
    rows, columns = np.nonzero(face >= 0)
    assert len(rows) > 5000
    assert set(face[rows, columns]) == {0, 1, 2, 3}
    rays = np.stack([(columns + pixel_center - k[0, 2]) / k[0, 0], (rows + pixel_center - k[1, 2]) / k[1, 1]], axis=1)
    rays = np.column_stack([rays, np.ones(len(rays))]) @ first[:3, :3].T
    points = first[:3, 3] + depth[rows, columns, None] * rays
    corner = verts[faces[face[rows, columns]]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    reach = ((corner[:, 0] - first[:3, 3]) * normal).sum(axis=1) / (rays * normal).sum(axis=1)
    true = first[:3, 3] + reach[:, None] * rays
    assert np.abs(project(k, second, points) - project(k, second, true)).max() < 1 / 12000
    # A depth error of 1/1000 is detected.
    wrong = first[:3, 3] + 1.001 * depth[rows, columns, None] * rays
    assert np.abs(project(k, second, wrong) - project(k, second, true)).max() > 10 / 256


def test_pairs_of_a_command_are_those_of_python(device, tmp_path):
    """Also at another resolution than the scene's, at which principal points are fractions of another width."""
    small = ("--resolution", "40,24", "--preset", "course", "--layers", "Z,id", "--deterministic", "--quiet")
    assert main(["render", "quads", *small, "--stereo", "0.25", "--convergence", "5", "-o", str(tmp_path / "a")]) == 0
    scene = builtin("quads")
    for eye, name in zip(scene.camera.with_resolution((40, 24)).stereo(0.25, 5.0), ("left", "right"), strict=True):
        frame = render(replace(scene, camera=eye), preset="course", layers=("Z", "id"), device=device)
        assert np.array_equal(exr.read(tmp_path / f"a.{name}.exr")[0]["Z"], frame["Z"])
