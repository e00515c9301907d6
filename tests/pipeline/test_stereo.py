"""Depths lead to points: under cameras from a matrix K and a pose, and as the disparities of stereo pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered

from clshade.cli.main import main
from clshade.images import exr
from clshade.pipeline.renderer import Renderer, render
from clshade.scene.builtin.scenes import builtin
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


FOCAL, BASELINE, CONVERGENCE = 240.0, 0.5, 8.0
K = np.array([[FOCAL, 0.0, 81.3], [0.0, 220.0, 60.2], [0.0, 0.0, 1.0]])
POSE = np.array([[0.6, 0.0, -0.8, 1.0], [0.0, 1.0, 0.0, -2.0], [0.8, 0.0, 0.6, 3.0], [0.0, 0.0, 0.0, 1.0]])
SIZE = (160, 120)


def drawn(scene: Scene, camera: Camera, device) -> list[np.ndarray]:
    """Return Z, float64, and id of the left and of the right image."""
    pair = camera.stereo(BASELINE, CONVERGENCE)
    with Renderer(scene, shader="nolight", layers=("Z", "id"), device=device) as renderer:
        frames = [renderer.render(eye) for eye in pair]
        return [layer for frame in frames for layer in (frame["Z"].astype(np.float64), frame["id"].astype(int))]


def placed(local: np.ndarray) -> np.ndarray:
    """Return points of an OpenCV camera's frame in world space."""
    return local @ POSE[:3, :3].T + POSE[:3, 3]


def disparity(depth: np.ndarray) -> np.ndarray:
    return FOCAL * BASELINE * (1 / depth - 1 / CONVERGENCE)


def test_whole_disparities_shift_the_image(device):
    """Bars at depths whose disparities are whole numbers: the right image is the left one, shifted row by row."""
    depths, corners = np.array([2.0, 3.0, 4.0, 6.0, 10.0, 12.0]), []
    for k, depth in enumerate(depths):
        top, left = 8.37 + 18 * k, 51.21 + 3 * k
        pixels = np.array([[left, top], [left + 57.4, top], [left + 57.4, top + 13.3], [left, top + 13.3]])
        corners.append(np.column_stack([(pixels - K[:2, 2]) / [FOCAL, 220.0] * depth, np.full(4, depth)]))
    faces = np.concatenate([[[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]] for i in range(len(depths))])
    camera = Camera.from_matrix(K, POSE, SIZE)
    scene = Scene((Mesh(placed(np.concatenate(corners)), faces),), camera)
    left, left_id, right, right_id = drawn(scene, camera, device)
    for k, depth in enumerate(depths):
        band = slice(round(8 + 18 * k), round(24 + 18 * k))
        shift = round(disparity(depth))
        assert disparity(depth) == pytest.approx(shift, abs=1e-12)
        moved = np.roll(left[band], -shift, axis=1)
        moved_id = np.roll(left_id[band], -shift, axis=1)
        assert (moved_id > 0).sum() > 600
        assert np.array_equal((moved_id + 1) // 2, (right_id[band] + 1) // 2)
        seen = moved_id > 0
        # Z is constant on a bar; 10 roundings of 2^-24.
        assert np.abs(moved[seen] / depth - 1).max() <= 10 * 2.0**-24
        assert np.abs(right[band][seen] / depth - 1).max() <= 10 * 2.0**-24


def test_a_pixel_of_the_left_image_is_found_in_the_right_one(device):
    """Of a slanted plane 1/Z is linear in the image, so between two pixels of the right one it is interpolated exactly; at
    where the left depth says, its own depth says the same disparity, within 1/12000 px: vertices are snapped by up to
    1/131072 px along either axis in each image, where disparities change by less than 1/4 px a pixel, and each 1/Z has up
    to 10 roundings of 2^-24, of 46 px of disparity."""
    local = np.array([[-1.1, -0.9, 2.6], [1.3, -1.0, 4.1], [1.2, 1.1, 4.9], [-1.0, 0.8, 3.2]])
    local[3, 2] = (
        local[0, 2]
        + np.linalg.solve(  # on the plane of the others
            np.column_stack([local[1, :2] - local[0, :2], local[2, :2] - local[0, :2]]), local[3, :2] - local[0, :2]
        )
        @ (local[1:3, 2] - local[0, 2])
    )
    camera = Camera.from_matrix(K, POSE, SIZE)
    scene = Scene((Mesh(placed(local), [[0, 1, 2], [0, 2, 3]]),), camera)
    left, left_id, right, right_id = drawn(scene, camera, device)
    rows, columns = np.nonzero(left_id)
    there = columns - disparity(left[rows, columns])
    first = np.floor(there).astype(int)
    inside = (first >= 0) & (first < SIZE[0] - 1)
    rows, columns, there, first = rows[inside], columns[inside], there[inside], first[inside]
    both = (right_id[rows, first] > 0) & (right_id[rows, first + 1] > 0)
    assert both.sum() > 4000
    rows, columns, there, first = rows[both], columns[both], there[both], first[both]
    part = there - first
    inverse = (1 - part) / right[rows, first] + part / right[rows, first + 1]
    error = np.abs(disparity(1 / inverse) - (columns - there))
    assert np.ptp(there - columns) > 10
    assert error.max() < 1 / 12000


@pytest.mark.parametrize("convergence", [None, 5.0])
def test_pairs_of_a_command_are_those_of_python(device, tmp_path, convergence):
    """Also at another resolution than the scene's, at which principal points are fractions of another width."""
    options = () if convergence is None else ("--convergence", str(convergence))
    small = ("--resolution", "40,24", "--preset", "course", "--layers", "Z,id", "--deterministic", "--quiet")
    assert main(["render", "quads", *small, "--stereo", "0.25", *options, "-o", str(tmp_path / "a")]) == 0
    scene = builtin("quads")
    pair = scene.camera.with_resolution((40, 24)).stereo(0.25, convergence)
    for eye, name in zip(pair, ("left", "right"), strict=True):
        frame = render(replace(scene, camera=eye), preset="course", layers=("Z", "id"), device=device)
        assert np.array_equal(exr.read(tmp_path / f"a.{name}.exr")[0]["Z"], frame["Z"])
