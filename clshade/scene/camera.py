"""The camera: a pose, a lens and a resolution, perspective or orthographic; from and to an intrinsic matrix K and a pose.

K is that of Hartley and Zisserman, Multiple View Geometry, section 6.1: a point (X, Y, Z) in the camera's frame, x to the
right, y down, z forward, is seen at column fx X/Z + cx and row fy Y/Z + cy.

A camera of a part of an image shows that part with the bits of the whole. Its lens alone would not do: positions computed
from it are rounded otherwise, now and then to another 1/65536 px.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Floats, Vector
from ..base.declare import check_fields, checked, record, required
from ..base.validation import choice, flag, floats, integer, items, number, value_error, vector
from ..errors import InputError

MAX_RESOLUTION = 16384  # pixels a side; kernels/edge.clh derives the integer ranges from it
MAX_WHOLE = 1 << 17  # pixels a side of an image drawn in parts: float32 holds positions from its center in 1/256 px
Convention: TypeAlias = Literal["opencv", "opengl"]
CONVENTIONS: tuple[Convention, ...] = get_args(Convention)
_K_FORM = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
_POSE_FORM = "a finite (4, 4) or (3, 4) matrix, camera to world"
# The signs of the columns that turn OpenCV's axes (x right, y down, z forward) into those of a convention.
_SIGNS = {"opencv": np.array([1.0, 1.0, 1.0]), "opengl": np.array([1.0, -1.0, -1.0])}
_RIGID = 1e-6  # how far a pose may be from a rotation and a translation: some roundings of float32


def checked_resolution(owner: str, value: Any, limit: int = MAX_RESOLUTION) -> tuple[int, int]:
    """Return columns and rows of an image, (N, M), 1 to `limit` each. Raises InputError for anything else."""
    columns, rows = items(owner, "resolution", value, "two whole numbers (N, M)", 2)
    return (integer(owner, "resolution N", columns, 1, limit), integer(owner, "resolution M", rows, 1, limit))


def _plane(owner: str, name: str, value: Any) -> tuple[float, float]:
    height, width = items(owner, name, value, "two numbers (H, W)", 2)
    return number(owner, "plane H", height, above=0.0), number(owner, "plane W", width, above=0.0)


def _principal(owner: str, name: str, value: Any) -> tuple[float, float]:
    u, v = items(owner, name, value, "two numbers", 2)
    return number(owner, "principal u", u), number(owner, "principal v", v)


def height_seen(who: str, name: str, degrees: Any) -> float:
    """Return the height of the image at distance 1 for a vertical field of view. Raises InputError, naming `who` and `name`,
    unless it is from 1e-6 to less than 180 degrees."""
    limits = {"least": 1e-6, "most": math.nextafter(180.0, 0.0)}
    angle = number(who, name, degrees, **limits, expected="degrees from 1e-6 to less than 180")
    return 2.0 * math.tan(math.radians(angle) / 2.0)


@record
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

    eye: Vector = required(check=vector)
    lookat: Vector = required(check=vector)
    up: Vector = required(check=vector)
    focal: float = required(check=partial(number, above=0.0))
    plane: tuple[float, float] = required(check=_plane)
    resolution: tuple[int, int] = checked((800, 600), lambda owner, _name, value: checked_resolution(owner, value))
    principal: tuple[float, float] = checked((0.5, 0.5), _principal)
    orthographic: bool = checked(False, flag)

    def __post_init__(self) -> None:
        check_fields(self, "Camera")
        with np.errstate(over="ignore"):
            forward = self.lookat - self.eye
        if not np.isfinite(forward).all() or not forward.any():
            raise value_error("Camera", "lookat", "a point other than eye", self.lookat.tolist())
        if not self.up.any():
            raise value_error("Camera", "up", "a vector other than zero", self.up.tolist())
        if np.linalg.norm(np.cross(forward / np.abs(forward).max(), self.up / np.abs(self.up).max())) <= 1e-12:
            raise value_error("Camera", "up", "a vector not parallel to lookat - eye", self.up.tolist())

    @classmethod
    def from_fov(
        cls, eye: ArrayLike, lookat: ArrayLike, up: ArrayLike, fov: float, resolution: tuple[int, int] = (800, 600)
    ) -> Camera:
        """Create a camera with square pixels and focal 1 from a vertical field of view.

        Parameters
        ----------
        eye, lookat, up : array_like, (3,)
            Pose, world space, see `Camera`.
        fov : float
            Vertical field of view, degrees, from 1e-6 to less than 180.
        resolution : (int, int), default (800, 600)
            (N, M), columns and rows of the image, 1 to 16384 pixels each.
        """
        height = height_seen("Camera.from_fov", "fov", fov)
        columns, rows = checked_resolution("Camera.from_fov", resolution)
        return cls(eye, lookat, up, 1.0, (height, height * columns / rows), (columns, rows))

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        pose: ArrayLike,
        resolution: tuple[int, int],
        *,
        pixel_center: float = 0.5,
        convention: Convention = "opencv",
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

        Notes
        -----
        The camera has focal 1. A matrix of another form is refused, as is a pose with a scale or a
        reflection beyond 1e-6.
        """
        who = "Camera.from_matrix"
        size = checked_resolution(who, resolution)
        return cls(resolution=size, **lens_of(who, matrix, size, pixel_center), **placement_of(who, pose, convention))

    @classmethod
    def from_matrices(
        cls,
        matrices: ArrayLike,
        poses: ArrayLike,
        resolution: tuple[int, int],
        *,
        pixel_center: float = 0.5,
        convention: Convention = "opencv",
    ) -> tuple[Camera, ...]:
        """Create cameras from intrinsic matrices and poses, one for each pose.

        Parameters
        ----------
        matrices : array_like, (3, 3) or (P, 3, 3)
            That of all cameras, or one for each.
        poses : array_like, (P, 4, 4) or (P, 3, 4)
            Camera to world.
        resolution, pixel_center, convention
            See `from_matrix`. Errors count matrices and poses from 0.
        """
        who = "Camera.from_matrices"
        size = checked_resolution(who, resolution)
        placements = floats(who, "poses", poses, "an array of shape (P, 4, 4) or (P, 3, 4)")
        lenses = floats(who, "matrices", matrices, "an array of shape (3, 3) or (P, 3, 3)")
        if placements.ndim != 3:
            raise value_error(who, "poses", "an array of shape (P, 4, 4) or (P, 3, 4)", placements)
        if one_for_all := lenses.ndim < 3:
            lenses = np.broadcast_to(lenses, (len(placements), *lenses.shape))
        if len(lenses) != len(placements):
            expected = f"one, or {len(placements)} for as many poses"
            raise InputError(f"{who}: matrices: expected {expected}, found {len(lenses)}")
        cameras = []
        for k, (matrix, pose) in enumerate(zip(lenses, placements, strict=True)):
            lens = lens_of(who, matrix, size, pixel_center, "matrices" if one_for_all else f"matrices[{k}]")
            cameras.append(cls(resolution=size, **lens, **placement_of(who, pose, convention, f"poses[{k}]")))
        return tuple(cameras)

    def to_matrix(self, *, pixel_center: float = 0.5, convention: Convention = "opencv") -> tuple[Floats, Floats]:
        """Return the 3x3 intrinsic matrix K, in pixels, and the (4, 4) pose, camera to world, both float64.

        It is the inverse of `from_matrix`. An orthographic camera, which has no K, is refused.

        Parameters
        ----------
        pixel_center, convention
            See `from_matrix`.

        Examples
        --------
        >>> import clshade
        >>> camera = clshade.Camera.from_fov((0, 0, 4), (0, 0, 0), (0, 1, 0), 90, resolution=(640, 480))
        >>> matrix, pose = camera.to_matrix()
        >>> matrix.round(9).tolist()
        [[240.0, 0.0, 320.0], [0.0, 240.0, 240.0], [0.0, 0.0, 1.0]]
        """
        who = "Camera.to_matrix"
        shift = 0.5 - _checked_center(who, pixel_center)
        pose = self.pose(convention)
        if self.orthographic:
            raise InputError(f"{who}: expected a perspective camera, found an orthographic one, which has no K")
        (height, width), (columns, rows), (u, v) = self.plane, self.resolution, self.principal
        matrix = np.eye(3)
        matrix[0] = columns * (self.focal / width), 0.0, u * columns - shift
        matrix[1] = 0.0, rows * (self.focal / height), (1.0 - v) * rows - shift
        return matrix, pose

    def pose(self, convention: Convention = "opencv") -> Floats:
        """Return the pose, camera to world, (4, 4) float64: a rotation and a translation.

        Parameters
        ----------
        convention
            See `from_matrix`.
        """
        choice("Camera.pose", "convention", convention, CONVENTIONS)
        pose = np.eye(4)
        pose[:3, :3] = np.transpose(axes_of(self)) * (1.0, -1.0, 1.0) * _SIGNS[convention]
        pose[:3, 3] = self.eye
        return pose + 0.0  # no -0.0 in files

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
        right = np.array(axes_of(self)[0])
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
        columns, rows = checked_resolution("Camera", resolution)
        return replace(self, plane=(self.plane[0], self.plane[0] * columns / rows), resolution=(columns, rows))


