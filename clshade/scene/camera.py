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
    """Return columns and rows of an image, (N, M), 1 to MAX_RESOLUTION each. Raises InputError for anything else."""
    columns, rows = _pair(owner, "resolution", "two whole numbers (N, M)", value)
    return (
        integer(owner, "resolution N", columns, 1, MAX_RESOLUTION),
        integer(owner, "resolution M", rows, 1, MAX_RESOLUTION),
    )


def height_seen(who: str, name: str, degrees: Any) -> float:
    """Return the height of the image at distance 1 for a vertical field of view in degrees.

    Raises InputError, naming `who` and `name`, unless it is from 1e-6 to less than 180.
    """
    angle = number(who, name, degrees)
    if not 1e-6 <= angle < 180.0:
        raise value_error(who, name, "degrees from 1e-6 to less than 180", degrees)
    return 2.0 * math.tan(math.radians(angle) / 2.0)


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: a pose, a lens and a resolution.

    Attributes
    ----------
    eye : array_like, (3,)
        Center of projection, world space.
    lookat : array_like, (3,)
        Point other than the eye, world space; the viewing direction is lookat - eye.
    up : array_like, (3,)
        Direction that points up in the image, world space; not parallel to the viewing direction.
    focal : float
        Distance of the image plane from the eye, scene units, above 0. Only focal/plane matters.
    plane : (float, float)
        (H, W), height and width of the image plane, scene units, above 0.
    resolution : (int, int), default (800, 600)
        (N, M), columns and rows of the image, 1 to 16384 pixels each.
    principal : (float, float), default (0.5, 0.5)
        Where the viewing direction meets the image, as fractions of its width and height from the
        bottom left.
    orthographic : bool, default False
        Use a parallel projection; `plane` is then the size of the view, and `focal` has no effect.

    Raises
    ------
    InputError
        A value is out of its range; the message names the field.

    Notes
    -----
    Vectors are kept as read-only (3,) float64 arrays.

    Examples
    --------
    >>> import clshade
    >>> camera = clshade.Camera.from_fov((0, 0, 4), lookat=(0, 0, 0), up=(0, 1, 0), fov=35)
    >>> camera.with_resolution((1920, 1080)).resolution
    (1920, 1080)
    """

    eye: Floats
    lookat: Floats
    up: Floats
    focal: float
    plane: tuple[float, float]
    resolution: tuple[int, int] = (800, 600)
    principal: tuple[float, float] = (0.5, 0.5)
    orthographic: bool = False

    if TYPE_CHECKING:  # the accepted types; the fields above have those that are kept

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
        """Create a camera with square pixels from a vertical field of view.

        Parameters
        ----------
        eye, lookat, up : array_like, (3,)
            Pose, world space, see `Camera`.
        fov : float
            Vertical field of view, degrees, from 1e-6 to less than 180.
        resolution : (int, int), default (800, 600)
            (N, M), columns and rows of the image, 1 to 16384 pixels each.

        Returns
        -------
        Camera
            With focal 1 and the principal point in the middle of the image.

        Raises
        ------
        InputError
            An argument is out of its range.
        """
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
        """Create a camera from a 3x3 intrinsic matrix and a pose.

        Parameters
        ----------
        matrix : array_like, (3, 3)
            K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, x to the right and y down from the
            top left of the image; fx and fy above 0.
        pose : array_like, (4, 4)
            Camera to world: a rotation and a translation.
        resolution : (int, int)
            (N, M), columns and rows of the image, 1 to 16384 pixels each.
        pixel_center : {0.5, 0}
            Coordinate of the first pixel's center in the convention of K.
        convention : {"opencv", "opengl"}
            Axes of the camera in `pose`: `opencv` (x right, y down, z forward) or `opengl` (x
            right, y up, z backward).

        Returns
        -------
        Camera
            With focal 1.

        Raises
        ------
        InputError
            The matrix has another form, the pose has a scale or reflection (beyond 1e-6), or
            another argument is out of its range.
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
        """Return the same view at another resolution.

        The height of the image plane is kept; its width is set so that pixels are square.

        Parameters
        ----------
        resolution : (int, int)
            (N, M), columns and rows of the image, 1 to 16384 pixels each.

        Returns
        -------
        Camera

        Raises
        ------
        InputError
            The resolution is out of its range.
        """
        columns, count_rows = checked_resolution("Camera", resolution)
        height = self.plane[0]
        return replace(self, plane=(height, height * columns / count_rows), resolution=(columns, count_rows))
