"""Cameras in JSON files: a list of objects, or one object with stacks of matrices."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from ..base.atomic_files import Path, shown, write_bytes
from ..base.input_files import file_error, quoted, read_file
from ..base.json_values import found_text, parse_text, plain
from ..base.spelling import hint
from ..base.validation import arguments, items, value_error
from ..base.validation import path as checked_path
from ..errors import InputError
from ..scene.adjust_camera import posed
from ..scene.camera import Camera, Convention, checked_resolution, lens_of, placement_of
from .frames import MAX_FRAMES

MAX_BYTES = 1 << 27
_CAMERA_FIELDS = tuple(field.name for field in fields(Camera))
FIELDS = (*_CAMERA_FIELDS, "fov", "K", "pose", "convention", "pixel_center")
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
    """Read cameras from a JSON file: a list of objects, or one object with lists of matrices.

    The fields of an object are those of Camera, ``fov`` (vertical, in degrees) in place of focal and
    plane, and ``K``, ``pose``, ``convention`` and ``pixel_center`` of `Camera.from_matrix`: K in place
    of focal, plane and principal, in the pixels of the object's resolution, and pose in place of eye,
    lookat and up. If K, pose or both are lists of matrices, one object stands for as many cameras. A
    resolution without a plane or K keeps the plane's height and makes pixels square.

    Parameters
    ----------
    path : str or path-like
        The file, at most 2**27 bytes and 1,000,000 cameras.
    base : Camera
        Supplies the fields that an object leaves out.
    resolution : (int, int), optional
        (N, M), columns and rows of all cameras. K is scaled, and must have the same proportions.

    Raises
    ------
    InputError
        If the file is refused; the error names the file, the camera (counted from 1) and the field.
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
    try:
        camera = _made(values, base, resolution or base.resolution, f"{owner}: {who}")
        return camera if resolution is None else _resized(camera, resolution, scaled="K" in values)
    except InputError as error:
        raise InputError(f"{owner}: {who}: {str(error).removeprefix('Camera: ')}") from None


def _made(values: dict[str, Any], base: Camera, resolution: tuple[int, int], owner: str) -> Camera:
    """Return the camera of an object. resolution: of the pixels of a K without its own. Raises InputError, with Camera in
    front."""
    size = values.get("resolution", resolution if "K" in values else None)
    if size is not None and ("K" in values or "plane" not in values):
        base = base.with_resolution(size)
    changes = {name: value for name, value in values.items() if name in _CAMERA_FIELDS}
    if "pose" in values:
        changes |= placement_of("Camera", values["pose"], values.get("convention", "opencv"))
    if "K" in values:
        changes |= lens_of("Camera", values["K"], base.resolution, values.get("pixel_center", 0.5), "K")
    camera = posed(base, owner, **changes)
    if "fov" in values:
        upright = Camera.from_fov(camera.eye, camera.lookat, camera.up, values["fov"], camera.resolution)
        camera = replace(upright, principal=camera.principal)
    return camera


def _resized(camera: Camera, resolution: tuple[int, int], *, scaled: bool) -> Camera:
    """Return the camera at a resolution. scaled: its K is."""
    if not scaled:
        return camera.with_resolution(resolution)
    (columns, rows), (k_columns, k_rows) = resolution, camera.resolution
    if columns * k_rows != rows * k_columns:
        expected = f"the proportions of {k_columns}x{k_rows}, whose pixels K is in"
        raise InputError(f"Camera: --resolution: expected {expected}, found {columns}x{rows}")
    return replace(camera, resolution=resolution)


@arguments(path=checked_path, cameras=items)
def write_cameras(
    path: Path, cameras: Iterable[Camera], *, pixel_center: float = 0.5, convention: Convention = "opencv"
) -> None:
    """Write cameras as a JSON file that `read_cameras` reads: with K and pose, orthographic ones with Camera's fields.

    Parameters
    ----------
    path : str or path-like
        The file; if it cannot be written, one that was there stays as it was.
    cameras : iterable of Camera
        The cameras.
    pixel_center, convention
        Of K and pose, see `Camera.from_matrix`.
    """
    lines = [json.dumps(_described(camera, pixel_center, convention)) for camera in cameras]
    write_bytes(path, ("[\n" + ",\n".join(lines) + "\n]\n").encode())


def _described(camera: Camera, pixel_center: float, convention: Convention) -> dict[str, Any]:
    if not isinstance(camera, Camera):
        raise value_error("write_cameras", "cameras", "cameras", camera)
    if camera.orthographic:
        return {name: plain(getattr(camera, name)) for name in _CAMERA_FIELDS}
    matrix, pose = camera.to_matrix(pixel_center=pixel_center, convention=convention)
    lens = {"K": matrix.tolist(), "pose": pose.tolist(), "resolution": camera.resolution}
    return {**lens, "convention": convention, "pixel_center": pixel_center}
