"""Cameras from a matrix K and a pose: points project accordingly, and depth leads back to the points.

All arithmetic here is that of the pinhole model in float64, without clshade's cameras.
"""

from __future__ import annotations

import numpy as np
import pytest
from devices import rendered

from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene

FLIPS = {"opencv": np.diag([1.0, 1.0, 1.0]), "opengl": np.diag([1.0, -1.0, -1.0])}


@pytest.mark.parametrize("convention", ["opencv", "opengl"])
@pytest.mark.parametrize("pixel_center", [0.5, 0])
def test_points_project_where_the_matrix_says(device, convention, pixel_center):
    """Small quads around known points cover the pixels given by K and the pose, and Z leads back to the points."""
    rng = np.random.default_rng(3)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, [1.0, -2.0, 0.5]
    k = np.array([[220.0, 0.0, 70.0], [0.0, 240.0, 41.0], [0.0, 0.0, 1.0]])
    pixels = np.array([[10, 12], [60, 30], [120, 80], [33, 71]])
    depth = np.array([2.0, 3.0, 4.0, 5.0])
    centers = pixels + pixel_center
    in_camera = np.stack(
        [(centers[:, 0] - 70.0) / 220.0 * depth, (centers[:, 1] - 41.0) / 240.0 * depth, depth], axis=1
    )
    size = 0.4 / 230.0 * depth  # a quad of 0.8 px covers only the pixel whose center is its center
    corners = in_camera[:, None] + size[:, None, None] * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    world = corners.reshape(-1, 3) @ (rotation @ FLIPS[convention]).T + pose[:3, 3]
    faces = np.concatenate([[[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]] for i in range(4)])
    camera = Camera.from_matrix(k, pose, (140, 100), pixel_center=pixel_center, convention=convention)
    frame = rendered(Scene((Mesh(world, faces),), camera), shader="nolight", layers=("Z",), device=device)
    covered = np.argwhere(frame.alpha > 0)[:, ::-1]
    assert sorted(map(tuple, covered)) == sorted(map(tuple, pixels))
    # Z is constant on a quad; 10 roundings of 2^-24.
    assert np.abs(frame["Z"][pixels[:, 1], pixels[:, 0]] / depth - 1.0).max() <= 10 * 2.0**-24


def pose_at(eye, target) -> np.ndarray:
    """Return the OpenCV pose (4, 4) (x right, y down, z forward), camera to world, that looks at a target; world y is
    up."""
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


@pytest.mark.parametrize("convention", ["opencv", "opengl"])
@pytest.mark.parametrize("pixel_center", [0.5, 0])
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
    scene = Scene((Mesh(verts, faces),), camera)
    with Renderer(scene, shader="nolight", layers=("Z", "id"), device=device) as renderer:
        frame = renderer.render()
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
    error = np.abs(project(k, second, points) - project(k, second, true)).max()
    assert error < 1 / 12000
    # A depth error of 1/1000 is detected.
    wrong = first[:3, 3] + 1.001 * depth[rows, columns, None] * rays
    assert np.abs(project(k, second, wrong) - project(k, second, true)).max() > 10 / 256