@dataclass(frozen=True, eq=False)
class PartCamera(Camera):
    """The camera of a part of an image, made by `part_of`. Its lens is that of the part; whole: the camera of all of it;
    left, top: column and row of the part's first pixel, from the top left of the whole."""

    whole: Camera | None = None
    left: int = 0
    top: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        lens = self.plane, self.principal
        if self.whole is None or lens != _lens(self.whole, self.left, self.top, self.resolution):
            raise value_error("PartCamera", "plane, principal", "those of `part_of`", lens)

    def with_resolution(self, resolution: tuple[int, int]) -> Camera:
        """Return the view of the whole image at another resolution."""
        assert self.whole is not None
        return self.whole.with_resolution(resolution)


def _checked_center(who: str, value: Any) -> float:
    """Return the coordinate of the first pixel's center, 0.5 or 0."""
    if not np.isscalar(value) or value not in (0, 0.5):
        raise value_error(who, "pixel_center", "0.5 or 0", value)
    return float(value)  # type: ignore[arg-type]


def lens_of(
    who: str, matrix: Any, resolution: tuple[int, int], pixel_center: float, name: str = "matrix"
) -> dict[str, Any]:
    """Return the fields of a camera that K determines. who, name: for errors. Raises InputError for another form of K."""
    k = floats(who, name, matrix, _K_FORM).astype(np.float64)
    if k.shape != (3, 3) or not np.isfinite(k).all():
        raise value_error(who, name, _K_FORM, k.tolist() if k.size <= 9 else k)
    if k[0, 1] != 0.0:
        raise InputError(f"{who}: {name}: expected {_K_FORM}, found a skew of {k[0, 1]:g}, which this camera has not")
    if (k[[1, 2, 2], [0, 0, 1]] != 0.0).any() or k[2, 2] != 1.0:
        raise value_error(who, name, _K_FORM, k.tolist())
    if min(k[0, 0], k[1, 1]) <= 0.0:
        raise value_error(who, name, "fx and fy above 0", k.tolist())
    (columns, rows), shift = resolution, 0.5 - _checked_center(who, pixel_center)
    (fx, _, cx), (_, fy, cy), _ = k.tolist()
    principal = (cx + shift) / columns, 1.0 - (cy + shift) / rows
    return {"focal": 1.0, "plane": (rows / fy, columns / fx), "principal": principal, "orthographic": False}


