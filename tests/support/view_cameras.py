"""Cameras of all kinds, and points around their focal points."""

import numpy as np

from clshade.scene.camera import Camera
from clshade.scene.model import Mesh, Scene


def cameras() -> list[Camera]:
    """Return cameras with odd view directions, non-square pixels, a distant and a huge scene, an off-center image, and
    an orthographic projection."""
    return [
        Camera((0.3, -0.7, 4.1), (0.1, 0.2, -0.3), (0.1, 1.0, 0.2), 1.3, (1.1, 1.7), (333, 217)),
        Camera((1e6, 1e6, 1e6 + 4), (1e6, 1e6, 1e6), (0.0, 1.0, 0.0), 70.0, (15.0, 15.0), (512, 512)),
        Camera((2e20, -1e20, 3e20), (1e19, 0.0, 0.0), (0.0, 0.0, 1.0), 0.5, (2.0, 3.0), (16384, 1)),
        Camera((0.3, -0.7, 4.1), (0.1, 0.2, -0.3), (0.1, 1.0, 0.2), 1.3, (1.1, 1.7), (333, 217), (0.3, -0.9)),
        Camera((0.3, -0.7, 4.1), (0.1, 0.2, -0.3), (0.1, 1.0, 0.2), 1.0, (2, 3), (333, 217), (0.4, 0.6), True),
    ]


CAMERAS = ["near", "offset", "huge", "principal", "orthographic"]


def looking(back: float, size: int = 48) -> Camera:
    """Return a camera on the axis, a step back from the origin, whose image is one unit wide at a distance of 1."""
    pose = np.eye(4)
    pose[2, 3] = back
    return Camera.from_matrix(np.array([[size, 0, size / 2], [0, size, size / 2], [0, 0, 1.0]]), pose, (size, size))


def cloud(count: int = 1000, size: int = 48) -> Scene:
    """Return a scene of small triangles, seen from before them."""
    rng = np.random.default_rng(0)
    verts = rng.uniform(-1, 1, (count, 1, 3)) + 0.05 * rng.normal(size=(count, 3, 3))
    return Scene((Mesh(verts.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)),), looking(-4.0, size))


def around(camera: Camera, count: int = 4000, dtype=np.float64) -> np.ndarray:
    """Return points in front of, beside and behind the eye."""
    rng = np.random.default_rng(1)
    distance = np.linalg.norm(camera.lookat - camera.eye)
    points = camera.lookat + distance * np.exp2(rng.uniform(-6.0, 3.0, (count, 1))) * rng.normal(size=(count, 3))
    return np.ascontiguousarray(points, dtype)
