"""Cameras as K and pose, and stereo pairs: they round-trip, and points project where OpenCV and the closed form say."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_matrices

SIZE = (640, 480)
K = np.array([[612.5, 0.0, 301.25], [0.0, 598.75, 260.5], [0.0, 0.0, 1.0]])
FLIP = {"opencv": np.diag([1.0, 1.0, 1.0]), "opengl": np.diag([1.0, -1.0, -1.0])}
EVERY = [(convention, center) for convention in FLIP for center in (0.5, 0.0)]


def rigid(seed: int, offset: float = 3.0) -> np.ndarray:
    """Return a random rotation and a translation (4, 4)."""
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = rotation * np.linalg.det(rotation)
    pose[:3, 3] = rng.uniform(-offset, offset, 3)
    return pose


def seen(pose: np.ndarray, convention: str = "opencv") -> np.ndarray:
    """Return 100 points in front of an OpenCV or OpenGL pose, world space."""
    rng = np.random.default_rng(5)
    points = rng.uniform((-3, -2, 2), (3, 2, 20), (100, 3))
    return points @ (pose[:3, :3] @ FLIP[convention]).T + pose[:3, 3]


def projected(matrix: np.ndarray, pose: np.ndarray, points: np.ndarray, convention: str = "opencv") -> np.ndarray:
    """Return columns and rows (P, 2) by the textbook's formula."""
    local = (points - pose[:3, 3]) @ (pose[:3, :3] @ FLIP[convention])
    return (local / local[:, 2:]) @ matrix[:2].T


def drawn_at(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return columns and rows (P, 2) of points where the camera draws them, the first pixel's center at 0.5."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ camera_matrices(camera)[1]
    return homogeneous[:, :2] / homogeneous[:, 3:] * camera.resolution


@pytest.mark.parametrize(("convention", "center"), EVERY)
def test_a_matrix_and_a_pose_come_back(convention, center):
    for seed in range(5):
        pose = rigid(seed)
        camera = Camera.from_matrix(K, pose, SIZE, pixel_center=center, convention=convention)
        matrix, back = camera.to_matrix(pixel_center=center, convention=convention)
        # A few roundings of the largest entries, 1000 and 10.
        np.testing.assert_allclose(matrix, K, rtol=0, atol=1e-12)
        np.testing.assert_allclose(back, pose, rtol=0, atol=1e-14)
        points = seen(pose, convention)
        where = drawn_at(camera, points) - (0.5 - center)
        assert np.abs(projected(matrix, back, points, convention) - where).max() < 1e-9


@pytest.mark.parametrize("center", [0.5, 0.0])
def test_opencv_projects_points_where_they_are_drawn(center):
    """Far from the origin too, as in geographic coordinates: 16 roundings of 1e6 in float64, times fx/z < 500 px, are less
    than 1e-6 px."""
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed")
    for seed, offset in ((1, 3.0), (2, 1e6)):
        pose = rigid(seed, offset)
        camera = Camera.from_matrix(K, pose, SIZE, pixel_center=center)
        matrix, back = camera.to_matrix(pixel_center=center)
        points = seen(pose)
        to_camera = np.linalg.inv(back)
        # OpenCV adds R p and t, which cancel far away; it is given points relative to the eye.
        turn, _ = cv2.Rodrigues(to_camera[:3, :3])
        pixels, _ = cv2.projectPoints(points - back[:3, 3], turn, np.zeros(3), matrix, None)
        assert np.abs(pixels[:, 0] - projected(K, pose, points)).max() < 1e-6
        assert np.abs(pixels[:, 0] - (drawn_at(camera, points) - (0.5 - center))).max() < 1e-6


def test_cameras_of_many_matrices():
    poses = np.stack([rigid(seed) for seed in range(3)])
    shared = Camera.from_matrices(K, poses[:, :3], SIZE)
    separate = Camera.from_matrices([K, 2 * K / [[1], [1], [2]], K], poses.tolist(), SIZE, convention="opengl")
    assert [len(cameras) for cameras in (shared, separate)] == [3, 3]
    for k, pose in enumerate(poses):
        np.testing.assert_allclose(shared[k].to_matrix()[1], pose, rtol=0, atol=1e-14)
        np.testing.assert_allclose(separate[k].pose("opengl"), pose, rtol=0, atol=1e-14)
    assert separate[1].to_matrix()[0][0, 0] == pytest.approx(2 * K[0, 0], rel=1e-15)
    assert Camera.from_matrices(K, np.empty((0, 4, 4)), SIZE) == ()


@pytest.mark.parametrize("convergence", [None, 6.0])
def test_the_disparity_of_a_pair(convergence):
    """f b (1/Z - 1/convergence) along rows, and nothing along columns."""
    pose, baseline = rigid(3), 0.12
    camera = Camera.from_matrix(K, pose, SIZE)
    left, right = camera.stereo(baseline, convergence)
    points = seen(pose)
    depth = ((points - pose[:3, 3]) @ pose[:3, :3])[:, 2]
    apart = drawn_at(left, points) - drawn_at(right, points)
    expected = K[0, 0] * baseline * (1 / depth - (0 if convergence is None else 1 / convergence))
    assert np.abs(apart[:, 0] - expected).max() < 1e-9
    assert np.abs(apart[:, 1]).max() < 1e-9
    np.testing.assert_allclose((left.eye + right.eye) / 2, camera.eye, rtol=0, atol=1e-14)
    np.testing.assert_allclose(right.eye - left.eye, baseline * pose[:3, 0], rtol=0, atol=1e-14)
    (matrix, _), (right_matrix, _) = left.to_matrix(), right.to_matrix()
    middle = (matrix + right_matrix) / 2
    np.testing.assert_allclose(middle, K, rtol=0, atol=1e-10)
    assert (abs(right_matrix[0, 2] - matrix[0, 2]) > 1) == (convergence is not None)
