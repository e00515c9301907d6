"""Cameras in JSON files: a list of objects, or one object with stacks of matrices."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from ..base.atomic_files import Path, shown, write_bytes
from ..base.input_files import file_error, quoted, read_file
from ..base.json_values import found_text, parse_text
from ..base.spelling import hint
from ..base.validation import arguments, items, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..scene import pinhole
from ..scene.adjust_camera import posed
from ..scene.camera import Camera, checked_resolution
from .frames import MOST

MAX_BYTES = 1 << 27
_OWN = tuple(field.name for field in fields(Camera))
FIELDS = (*_OWN, "fov", "K", "pose", "convention", "pixel_center")
_OTHER_NAMES = {
    "intrinsics": "K",
    "intrinsic": "K",
    "camera_matrix": "K",
    "extrinsics": "pose",
    "camera_to_world": "pose",
    "c2w": "pose",
    "transform_matrix": "pose",
}
# Fields -> those that say the same in another way.
_CLASHES = {
    "fov": ("focal", "plane", "orthographic"),
    "K": ("fov", "focal", "plane", "principal", "orthographic"),
    "pose": ("eye", "lookat", "up"),
}
_NEEDED = {"convention": "pose", "pixel_center": "K"}
_SHAPES = {"K": ((3, 3),), "pose": ((4, 4), (3, 4))}
_FORMS = {"K": "three rows of three numbers", "pose": "four or three rows of four numbers"}


@arguments(path=checked_path, base=Camera)
def read_cameras(path: Path, base: Camera, resolution: tuple[int, int] | None = None) -> tuple[Camera, ...]:
    """Read cameras from a JSON file.

    The file holds a list of objects with any of Camera's fields, ``fov``, ``K``, ``pose``,
    ``convention`` and ``pixel_center``; or one such object for all cameras, in which ``K``, ``pose``
    or both are lists of matrices, one for each camera.

    Parameters
    ----------
    path : str or path-like
        The file, at most 2**27 bytes and 1,000,000 cameras.
    base : Camera
        Supplies the fields that an object leaves out.
    resolution : (int, int), optional
        (N, M), columns and rows of all cameras. A camera with K has to have the same proportions: its
        K is scaled.

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
    ``fov``, in degrees, is the vertical field of view, given in place of focal and plane. ``K`` takes
    their place and that of principal, ``pose`` that of eye, lookat and up; both are those of
    `Camera.from_matrix`, and so are ``convention`` and ``pixel_center``. The pixels of K are those of
    ``resolution``. A resolution without a plane or K keeps the plane's height and makes pixels square.
    """
    owner = shown(path)
    resolution = None if resolution is None else checked_resolution("read_cameras", resolution)
    listed = parse_text(read_file(path, MAX_BYTES), owner, "a list of cameras", unique=True)
    if isinstance(listed, dict):
        listed = _separated(listed, owner)
    if not isinstance(listed, list) or not listed:
        found = "an empty list" if listed == [] else found_text(listed)
        raise file_error(owner, "JSON", "a list of cameras, [{...}, ...]", found)
    if len(listed) > MOST:
        raise file_error(owner, "JSON", f"at most {MOST} cameras", str(len(listed)))
    return tuple(_camera(given, base, resolution, owner, f"camera {k}") for k, given in enumerate(listed, 1))


def _separated(given: dict[str, Any], owner: str) -> list[dict[str, Any]]:
    """Return the objects of single cameras for one with lists of matrices."""
    _check_names(given, owner, "cameras")
    counts = {name: len(given[name]) for name in _SHAPES if _depth(given.get(name)) == 3}
    if not counts:
        form = '[{...}, ...], or an object with a list of matrices, {"K": [[...], ...], "pose": [[[...], ...], ...]}'
        raise file_error(owner, "JSON", f"a list of cameras, {form}", "an object without one")
    if len(set(counts.values())) > 1:
        expected = f"as many as of K, {counts['K']}"
        raise file_error(owner, "pose", expected, str(counts["pose"]))
    count = next(iter(counts.values()))
    return [{**given, **{name: given[name][k] for name in counts}} for k in range(count)]


def _depth(value: Any) -> int:
    """Return how many lists are nested in a value's first items, three at most."""
    depth = 0
    while depth < 3 and isinstance(value, list):
        depth += 1
        value = value[0] if value else None
    return depth


def _check_names(given: dict[str, Any], owner: str, who: str) -> None:
    for key in given:
        if key not in FIELDS:
            near = hint(key, FIELDS, _OTHER_NAMES)
            raise file_error(owner, who, f"fields of {', '.join(FIELDS)}", quoted(key) + near)
    for name, others in _CLASHES.items():
        for other in others:
            if name in given and other in given:
                raise file_error(owner, f"{who}: {name}", f"either {name} or {other}", "both")
    for name, needed in _NEEDED.items():
        if name in given and needed not in given:
            raise file_error(owner, f"{who}: {name}", f"{needed} beside it", "none")


