"""The intrinsic matrix K and the pose of a pinhole camera, as the lens and the axes of `camera.Camera`, and back.

The model is that of Hartley and Zisserman, Multiple View Geometry, section 6.1: a point (X, Y, Z) in the camera's frame,
x to the right, y down, z forward, is seen at column fx X/Z + cx and row fy Y/Z + cy.
"""

from __future__ import annotations

import math
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Array, Floats
from ..base.validation import choice, floats, value_error
from ..errors import InputError

Convention: TypeAlias = Literal["opencv", "opengl"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
K_FORM = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
POSE_FORM = "a finite (4, 4) or (3, 4) matrix, camera to world"
# What turns OpenCV's axes (x right, y down, z forward) into those of each convention: columns change their signs.
_SIGNS = {"opencv": np.array([1.0, 1.0, 1.0]), "opengl": np.array([1.0, -1.0, -1.0])}
_RIGID = 1e-6  # how far a pose may be from a rotation and a translation: some roundings of float32


def checked_center(who: str, value: Any) -> float:
    """Return the coordinate of the first pixel's center, 0.5 or 0. Raises InputError for anything else."""
    if not np.isscalar(value) or value not in (0, 0.5):
        raise value_error(who, "pixel_center", "0.5 or 0", value)
    return float(value)  # type: ignore[arg-type]


def lens_of(
    who: str, matrix: Any, resolution: tuple[int, int], pixel_center: float, name: str = "matrix"
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return `plane`, for focal 1, and `principal` of the camera with this K, see `Camera.from_matrix`.

    who, name: for errors. Raises InputError for another form of matrix.
    """
    k = floats(who, name, matrix, K_FORM).astype(np.float64)
    if k.shape != (3, 3) or not np.isfinite(k).all():
        raise value_error(who, name, K_FORM, k.tolist() if k.size <= 9 else k)
    if k[0, 1] != 0.0:
        raise InputError(f"{who}: {name}: expected {K_FORM}, found a skew of {k[0, 1]:g}, which this camera has not")
    if (k[[1, 2, 2], [0, 0, 1]] != 0.0).any() or k[2, 2] != 1.0:
        raise value_error(who, name, K_FORM, k.tolist())
    if min(k[0, 0], k[1, 1]) <= 0.0:
        raise value_error(who, name, "fx and fy above 0", k.tolist())
    columns, rows = resolution
    shift = 0.5 - checked_center(who, pixel_center)
    principal = (k[0, 2] + shift) / columns, 1.0 - (k[1, 2] + shift) / rows
    return (float(rows / k[1, 1]), float(columns / k[0, 0])), (float(principal[0]), float(principal[1]))


def matrix_of(
    focal: float,
    plane: tuple[float, float],
    principal: tuple[float, float],
    resolution: tuple[int, int],
    pixel_center: float,
) -> Floats:
    """Return K, (3, 3) float64, of a camera with these fields: `lens_of` the other way."""
    (height, width), (columns, rows) = plane, resolution
    shift = 0.5 - pixel_center
    return np.array(
        [
            [columns * (focal / width), 0.0, principal[0] * columns - shift],
            [0.0, rows * (focal / height), (1.0 - principal[1]) * rows - shift],
            [0.0, 0.0, 1.0],
        ]
    )


def placement_of(who: str, pose: Any, convention: str, name: str = "pose") -> tuple[Array, Array, Array]:
    """Return the eye, the viewing direction and the direction up, (3,) float64 each, of a pose, see `Camera.from_matrix`.

    who, name: for errors. Raises InputError for a matrix that is no rotation with a translation.
    """
    given = floats(who, name, pose, POSE_FORM).astype(np.float64)
    if given.shape not in ((4, 4), (3, 4)) or not np.isfinite(given).all():
        raise value_error(who, name, POSE_FORM, given.tolist() if given.size <= 16 else given)
    if len(given) == 4 and np.abs(given[3] - (0.0, 0.0, 0.0, 1.0)).max() > _RIGID:
        raise value_error(who, name, "a last row of 0, 0, 0, 1", given[3].tolist())
    choice(who, "convention", convention, CONVENTIONS)
    rotation, eye = given[:3, :3], given[:3, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = np.abs(rotation @ rotation.T - np.eye(3)).max() <= _RIGID
    if not rigid or np.linalg.det(rotation) < 0.0:
        expected = "a rotation without scale or reflection"
        raise InputError(f"{who}: {name}: expected {expected}, found {_described(rotation, rigid)}")
    right_down_forward = rotation * _SIGNS[convention]
    return eye, right_down_forward[:, 2], -right_down_forward[:, 1]


def _described(rotation: Array, rigid: bool) -> str:
    """Return what a matrix that is no rotation is instead."""
    if rigid:
        return "a reflection"
    rows = "; ".join(" ".join(f"{value:.6g}" for value in row) for row in rotation)
    scale = np.abs(rotation).max()
    singular = scale == 0.0 or np.linalg.matrix_rank(rotation / scale) < 3
    return f"{'a singular matrix' if singular else 'the matrix'} [{rows}]"


def pose_of(axes: Any, eye: Floats, convention: str) -> Floats:
    """Return the pose, (4, 4) float64, of a camera with these axes: `placement_of` the other way.

    axes: right, up and the viewing direction, as the rows of (3, 3).
    """
    pose = np.eye(4)
    pose[:3, :3] = np.transpose(axes) * (1.0, -1.0, 1.0) * _SIGNS[convention]
    pose[:3, 3] = eye
    return pose + 0.0  # no -0.0 in files


def axes_of(eye: list[float], lookat: list[float], up: list[float]) -> tuple[tuple[float, float, float], ...]:
    """Return right, up and the viewing direction, the rows of `geometry.camera_axes`, which says more. Raises InputError.

    In plain floats: for one camera NumPy's overhead would make it ten times as slow.
    """
    z = _unit(*(0.5 * b - 0.5 * a for a, b in zip(eye, lookat, strict=True)))
    if not any(z):
        raise value_error("look_at", "lookat", "a point other than eye", lookat)
    exponent = math.frexp(max(map(abs, up)))[1]
    u = [math.ldexp(value, -exponent) for value in up]
    along = (u[0] * z[0] + u[1] * z[1]) + u[2] * z[2]
    across = [a - along * b for a, b in zip(u, z, strict=True)]
    if max(map(abs, across)) <= 1e-12:
        raise value_error("look_at", "up", "a vector not parallel to lookat - eye", up)
    y = _unit(*across)
    x = (z[1] * y[2] - z[2] * y[1], z[2] * y[0] - z[0] * y[2], z[0] * y[1] - z[1] * y[0])
    return x, y, z


def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Normalize a vector of any finite length; the zero vector is kept."""
    exponent = math.frexp(max(abs(x), abs(y), abs(z)))[1]
    x, y, z = (math.ldexp(value, -exponent) for value in (x, y, z))
    length = math.sqrt(x * x + y * y + z * z) or 1.0
    return x / length, y / length, z / length
