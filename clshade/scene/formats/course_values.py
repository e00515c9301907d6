"""Checks shared by course files and the course's functions: meshes, lights, cameras, under the names each uses.

Every error is an `InputError` of the form `owner: name: expected ..., found ...`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.validation import floats, indices, integer, number, rows, value_error, vector
from ...errors import InputError
from ..camera import MAX_RESOLUTION, Camera
from ..model import MAX_FACES

_WIDTHS = {"verts": 3, "colors": 3, "faces": 3, "uvs": 2, "uv_faces": 3}


def mesh_fields(
    owner: str, names: Mapping[str, str], given: Mapping[str, Any], *, finite_uvs: bool = True
) -> dict[str, Any]:
    """Return the arrays of a Mesh by field, contiguous, one row per item, from arrays all 3xN (2xN) or all Nx3.

    given: verts and faces, optionally colors, optionally uvs and uv_faces. names: of each in messages.
    verts, colors and uvs are float32 or float64 as given, indices int32 in range.
    """
    found = dict(zip(given, _upright(owner, names, given), strict=True))
    verts = rows(owner, names["verts"], found["verts"], 3)
    faces = indices(owner, names["faces"], found["faces"], len(verts))
    if len(faces) > MAX_FACES:
        raise value_error(owner, names["faces"], f"at most {MAX_FACES} triangles", len(faces))
    fields = {"verts": verts, "faces": faces}
    if "colors" in found:
        fields["colors"] = colors = rows(owner, names["colors"], found["colors"], 3)
        if len(colors) != len(verts):
            raise value_error(owner, names["colors"], f"one color per vertex ({len(verts)})", len(colors))
    if "uvs" in found:
        fields["uvs"] = uvs = rows(owner, names["uvs"], found["uvs"], 2, finite=finite_uvs)
        fields["uv_faces"] = uv_faces = indices(owner, names["uv_faces"], found["uv_faces"], len(uvs))
        if len(uv_faces) != len(faces):
            raise value_error(owner, names["uv_faces"], f"one triple per face ({len(faces)})", len(uv_faces))
    return fields


def _upright(owner: str, names: Mapping[str, str], given: Mapping[str, Any]) -> list[Array]:
    """Return the arrays with one row per item, as views. Those that are not square show the layout; default 3xN."""
    shown_by: dict[bool, str] = {}  # whether 3xN, and the first array that shows it
    for field, array in given.items():
        width = _WIDTHS[field]
        if not isinstance(array, np.ndarray) or array.ndim != 2 or width not in array.shape:
            raise value_error(owner, names[field], f"an array of shape ({width}, N) or (N, {width})", array)
        if array.shape != (width, width):
            shown_by.setdefault(array.shape[0] == width, field)
    if len(shown_by) == 2:
        turned, layout = shown_by[False], names[shown_by[True]]
        raise value_error(owner, names[turned], f"shape ({_WIDTHS[turned]}, N), the layout of {layout}", given[turned])
    return [array if False in shown_by else array.T for array in given.values()]


def lights(owner: str, names: tuple[str, str], positions: Any, intensities: Any) -> tuple[Floats, Floats]:
    """Return positions and intensities, (L, 3) float64 each. names: of the two in messages."""
    places, powers = _per_light(owner, names[0], positions), _per_light(owner, names[1], intensities)
    if len(places) != len(powers):
        raise value_error(owner, names[1], f"one row per light of {names[0]} ({len(places)})", f"{len(powers)} rows")
    return places, powers


def _is_vector(value: Any) -> bool:
    """Return whether the value is three numbers, (3,) or (3, 1): no list of 3-vectors has that shape."""
    try:
        found = np.asarray(value)
    except ValueError:  # rows of different lengths
        return False
    return found.shape in ((3,), (3, 1)) and found.dtype.kind in "fiub"


def _per_light(owner: str, name: str, value: Any) -> Floats:
    """Return (L, 3) float64 from an array of L rows, a list of L 3-vectors, or one 3-vector; L is 0 if it is empty."""
    if _is_vector(value):
        return np.asarray(vector(owner, name, value)[None].copy())
    if isinstance(value, (list, tuple)):
        listed = [vector(owner, f"{name}[{k}]", item) for k, item in enumerate(value)]
        return np.array(listed).reshape(-1, 3)
    expected = "an array of shape (L, 3), rows are lights, a list of 3-vectors, or one of them"
    found = floats(owner, name, value, expected)
    if found.size == 0:
        return np.zeros((0, 3))
    if found.ndim == 3 and found.shape[1:] in ((1, 3), (3, 1)):
        found = found.reshape(-1, 3)
    if found.ndim != 2 or found.shape[1] != 3:
        raise value_error(owner, name, expected, found)
    return rows(owner, name, found, 3).astype(np.float64)


def camera(
    owner: str, pose: Sequence[Any], focal: Any, size: tuple[Any, Any], plane: tuple[Any, Any], *, prefix: str = ""
) -> Camera:
    """Return the camera with (eye, lookat, up), (M, N) rows and columns and an image plane (H, W).

    prefix: of the names eye, lookat and up in messages.
    """
    count_rows, columns = (integer(owner, *item, 1, MAX_RESOLUTION) for item in zip("MN", size, strict=True))
    height, width = (number(owner, *item, above=0.0) for item in zip("HW", plane, strict=True))
    distance = number(owner, "focal", focal, above=0.0)
    names = ("eye", "lookat", "up")
    eye, lookat, up = (vector(owner, prefix + name, value) for name, value in zip(names, pose, strict=True))
    try:
        return Camera(eye, lookat, up, distance, (height, width), (columns, count_rows))
    except InputError as error:
        raise InputError(f"{owner}: {prefix}{str(error).removeprefix('Camera: ')}") from None


def exponent(owner: str, value: Any) -> float:
    """Return the specular exponent n, 0 to 1e9."""
    return number(owner, "n", value, least=0.0, most=1e9, expected="a number from 0 to 1e9")
