"""The camera: a pose, a lens and a resolution; perspective or orthographic."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats
from ..base.validation import choice, flag, floats, integer, number, sequence, set_fields, value_error, vector

MAX_RESOLUTION = 16384  # pixels a side; kernels/edge.clh derives the integer ranges from it


def _pair(owner: str, name: str, expected: str, value: Any) -> tuple[Any, Any]:
    items = sequence(value)
    if items is None or len(items) != 2:
        raise value_error(owner, name, expected, value)
    return items[0], items[1]


def checked_resolution(owner: str, value: Any) -> tuple[int, int]:
    """Columns and rows of an image, (N, M), 1 to MAX_RESOLUTION each. Raises InputError for anything else."""
    columns, rows = _pair(owner, "resolution", "two whole numbers (N, M)", value)
    return (
        integer(owner, "resolution N", columns, 1, MAX_RESOLUTION),
        integer(owner, "resolution M", rows, 1, MAX_RESOLUTION),
    )


def height_seen(who: str, name: str, degrees: Any) -> float:
    """How high the image is at distance 1, of a vertical field of view. Raises InputError, which names `who` and `name`."""
    angle = number(who, name, degrees)
    if not 1e-6 <= angle < 180.0:
        raise value_error(who, name, "degrees from 1e-6 to less than 180", degrees)
    return 2.0 * math.tan(math.radians(angle) / 2.0)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera.

    eye, lookat, up: 3-vectors, world space. `up` must not be parallel to the viewing direction.
    focal: distance of the image plane from the eye, scene units (only focal/plane matters).
    plane: (H, W), height and width of the image plane, scene units.
    resolution: (N, M), columns and rows of the image, pixels.
    principal: where the viewing direction meets the image, as fractions of its width and height from the bottom left.
    orthographic: parallel projection; plane is then the size of what is seen, scene units, and focal has no meaning.
    """

    eye: Floats
    lookat: Floats
    up: Floats
    focal: float
    plane: tuple[float, float]
    resolution: tuple[int, int] = (800, 600)
    principal: tuple[float, float] = (0.5, 0.5)
    orthographic: bool = False

    if TYPE_CHECKING:  # what it may be given; the fields above say what is kept

        def __init__(
            self,
            eye: ArrayLike,
            lookat: ArrayLike,
            up: ArrayLike,
            focal: float,
            plane: tuple[float, float],
            resolution: tuple[int, int] = (800, 600),
            principal: tuple[float, float] = (0.5, 0.5),
            orthographic: bool = False,
        ) -> None: ...

    def __post_init__(self) -> None:
        who = "Camera"
        eye, lookat, up = (vector(who, name, getattr(self, name)) for name in ("eye", "lookat", "up"))
        with np.errstate(over="ignore"):
            forward = lookat - eye
        if not np.isfinite(forward).all() or not forward.any():
            raise value_error(who, "lookat", "a point other than eye", self.lookat)
        if not up.any():
            raise value_error(who, "up", "a vector other than zero", self.up)
        unit_forward, unit_up = (v / np.abs(v).max() for v in (forward, up))
        if np.linalg.norm(np.cross(unit_forward, unit_up)) <= 1e-12:
            raise value_error(who, "up", "a vector not parallel to lookat - eye", up.tolist())
        height, width = _pair(who, "plane", "two numbers (H, W)", self.plane)
        right, up_part = _pair(who, "principal", "two numbers", self.principal)
        set_fields(
            self,
            eye=eye,
            lookat=lookat,
            up=up,
            focal=number(who, "focal", self.focal, above=0.0),
            plane=(number(who, "plane H", height, above=0.0), number(who, "plane W", width, above=0.0)),
            resolution=checked_resolution(who, self.resolution),
            principal=(number(who, "principal u", right), number(who, "principal v", up_part)),
            orthographic=flag(who, "orthographic", self.orthographic),
        )

    @classmethod
    def from_fov(
        cls,
        eye: ArrayLike,
        lookat: ArrayLike,
        up: ArrayLike,
        fov: float,
        resolution: tuple[int, int] = (800, 600),
    ) -> Camera:
        """A camera with square pixels from its vertical field of view, in degrees, from 1e-6 to less than 180."""
        height = height_seen("Camera.from_fov", "fov", fov)
        columns, count_rows = checked_resolution("Camera.from_fov", resolution)
        return cls(eye, lookat, up, 1.0, (height, height * columns / count_rows), (columns, count_rows))

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        pose: ArrayLike,
        resolution: tuple[int, int],
        *,
        pixel_center: float = 0.5,
        convention: Literal["opencv", "opengl"] = "opencv",
    ) -> Camera:
        """A camera from its 3x3 matrix K and its pose.

        matrix: K, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, x to the right and y down from the image's top left.
        pose: (4, 4) camera to world, a rotation and a translation. convention: axes of the camera in `pose`, `opencv`
        (x right, y down, z forward) or `opengl` (x right, y up, z backward).
        pixel_center: 0.5 where K counts the first pixel's center as 0.5, 0 where it counts it as 0.
        """
        who = "Camera.from_matrix"
        form = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
        k = floats(who, "matrix", matrix, form).astype(np.float64)
        placement = floats(who, "pose", pose, "a finite (4, 4) matrix, camera to world").astype(np.float64)
        if (
            k.shape != (3, 3)
            or not np.isfinite(k).all()
            or (k[[0, 1, 2, 2], [1, 0, 0, 1]] != 0.0).any()
            or k[2, 2] != 1.0
        ):
            raise value_error(who, "matrix", form, k.tolist())
        if min(k[0, 0], k[1, 1]) <= 0.0:
            raise value_error(who, "matrix", "fx and fy above 0", k.tolist())
        if placement.shape != (4, 4) or not np.isfinite(placement).all():
            raise value_error(who, "pose", "a finite (4, 4) matrix, camera to world", pose)
        rotation, eye = placement[:3, :3], placement[:3, 3]
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0.0:
            raise value_error(who, "pose", "a rotation without scale or reflection", rotation.tolist())
        if pixel_center not in (0, 0.5):
            raise value_error(who, "pixel_center", "0.5 or 0", pixel_center)
        choice(who, "convention", convention, ("opencv", "opengl"))
        forward, up = (rotation[:, 2], -rotation[:, 1]) if convention == "opencv" else (-rotation[:, 2], rotation[:, 1])
        columns, count_rows = checked_resolution(who, resolution)
        shift = 0.5 - pixel_center
        principal = ((k[0, 2] + shift) / columns, 1.0 - (k[1, 2] + shift) / count_rows)
        plane = (count_rows / k[1, 1], columns / k[0, 0])
        return cls(eye, eye + forward, up, 1.0, plane, (columns, count_rows), principal)

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """The same view at another resolution (N, M): H of the plane is kept, W makes the pixels square."""
        columns, count_rows = checked_resolution("Camera", resolution)
        height = self.plane[0]
        return replace(self, plane=(height, height * columns / count_rows), resolution=(columns, count_rows))
