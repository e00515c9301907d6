"""Where the camera of each frame is: round what it looks at, or as a file says."""

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
    """The cameras of frames on a circle about `up` through what the camera looks at, made when they are asked for: a
    million would take minutes.

    turn: the frames that go round by `degrees` (above 0: to the camera's right); its first one is `camera` itself, and
    the one after its last would be the first again after a whole turn, so that a film of them has no standstill.
    """
    return _Orbit(camera, dict.fromkeys(numbers), turn, degrees)


@dataclass(frozen=True, eq=False)
class _Orbit(Mapping[int, Camera]):
    """numbers: the keys, in order."""

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
    """The cameras of a JSON file: a list of objects with some of FIELDS, the others taken from `base`.

    `fov`, degrees, is the vertical field of view, in place of focal and plane. A resolution without a plane keeps the
    plane's height and makes pixels square. Raises InputError, which names file, camera (counted from 1) and field.
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
    """A number or a list of numbers, and no list of lists: those of JSON may be nested nearly as deep as Python's stack."""
    return all(type(each) in (int, float) for each in (value if isinstance(value, list) else [value]))