def placement_of(who: str, pose: Any, convention: str, name: str = "pose") -> dict[str, Any]:
    """Return eye, lookat and up of a camera in a pose. who, name: for errors. Raises InputError for a matrix that is no
    rotation with a translation."""
    matrix = floats(who, name, pose, _POSE_FORM).astype(np.float64)
    if matrix.shape not in ((4, 4), (3, 4)) or not np.isfinite(matrix).all():
        raise value_error(who, name, _POSE_FORM, matrix.tolist() if matrix.size <= 16 else matrix)
    if len(matrix) == 4 and np.abs(matrix[3] - (0.0, 0.0, 0.0, 1.0)).max() > _RIGID:
        raise value_error(who, name, "a last row of 0, 0, 0, 1", matrix[3].tolist())
    choice(who, "convention", convention, CONVENTIONS)
    rotation, eye = matrix[:3, :3], matrix[:3, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = np.abs(rotation @ rotation.T - np.eye(3)).max() <= _RIGID
    if not rigid or np.linalg.det(rotation) < 0.0:
        scale = np.abs(rotation).max() or 1.0
        kind = "a singular matrix" if np.linalg.matrix_rank(rotation / scale) < 3 else "the matrix"
        rows = "; ".join(" ".join(f"{value:.6g}" for value in row) for row in rotation)
        shown = "a reflection" if rigid else f"{kind} [{rows}]"
        raise InputError(f"{who}: {name}: expected a rotation without scale or reflection, found {shown}")
    _, down, forward = (rotation * _SIGNS[convention]).T
    return {"eye": eye, "lookat": eye + forward, "up": -down}


def axes_of(camera: Camera) -> tuple[tuple[float, float, float], ...]:
    """Return the rows of `geometry.camera_axes`, in plain floats: for one camera NumPy's overhead would make it ten times as
    slow."""
    eye, lookat, up = camera.eye.tolist(), camera.lookat.tolist(), camera.up.tolist()
    z = _unit(*(0.5 * b - 0.5 * a for a, b in zip(eye, lookat, strict=True)))
    if not any(z):
        raise value_error("Camera", "lookat", "a point other than eye", lookat)
    exponent = math.frexp(max(map(abs, up)))[1]
    u = [math.ldexp(value, -exponent) for value in up]
    along = (u[0] * z[0] + u[1] * z[1]) + u[2] * z[2]
    across = [a - along * b for a, b in zip(u, z, strict=True)]
    if max(map(abs, across)) <= 1e-12:
        raise value_error("Camera", "up", "a vector not parallel to lookat - eye", up)
    y = _unit(*across)
    x = (z[1] * y[2] - z[2] * y[1], z[2] * y[0] - z[0] * y[2], z[0] * y[1] - z[1] * y[0])
    return x, y, z


def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Normalize a vector of any finite length; the zero vector is kept."""
    exponent = math.frexp(max(abs(x), abs(y), abs(z)))[1]
    x, y, z = (math.ldexp(value, -exponent) for value in (x, y, z))
    length = math.sqrt(x * x + y * y + z * z) or 1.0
    return x / length, y / length, z / length


class Raster(NamedTuple):
    """The pixels of the whole image that a camera shows all or a part of. Rows count from its bottom.

    corner: column and row of the lower left corner of the region that contains the part: corners of triangles far outside
    of it are clipped. first: column and row of the part's lower left pixel.
    """

    plane: tuple[float, float]
    principal: tuple[float, float]
    resolution: tuple[int, int]
    corner: tuple[int, int]
    first: tuple[int, int]


def whole_camera(camera: Camera, resolution: tuple[int, int]) -> Camera:
    """Return the camera at a resolution (N, M) of up to MAX_WHOLE pixels a side, more than can be drawn at once. Raises
    InputError."""
    columns, rows = checked_resolution("whole_camera", resolution, MAX_WHOLE)
    if isinstance(camera, PartCamera):
        raise value_error("whole_camera", "camera", "one of a whole image", camera)
    if (columns, rows) == camera.resolution:
        return camera
    uncropped = copy.copy(camera)
    height = camera.plane[0]
    vars(uncropped).update(plane=(height, height * columns / rows), resolution=(columns, rows))
    return uncropped


def part_of(whole: Camera, left: int, top: int, columns: int, rows: int) -> PartCamera:
    """Return the camera of a part of an image of `columns` x `rows` pixels, whose first is at `left` and `top`, from the top
    left of the whole. It may not cross a multiple of MAX_RESOLUTION. Raises InputError."""
    for name, start, count, size in zip(("left", "top"), (left, top), (columns, rows), whole.resolution, strict=True):
        region_end = min((start // MAX_RESOLUTION + 1) * MAX_RESOLUTION, size)
        if start < 0 or count < 1 or start + count > region_end:
            expected = f"a part that ends within {region_end} of {size} pixels"
            raise value_error("part_of", name, expected, f"{count} from {start} on")
    if isinstance(whole, PartCamera):
        raise value_error("part_of", "whole", "the camera of a whole image", whole)
    plane, principal = _lens(whole, left, top, (columns, rows))
    fields = {**vars(whole), "plane": plane, "resolution": (columns, rows), "principal": principal}
    return PartCamera(**fields, whole=whole, left=left, top=top)


def _lens(whole: Camera, left: int, top: int, resolution: tuple[int, int]) -> tuple[tuple[float, float], ...]:
    """Return plane and principal point of a part."""
    (height, width), (all_columns, all_rows), (u, v) = whole.plane, whole.resolution, whole.principal
    columns, rows = resolution
    bottom = all_rows - top - rows
    plane = height * rows / all_rows, width * columns / all_columns
    return plane, ((u * all_columns - left) / columns, (v * all_rows - bottom) / rows)


def raster_of(camera: Camera) -> Raster:
    if not isinstance(camera, PartCamera):
        return Raster(camera.plane, camera.principal, camera.resolution, (0, 0), (0, 0))
    uncropped = camera.whole
    assert uncropped is not None
    rows = uncropped.resolution[1]
    region_end = min(camera.top - camera.top % MAX_RESOLUTION + MAX_RESOLUTION, rows)
    corner = camera.left - camera.left % MAX_RESOLUTION, rows - region_end
    first = camera.left, rows - camera.top - camera.resolution[1]
    return Raster(uncropped.plane, uncropped.principal, uncropped.resolution, corner, first)
