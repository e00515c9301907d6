"""Cameras in JSON files: a list of objects, or one object with stacks of matrices."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from functools import partial
from typing import Any

from ..base.atomic_files import Path, shown, write_bytes
from ..base.input_files import file_error, quoted, read_file
from ..base.json_values import found_text, parse_text
from ..base.spelling import hint
from ..base.validation import arguments, items, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..scene.adjust_camera import posed
from ..scene.camera import CONVENTIONS, Camera, Convention, checked_resolution, lens_of, placement_of
from .frames import MAX_FRAMES

MAX_BYTES = 1 << 27
_CAMERA_FIELDS = tuple(field.name for field in fields(Camera))


def _are_numbers(value: Any) -> bool:
    """Return whether `value` is a number or a flat list of numbers: JSON lists may nest nearly as deep as Python's
    stack."""
    return all(type(number) in (int, float) for number in (value if isinstance(value, list) else [value]))


def _is_matrix(value: Any, rows: tuple[int, ...], columns: int) -> bool:
    fits = isinstance(value, list) and len(value) in rows
    return fits and all(isinstance(row, list) and len(row) == columns and _are_numbers(row) for row in value)


# Fields of an object -> what the field holds, and whether a JSON value is that; `Camera` checks ranges.
FIELDS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    **dict.fromkeys((*_CAMERA_FIELDS, "fov", "K", "pose", "convention", "pixel_center"), ("numbers", _are_numbers)),
    "orthographic": ("true or false", lambda value: isinstance(value, bool)),
    "K": ("three rows of three numbers", partial(_is_matrix, rows=(3,), columns=3)),
    "pose": ("four or three rows of four numbers", partial(_is_matrix, rows=(3, 4), columns=4)),
    "convention": (" or ".join(CONVENTIONS), lambda value: isinstance(value, str)),
}
_SYNONYMS = {
    **dict.fromkeys(("intrinsics", "intrinsic", "camera_matrix"), "K"),
    **dict.fromkeys(("extrinsics", "camera_to_world", "c2w", "transform_matrix"), "pose"),
}
# Fields -> those that mean the same.
_CLASHES = {
    "fov": ("focal", "plane", "orthographic"),
    "K": ("fov", "focal", "plane", "principal", "orthographic"),
    "pose": ("eye", "lookat", "up"),
}
_NEEDED = {"convention": "pose", "pixel_center": "K"}


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
        content = "an empty list" if listed == [] else found_text(listed)
        raise file_error(owner, "JSON", "a list of cameras, [{...}, ...]", content)
    if len(listed) > MAX_FRAMES:
        raise file_error(owner, "JSON", f"at most {MAX_FRAMES} cameras", str(len(listed)))
    return tuple(_read(values, base, resolution, owner, f"camera {k}") for k, values in enumerate(listed, 1))


def _separated(stack: dict[str, Any], owner: str) -> list[dict[str, Any]]:
    """Return the objects of single cameras for one with lists of matrices."""
    _check_names(stack, owner, "cameras")
    counts = {name: len(stack[name]) for name in ("K", "pose") if isinstance(_first(_first(stack.get(name))), list)}
    if not counts:
        form = '[{...}, ...], or an object with a list of matrices, {"K": [[...], ...], "pose": [[[...], ...], ...]}'
        raise file_error(owner, "JSON", f"a list of cameras, {form}", "an object without one")
    if len(set(counts.values())) > 1:
        expected = f"as many as of K, {counts['K']}"
        raise file_error(owner, "pose", expected, str(counts["pose"]))
    count = next(iter(counts.values()))
    return [{**stack, **{name: stack[name][k] for name in counts}} for k in range(count)]


def _first(value: Any) -> Any:
    return value[0] if isinstance(value, list) and value else None


def _check_names(values: dict[str, Any], owner: str, who: str) -> None:
    for key in values:
        if key not in FIELDS:
            near = hint(key, FIELDS, _SYNONYMS)
            raise file_error(owner, who, f"fields of {', '.join(FIELDS)}", quoted(key) + near)
    for name, others in _CLASHES.items():
        for other in others:
            if name in values and other in values:
                raise file_error(owner, f"{who}: {name}", f"either {name} or {other}", "both")
    for name, needed in _NEEDED.items():
        if name in values and needed not in values:
            raise file_error(owner, f"{who}: {name}", f"{needed} beside it", "none")


def _read(values: Any, base: Camera, resolution: tuple[int, int] | None, owner: str, who: str) -> Camera:
    if not isinstance(values, dict):
        raise file_error(owner, who, 'an object such as {"eye": [1, 2, 3]}', found_text(values))
    _check_names(values, owner, who)
    for key, value in values.items():
        form, fits = FIELDS[key]
        if not fits(value):
            raise file_error(owner, f"{who}: {key}", form, found_text(value))
    try:
        return _made(values, base, resolution, f"{owner}: {who}")
    except InputError as error:
        raise InputError(f"{owner}: {who}: {str(error).removeprefix('Camera: ')}") from None


def _made(values: dict[str, Any], base: Camera, resolution: tuple[int, int] | None, owner: str) -> Camera:
    """Return the camera of an object whose fields have the right types. Raises InputError, with Camera in front."""
    size = values.get("resolution")
    if "K" in values:
        # K's pixels are those of the file's resolution; without one, those of the images.
        base = base.with_resolution(
            next(candidate for candidate in (size, resolution, base.resolution) if candidate is not None)
        )
    elif size is not None and "plane" not in values:
        base = base.with_resolution(size)
    changes = {name: value for name, value in values.items() if name in _CAMERA_FIELDS}
    if "pose" in values:
        eye, forward, up = placement_of("Camera", values["pose"], values.get("convention", "opencv"))
        changes |= {"eye": eye, "lookat": eye + forward, "up": up}
    if "K" in values:
        center = values.get("pixel_center", 0.5)
        plane, principal = lens_of("Camera", values["K"], base.resolution, center, "K")
        changes |= {"focal": 1.0, "plane": plane, "principal": principal, "orthographic": False}
    camera = posed(base, owner, **changes)
    if "fov" in values:
        upright = Camera.from_fov(camera.eye, camera.lookat, camera.up, values["fov"], camera.resolution)
        camera = replace(upright, principal=camera.principal)
    if resolution is None:
        return camera
    if "K" not in values:
        return camera.with_resolution(resolution)
    (columns, rows), (k_columns, k_rows) = resolution, camera.resolution
    if columns * k_rows != rows * k_columns:
        expected = f"the proportions of {k_columns}x{k_rows}, whose pixels K is in"
        raise InputError(f"Camera: --resolution: expected {expected}, found {columns}x{rows}")
    return replace(camera, resolution=(columns, rows))


@arguments(path=checked_path, cameras=items)
def write_cameras(
    path: Path, cameras: Iterable[Camera], *, pixel_center: float = 0.5, convention: Convention = "opencv"
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


def _described(camera: Camera, pixel_center: float, convention: Convention) -> dict[str, Any]:
    if not isinstance(camera, Camera):
        raise value_error("write_cameras", "cameras", "cameras", camera)
    if camera.orthographic:
        values = {name: getattr(camera, name) for name in _CAMERA_FIELDS}
        return {name: value.tolist() if hasattr(value, "tolist") else value for name, value in values.items()}
    matrix, pose = camera.to_matrix(pixel_center=pixel_center, convention=convention)
    return {
        "K": matrix.tolist(),
        "pose": pose.tolist(),
        "resolution": camera.resolution,
        "convention": convention,
        "pixel_center": pixel_center,
    }
