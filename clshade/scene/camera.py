"""The camera: a pose, a lens and a resolution; perspective or orthographic."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats
from ..base.validation import choice, flag, floats, integer, number, sequence, set_fields, value_error, vector
from ..errors import InputError
from . import pinhole
from .pinhole import axes_of

MAX_RESOLUTION = 16384  # pixels a side; kernels/edge.clh derives the integer ranges from it


def _pair(owner: str, name: str, expected: str, value: Any) -> tuple[Any, Any]:
    items = sequence(value)
    if items is None or len(items) != 2:
        raise value_error(owner, name, expected, value)
    return items[0], items[1]


def checked_resolution(owner: str, value: Any, most: int = MAX_RESOLUTION) -> tuple[int, int]:
    """Return columns and rows of an image, (N, M), 1 to `most` each. Raises InputError for anything else."""
    columns, rows = _pair(owner, "resolution", "two whole numbers (N, M)", value)
    return (integer(owner, "resolution N", columns, 1, most), integer(owner, "resolution M", rows, 1, most))


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
            raise value_error(who, "lookat", "a point other than eye", lookat.tolist())
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
        cls, eye: ArrayLike, lookat: ArrayLike, up: ArrayLike, fov: float, resolution: tuple[int, int] = (800, 600)
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
        convention: pinhole.Convention = "opencv",
    ) -> Camera:
        """Create a camera from a 3x3 intrinsic matrix and a pose.

        Parameters
        ----------
        matrix : array_like, (3, 3)
            K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels, x to the right and y down from the
            top left of the image; fx and fy above 0.
        pose : array_like, (4, 4) or (3, 4)
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
        size = checked_resolution(who, resolution)
        plane, principal = pinhole.lens_of(who, matrix, size, pixel_center)
        eye, forward, up = pinhole.placement_of(who, pose, convention)
        return cls(eye, eye + forward, up, 1.0, plane, size, principal)

    @classmethod
    def from_matrices(
        cls,
        matrices: ArrayLike,
        poses: ArrayLike,
        resolution: tuple[int, int],
        *,
        pixel_center: float = 0.5,
        convention: pinhole.Convention = "opencv",
    ) -> tuple[Camera, ...]:
        """Create cameras from intrinsic matrices and poses, one for each pose.

        Parameters
        ----------
        matrices : array_like, (3, 3) or (P, 3, 3)
            That of all cameras, or one for each.
        poses : array_like, (P, 4, 4) or (P, 3, 4)
            Camera to world.
        resolution, pixel_center, convention
            See `from_matrix`.

        Raises
        ------
        InputError
            The numbers of matrices and poses differ, or `from_matrix` refuses one, which is counted
            from 0.
        """
        who = "Camera.from_matrices"
        size = checked_resolution(who, resolution)
        given = floats(who, "poses", poses, "an array of shape (P, 4, 4) or (P, 3, 4)")
        lenses = floats(who, "matrices", matrices, "an array of shape (3, 3) or (P, 3, 3)")
        if given.ndim != 3:
            raise value_error(who, "poses", "an array of shape (P, 4, 4) or (P, 3, 4)", given)
        one = lenses.ndim < 3
        if not one and len(lenses) != len(given):
            raise InputError(f"{who}: matrices: expected one, or {len(given)} for as many poses, found {len(lenses)}")
        cameras = []
        for k, pose in enumerate(given):
            lens, name = (lenses, "matrices") if one else (lenses[k], f"matrices[{k}]")
            plane, principal = pinhole.lens_of(who, lens, size, pixel_center, name)
            eye, forward, up = pinhole.placement_of(who, pose, convention, f"poses[{k}]")
            cameras.append(cls(eye, eye + forward, up, 1.0, plane, size, principal))
        return tuple(cameras)

    def to_matrix(
        self, *, pixel_center: float = 0.5, convention: pinhole.Convention = "opencv"
    ) -> tuple[Floats, Floats]:
        """Return the 3x3 intrinsic matrix and the pose: `from_matrix` the other way.

        An orthographic camera, for which there is no K, is refused.

        Parameters
        ----------
        pixel_center, convention
            See `from_matrix`.

        Returns
        -------
        matrix : ndarray of float64, (3, 3)
            K, in pixels.
        pose : ndarray of float64, (4, 4)
            Camera to world.

        Examples
        --------
        >>> import clshade
        >>> camera = clshade.Camera.from_fov((0, 0, 4), (0, 0, 0), (0, 1, 0), 90, resolution=(640, 480))
        >>> matrix, pose = camera.to_matrix()
        >>> matrix.round(9).tolist()
        [[240.0, 0.0, 320.0], [0.0, 240.0, 240.0], [0.0, 0.0, 1.0]]
        """
        who = "Camera.to_matrix"
        center = pinhole.checked_center(who, pixel_center)
        pose = self.pose(convention)
        if self.orthographic:
            raise InputError(f"{who}: expected a perspective camera, found an orthographic one, which has no K")
        return pinhole.matrix_of(self.focal, self.plane, self.principal, self.resolution, center), pose

    def pose(self, convention: pinhole.Convention = "opencv") -> Floats:
        """Return the pose, camera to world, (4, 4) float64: a rotation and a translation.

        Parameters
        ----------
        convention : {"opencv", "opengl"}
            Axes of the camera, see `from_matrix`.
        """
        choice("Camera.pose", "convention", convention, pinhole.CONVENTIONS)
        axes = axes_of(self.eye.tolist(), self.lookat.tolist(), self.up.tolist())
        return pinhole.pose_of(axes, self.eye, convention)

    def stereo(self, baseline: float, convergence: float | None = None) -> tuple[Camera, Camera]:
        """Return a stereo pair around this camera: two of the same lens, half a baseline to its left and right.

        Their viewing directions are parallel, and rows of both images correspond. A point at the
        distance Z along the viewing direction is in the left image further right than in the right
        one, by its disparity: ``fx * baseline / Z`` pixels, where fx is ``to_matrix()[0][0, 0]``. An
        orthographic camera, whose images would not differ by depth, is refused.

        Parameters
        ----------
        baseline : float
            Distance of the two eyes, scene units, above 0.
        convergence : float, optional
            Distance along the viewing direction at which the disparity is 0, scene units, above 0:
            the principal points are shifted, an off-axis projection, without turning the cameras, and
            ``fx * baseline / convergence`` pixels are subtracted from every disparity. Default: at
            infinity.
        """
        who = "Camera.stereo"
        half = number(who, "baseline", baseline, above=0.0) / 2.0
        if self.orthographic:
            raise InputError(f"{who}: expected a perspective camera, found an orthographic one, which has no disparity")
        shift = 0.0
        if convergence is not None:
            shift = half * (self.focal / self.plane[1]) / number(who, "convergence", convergence, above=0.0)
        right = np.array(axes_of(self.eye.tolist(), self.lookat.tolist(), self.up.tolist())[0])
        u, v = self.principal
        left_eye, right_eye = (
            replace(self, eye=self.eye + side * right, lookat=self.lookat + side * right, principal=principal)
            for side, principal in ((-half, (u - shift, v)), (half, (u + shift, v)))
        )
        return left_eye, right_eye

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """Return the same view at another resolution.

        The height of the image plane is kept; its width is set so that pixels are square.

        Parameters
        ----------
        resolution : (int, int)
            (N, M), columns and rows of the image, 1 to 16384 pixels each.
        """
        columns, count_rows = checked_resolution("Camera", resolution)
        height = self.plane[0]
        return replace(self, plane=(height, height * columns / count_rows), resolution=(columns, count_rows))
