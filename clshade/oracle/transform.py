"""From world space to the image: camera frame, projection, snapping, depth. All float64, no fused operations.

Image coordinates (u, v) are in pixels with (0, 0) at the bottom-left corner; snapped ones are whole 1/65536 pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers, Reals
from ..scene.camera import Camera
from .vectors import cross, dot, length, power_of_two, unit

SUBPIXELS = 1 << 16  # snapped steps per pixel
SAMPLE_STEPS = 256  # samples lie at multiples of 1/256 pixel
NEAR_FRACTION = 1e-4  # of the scene's bounding radius


def camera_frame(eye: Floats, lookat: Floats, up: Floats) -> Floats:
    """Return the camera's axes as rows x (right), y (up), z (forward) of a (3, 3) array, from three (3,) world vectors."""
    z = unit(np.asarray(lookat, np.float64) - np.asarray(eye, np.float64))
    up = np.asarray(up, np.float64)
    up = up / power_of_two(up)
    y = unit(up - dot(up, z) * z)
    return np.stack([cross(z, y), y, z])


def world_vertices(verts: Reals, matrix: Floats) -> Floats:
    """Transform positions (V, 3) by placements (..., 4, 4): (..., V, 3); an identity leaves them as they are."""
    points = np.asarray(verts, dtype=np.float64)
    rows = matrix[..., None, :, :]
    placed = np.stack([dot(points, rows[..., k, :3]) + rows[..., k, 3] for k in range(3)], axis=-1)
    return np.where(is_identity(matrix)[..., None, None], points, placed)


def is_identity(matrix: Floats) -> Bools:
    """Return which placements (..., 4, 4) are identities."""
    same: Bools = (matrix == np.eye(4)).all(axis=(-2, -1))
    return same


def mirroring(matrices: Floats) -> Bools:
    """Return which placements (..., 4, 4) mirror: by float64 where its rounding, less than 2^-49 of the sum of sizes, leaves
    no doubt of the determinant's sign."""
    every = matrices.reshape(-1, 4, 4)[:, :3, :3]
    a, b, c = np.moveaxis(every / power_of_two(np.abs(every).max(axis=1))[:, None, None], 1, 0)
    found = dot(a, cross(b, c)) < 0.0
    after, before = b[:, [1, 2, 0]] * c[:, [2, 0, 1]], b[:, [2, 0, 1]] * c[:, [1, 2, 0]]
    sizes = dot(np.abs(a), np.abs(after) + np.abs(before))
    for k in np.flatnonzero(np.abs(dot(a, cross(b, c))) <= 2.0**-45 * sizes + 1e-300):
        found[k] = mirrors(matrices.reshape(-1, 4, 4)[k])
    return found.reshape(matrices.shape[:-2])


def mirrors(matrix: Floats) -> bool:
    """Return whether a placement (4, 4) mirrors: whether its determinant is negative. Computed in integers, times the
    largest denominator: for a placement that flattens, rounding would leave a random sign."""
    ratios = [float(value).as_integer_ratio() for value in matrix[:3, :3].ravel()]
    largest = max(denominator for _, denominator in ratios)  # all are powers of two
    a, b, c, d, e, f, g, h, i = (numerator * (largest // denominator) for numerator, denominator in ratios)
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0


def to_camera(points: Floats, eye: Floats, axes: Floats) -> Floats:
    """Transform world points (..., 3) to camera coordinates: x to the right, y up, z = depth."""
    d = np.asarray(points, dtype=np.float64) - eye
    return np.stack([dot(d, axis) for axis in axes], axis=-1)


class Lens(NamedTuple):
    """The mapping from camera space to the image; the fields of camera.Camera, which are the arguments of `project`."""

    focal: float
    plane: tuple[float, float]
    resolution: tuple[int, int]
    principal: tuple[float, float] = (0.5, 0.5)
    orthographic: bool = False


def lens_of(camera: Camera) -> Lens:
    return Lens(camera.focal, camera.plane, camera.resolution, camera.principal, camera.orthographic)


def project(
    points: Floats,
    focal: float,
    plane: tuple[float, float],
    resolution: tuple[int, int],
    principal: tuple[float, float] = (0.5, 0.5),
    orthographic: bool = False,
) -> Floats:
    """Project camera-space points (..., 3), z > 0, to continuous image coordinates (..., 2), in pixels.

    plane: (H, W) of the image plane. resolution: (N, M), columns and rows. principal: where the viewing direction
    meets the image, fractions of N and M. orthographic: parallel projection.
    """
    (height, width), (columns, rows) = plane, resolution
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    if orthographic:
        return np.stack([(x / width + principal[0]) * columns, (y / height + principal[1]) * rows], axis=-1)
    u = ((focal * x) / (z * width) + principal[0]) * columns
    v = ((focal * y) / (z * height) + principal[1]) * rows
    return np.stack([u, v], axis=-1)


def snap(uv: Floats) -> Integers:
    """Round image coordinates to whole 1/65536 pixels, int64: the nearest, halves to even."""
    return np.rint(uv * SUBPIXELS).astype(np.int64)


def painter_depth(z: Floats) -> Floats:
    """Return the mean depth of triangles with corner depths z (..., 3)."""
    return ((z[..., 0] + z[..., 1]) + z[..., 2]) / 3.0


def near_distance(points: Floats, eye: Floats, lookat: Floats, near: float | None = None) -> float:
    """Return the distance of the near plane: `near`, or a fraction of the bounding radius of the points (K, 3) that
    faces use.

    A scene of one point, or none, has radius 0: the distance from eye to lookat replaces it.
    """
    if near is not None:
        return near
    radius = 0.0
    if len(points):
        radius = float(0.5 * length(np.array([np.ptp(points[:, axis]) for axis in range(3)])))
    return NEAR_FRACTION * (radius or float(length(np.asarray(lookat) - np.asarray(eye))))