def _camera(given: Any, base: Camera, resolution: tuple[int, int] | None, owner: str, who: str) -> Camera:
    if not isinstance(given, dict):
        raise file_error(owner, who, 'an object such as {"eye": [1, 2, 3]}', found_text(given))
    _check_names(given, owner, who)
    for key, value in given.items():
        if key == "orthographic" and not isinstance(value, bool):
            raise file_error(owner, f"{who}: {key}", "true or false", found_text(value))
        if key == "convention" and not isinstance(value, str):
            raise file_error(owner, f"{who}: {key}", " or ".join(pinhole.CONVENTIONS), found_text(value))
        if key in _SHAPES:
            if not _is_matrix(value, _SHAPES[key]):
                raise file_error(owner, f"{who}: {key}", _FORMS[key], found_text(value))
        elif key not in ("orthographic", "convention") and not _are_numbers(value):
            raise file_error(owner, f"{who}: {key}", "numbers", found_text(value))
    try:
        return _made(given, base, resolution, f"{owner}: {who}")
    except InputError as error:
        raise InputError(f"{owner}: {who}: {str(error).removeprefix('Camera: ')}") from None


def _made(given: dict[str, Any], base: Camera, resolution: tuple[int, int] | None, owner: str) -> Camera:
    """Return the camera of an object whose fields have the right types. Raises InputError, with Camera in front."""
    own = given.get("resolution")
    if "K" in given:
        # K's pixels are those of the file's resolution; without one, those of the images.
        base = base.with_resolution(next(each for each in (own, resolution, base.resolution) if each is not None))
    elif own is not None and "plane" not in given:
        base = base.with_resolution(own)
    values = {name: value for name, value in given.items() if name in _OWN}
    if "pose" in given:
        eye, forward, up = pinhole.placement_of("Camera", given["pose"], given.get("convention", "opencv"))
        values |= {"eye": eye, "lookat": eye + forward, "up": up}
    if "K" in given:
        center = given.get("pixel_center", 0.5)
        plane, principal = pinhole.lens_of("Camera", given["K"], base.resolution, center, "K")
        values |= {"focal": 1.0, "plane": plane, "principal": principal, "orthographic": False}
    camera = posed(base, owner, **values)
    if "fov" in given:
        seen = Camera.from_fov(camera.eye, camera.lookat, camera.up, given["fov"], camera.resolution)
        camera = replace(seen, principal=camera.principal)
    if resolution is None or "K" not in given:
        return camera if resolution is None else camera.with_resolution(resolution)
    return _scaled(camera, resolution)


def _scaled(camera: Camera, resolution: tuple[int, int]) -> Camera:
    """Return the camera of the same image plane at another resolution. Raises InputError for other proportions."""
    (columns, rows), (own_columns, own_rows) = resolution, camera.resolution
    if columns * own_rows != rows * own_columns:
        expected = f"the proportions of {own_columns}x{own_rows}, whose pixels K is in"
        raise InputError(f"Camera: --resolution: expected {expected}, found {columns}x{rows}")
    return replace(camera, resolution=(columns, rows))


def _are_numbers(value: Any) -> bool:
    """Return whether `value` is a number or a flat list of numbers: JSON lists may nest nearly as deep as Python's
    stack."""
    return all(type(each) in (int, float) for each in (value if isinstance(value, list) else [value]))


def _is_matrix(value: Any, shapes: tuple[tuple[int, int], ...]) -> bool:
    """Return whether `value` is a list of rows, flat lists of numbers, of one of the shapes."""
    return (
        isinstance(value, list)
        and all(isinstance(row, list) and _are_numbers(row) for row in value)
        and any(len(value) == rows and all(len(row) == columns for row in value) for rows, columns in shapes)
    )


@arguments(path=checked_path, cameras=items)
def write_cameras(
    path: Path, cameras: Iterable[Camera], *, pixel_center: float = 0.5, convention: pinhole.Convention = "opencv"
) -> None:
    """Write cameras as a JSON file that `read_cameras` reads: with K and pose, orthographic ones with Camera's fields.

    Parameters
    ----------
    path : str or path-like
        The file.
    cameras : iterable of Camera
        The cameras.
    pixel_center, convention
        Of K and pose, see `Camera.from_matrix`.

    Raises
    ------
    InputError
        If an argument is refused.
    OutputError
        If the file cannot be written; one that was there stays as it was.
    """
    lines = [json.dumps(_described(camera, pixel_center, convention)) for camera in cameras]
    write_bytes(path, ("[\n" + ",\n".join(lines) + "\n]\n").encode())


def _described(camera: Camera, pixel_center: float, convention: pinhole.Convention) -> dict[str, Any]:
    if not isinstance(camera, Camera):
        raise value_error("write_cameras", "cameras", "cameras", camera)
    if camera.orthographic:
        values = {name: getattr(camera, name) for name in _OWN}
        return {name: value.tolist() if hasattr(value, "tolist") else value for name, value in values.items()}
    matrix, pose = camera.to_matrix(pixel_center=pixel_center, convention=convention)
    return {
        "K": matrix.tolist(),
        "pose": pose.tolist(),
        "resolution": camera.resolution,
        "convention": convention,
        "pixel_center": pixel_center,
    }
