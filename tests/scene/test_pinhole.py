"""Cameras as K and pose, and stereo pairs: they round-trip, and points project where OpenCV and the closed form say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
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
        again = Camera.from_matrix(matrix, back[:3], SIZE, pixel_center=center, convention=convention)
        points = seen(pose, convention)
        error = np.abs(drawn_at(again, points) - drawn_at(camera, points)).max()
        assert error < 1e-9
        where = drawn_at(camera, points) - (0.5 - center)
        assert np.abs(projected(matrix, back, points, convention) - where).max() < 1e-9


def test_a_camera_comes_back():
    """Of another focal length, off center, with pixels that are not square; only what is looked at may be nearer."""
    camera = Camera((1, -2, 9), (0.5, 0.25, -1), (0.1, 1, 0.2), 2.5, (1.5, 2.5), SIZE, (0.4, 0.55))
    again = Camera.from_matrix(*camera.to_matrix(), SIZE)
    points = seen(camera.pose())
    assert np.abs(drawn_at(again, points) - drawn_at(camera, points)).max() < 1e-9
    assert np.array_equal(again.eye, camera.eye)


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


SCALED = np.diag([2.0, 2.0, 2.0, 1.0])
SINGULAR = np.diag([1.0, 1.0, 0.0, 1.0])
REFUSED = {
    "skew": ((K + [[0, 0.5, 0], [0, 0, 0], [0, 0, 0]], np.eye(4)), ("matrix", "found a skew of 0.5")),
    "NaN in K": ((K * np.nan, np.eye(4)), ("matrix", "[[fx, 0, cx]", "nan")),
    "K of two rows": ((K[:2], np.eye(4)), ("matrix", "[[fx, 0, cx]")),
    "negative fx": ((K * [[-1], [1], [1]], np.eye(4)), ("matrix", "fx and fy above 0")),
    "scaled K": ((2 * K, np.eye(4)), ("matrix", "[[fx, 0, cx]")),
    "NaN in pose": ((K, np.eye(4) * np.nan), ("pose", "finite", "nan")),
    "scale": ((K, SCALED), ("pose", "without scale or reflection", "[2 0 0; 0 2 0; 0 0 2]")),
    "singular": ((K, SINGULAR), ("pose", "found a singular matrix [1 0 0; 0 1 0; 0 0 0]")),
    "zero": ((K, np.diag([0.0, 0, 0, 1])), ("pose", "found a singular matrix")),
    "huge": ((K, np.diag([1e200, 1e200, 1e200, 1])), ("pose", "found the matrix [1e+200")),
    "reflection": ((K, np.diag([-1.0, 1, 1, 1])), ("pose", "found a reflection")),
    "transposed": ((K, rigid(1).T), ("pose", "a last row of 0, 0, 0, 1")),
    "pose of two rows": ((K, np.eye(4)[:2]), ("pose", "(4, 4) or (3, 4)")),
}


@pytest.mark.parametrize(("arguments", "parts"), REFUSED.values(), ids=list(REFUSED))
def test_refused_matrices_and_poses(arguments, parts):
    with pytest.raises(InputError) as caught:
        Camera.from_matrix(*arguments, SIZE)
    message = str(caught.value)
    assert message.startswith("Camera.from_matrix: ")
    assert "\n" not in message
    assert all(part in message for part in parts), message


def test_a_refused_one_of_many_is_counted():
    poses = [np.eye(4), SINGULAR]
    with pytest.raises(InputError, match=r"^Camera\.from_matrices: poses\[1\]: .* found a singular matrix"):
        Camera.from_matrices(K, poses, SIZE)
    with pytest.raises(InputError, match=r"^Camera\.from_matrices: matrices\[1\]: .* found a skew of 1"):
        Camera.from_matrices([K, K + np.eye(3)[[2, 0, 1]].T * [[1], [0], [0]]], [np.eye(4)] * 2, SIZE)
    with pytest.raises(InputError, match=r"matrices: expected one, or 2 for as many poses, found 3$"):
        Camera.from_matrices([K] * 3, [np.eye(4)] * 2, SIZE)
    with pytest.raises(InputError, match=r"poses: expected an array of shape \(P, 4, 4\)"):
        Camera.from_matrices(K, np.eye(4), SIZE)
    with pytest.raises(InputError, match="poses: expected an array"):
        Camera.from_matrices(K, [np.eye(4), np.eye(3)], SIZE)


def test_what_has_no_matrix():
    flat = replace(Camera.from_matrix(K, np.eye(4), SIZE), orthographic=True)
    with pytest.raises(InputError, match=r"^Camera\.to_matrix: expected a perspective camera, found an orthographic"):
        flat.to_matrix()
    assert np.array_equal(flat.pose(), np.eye(4))
    with pytest.raises(InputError, match=r"^Camera\.pose: convention: .*did you mean 'opengl'"):
        flat.pose("OpenGL")
    with pytest.raises(InputError, match=r"^Camera\.to_matrix: pixel_center: expected 0\.5 or 0, found 1"):
        Camera.from_matrix(K, np.eye(4), SIZE).to_matrix(pixel_center=1)


# Stereo pairs


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


@pytest.mark.parametrize(
    ("arguments", "name"), [((0,), "baseline"), ((float("nan"),), "baseline"), ((1, 0), "convergence")]
)
def test_refused_pairs(arguments, name):
    camera = Camera.from_matrix(K, np.eye(4), SIZE)
    with pytest.raises(InputError, match=rf"^Camera\.stereo: {name}: expected a finite number above 0"):
        camera.stereo(*arguments)
    with pytest.raises(InputError, match=r"^Camera\.stereo: expected a perspective camera"):
        replace(camera, orthographic=True).stereo(1)
