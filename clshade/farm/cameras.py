"""The camera of each frame: on a circle around the point it looks at, or from a file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, quoted, read_file
from ..base.spelling import hint
from ..base.strict_json import found_text, parse_text
from ..errors import InputError
from ..scene.adjust_camera import adjusted
from ..scene.camera import Camera
from .frames import MOST, Frames

MAX_BYTES = 1 << 27
FIELDS = (*(field.name for field in fields(Camera)), "fov")


def orbit(camera: Camera, numbers: Iterable[int], turn: Frames, degrees: float = 360.0) -> Mapping[int, Camera]:
    """Return cameras on a circle about `up` through the point the camera looks at.

    Parameters
    ----------
    camera : Camera
        Camera of the first frame.
    numbers : iterable of int
        Frame numbers to return cameras for.
    turn : Frames
        Frames of the whole turn, as returned by `parse_frames`. Its first frame has `camera`
        itself; the frame after its last would have it again after a whole turn, so a film of them
        loops without a standstill.
    degrees : float, default 360.0
        Angle of the turn; positive values move the camera to its right.

    Returns
    -------
    mapping of int to Camera
        Cameras by frame number, created when looked up: a million would take minutes.
    """
    return _Orbit(camera, dict.fromkeys(numbers), turn, degrees)


@dataclass(frozen=True, eq=False)
class _Orbit(Mapping[int, Camera]):
    """The mapping that `orbit` returns. numbers: the keys, in order."""

    camera: Camera
    numbers: Mapping[int, None]
    turn: Frames
    degrees: float

    def __getitem__(self, number: int) -> Camera:
        if number not in self.numbers:
            raise KeyError(number)
        angle = math.fmod(self.degrees * (number - self.turn.first) / self.turn.span, 360.0)
        return adjusted(self.camera, azimuth=angle)

    def __iter__(self) -> Iterator[int]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)


def read_cameras(path: Path, base: Camera) -> tuple[Camera, ...]:
    """Read cameras from a JSON file: a list of objects with any of Camera's fields and ``fov``.

    Parameters
    ----------
    path : str or path-like
        The file, at most 2**27 bytes and 1,000,000 cameras.
    base : Camera
        Supplies the fields that an object leaves out.

    Returns
    -------
    tuple of Camera
        The cameras, in the file's order.

    Raises
    ------
    InputError
        If the file is refused; the error names the file, the camera (counted from 1) and the field.

    Notes
    -----
    ``fov``, in degrees, is the vertical field of view, given in place of focal and plane. A
    resolution without a plane keeps the plane's height and makes pixels square.
    """
    owner = shown(path)
    listed = parse_text(read_file(path, MAX_BYTES), owner, "a list of cameras", unique=True)
    if not isinstance(listed, list) or not listed:
        found = "an empty list" if listed == [] else "an object" if isinstance(listed, dict) else found_text(listed)
        raise file_error(owner, "JSON", "a list of cameras, [{...}, ...]", found)
    if len(listed) > MOST:
        raise file_error(owner, "JSON", f"at most {MOST} cameras", str(len(listed)))
    return tuple(_camera(given, base, owner, f"camera {k}") for k, given in enumerate(listed, 1))


def _camera(given: Any, base: Camera, owner: str, who: str) -> Camera:
    if not isinstance(given, dict):
        raise file_error(owner, who, 'an object such as {"eye": [1, 2, 3]}', found_text(given))
    for key, value in given.items():
        if key not in FIELDS:
            near = hint(key, FIELDS)
            raise file_error(owner, who, f"fields of {', '.join(FIELDS)}", quoted(key) + near)
        if key == "orthographic" and not isinstance(value, bool):
            raise file_error(owner, f"{who}: {key}", "true or false", found_text(value))
        if key != "orthographic" and not _are_numbers(value):
            raise file_error(owner, f"{who}: {key}", "numbers", found_text(value))
    if "fov" in given and (clash := {"focal", "plane", "orthographic"} & set(given)):
        raise file_error(owner, f"{who}: fov", f"either fov or {min(clash)}", "both")
    values = dict(given)
    fov, resolution = values.pop("fov", None), values.get("resolution")
    try:
        if resolution is not None and "plane" not in values:
            base = base.with_resolution(resolution)
        camera = replace(base, **values)
        return camera if fov is None else _with_fov(camera, fov)
    except InputError as error:
        raise InputError(f"{owner}: {who}: {str(error).removeprefix('Camera: ')}") from None


def _with_fov(camera: Camera, fov: Any) -> Camera:
    seen = Camera.from_fov(camera.eye, camera.lookat, camera.up, fov, camera.resolution)
    return replace(seen, principal=camera.principal)


def _are_numbers(value: Any) -> bool:
    """Return whether `value` is a number or a flat list of numbers: JSON lists may nest nearly as deep as Python's
    stack."""
    return all(type(each) in (int, float) for each in (value if isinstance(value, list) else [value]))
