"""The arguments of the course's functions, checked: what comes back is what the rest of clshade works with.

Every refusal is an `InputError` of the form `function: argument: expected ..., found ...`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .camera import MAX_RESOLUTION, Camera
from .course_files import upright
from .errors import InputError
from .scene import MAX_FACES, Material, Texture
from .validation import Array, coefficient, indices, integer, number, refuse, rows, vector

_WIDTHS = {"verts": 3, "verts_colors": 3, "faces": 3, "uvs": 2, "uvs_faces": 3}


def array(owner: str, name: str, value: Any) -> Array:
    """An array of reals. Raises InputError for text, objects, complex numbers and rows of different lengths."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        found = np.asarray(None)
    if found.dtype.kind not in "fiub":
        raise refuse(owner, name, "an array of numbers", value)
    return found


def mesh(owner: str, **given: Any) -> dict[str, Array]:
    """`verts`, `faces` and, where given, `verts_colors`, `uvs`, `uvs_faces`: contiguous, a row per item, 3xN or Nx3.

    verts, verts_colors and uvs are float32 or float64 as given, indices int32 in range.
    """
    found = upright(owner, {name: array(owner, name, value) for name, value in given.items()}, _WIDTHS)
    verts = rows(owner, "verts", found["verts"], 3)
    faces = indices(owner, "faces", found["faces"], len(verts))
    if len(faces) > MAX_FACES:
        raise refuse(owner, "faces", f"at most {MAX_FACES} triangles", len(faces))
    checked = {"verts": verts, "faces": faces}
    if "verts_colors" in given:
        colors = rows(owner, "verts_colors", found["verts_colors"], 3)
        if len(colors) != len(verts):
            raise refuse(owner, "verts_colors", f"one color per vertex ({len(verts)})", len(colors))
        checked["verts_colors"] = colors
    if "uvs" in given:
        uvs = rows(owner, "uvs", found["uvs"], 2)
        uvs_faces = indices(owner, "uvs_faces", found["uvs_faces"], len(uvs))
        if len(uvs_faces) != len(faces):
            raise refuse(owner, "uvs_faces", f"one triple per face ({len(faces)})", len(uvs_faces))
        checked.update(uvs=uvs, uvs_faces=uvs_faces)
    return checked


def camera(owner: str, focal: Any, eye: Any, lookat: Any, up: Any, M: Any, N: Any, H: Any, W: Any) -> Camera:
    """The camera of M rows and N columns whose image plane is H high and W wide."""
    count_rows, columns = (integer(owner, name, value, 1, MAX_RESOLUTION) for name, value in (("M", M), ("N", N)))
    plane = number(owner, "H", H, above=0.0), number(owner, "W", W, above=0.0)
    distance = number(owner, "focal", focal, above=0.0)
    eye, lookat, up = (vector(owner, name, value) for name, value in (("eye", eye), ("lookat", lookat), ("up", up)))
    try:
        return Camera(eye, lookat, up, distance, plane, (columns, count_rows))
    except InputError as error:
        raise InputError(str(error).replace("Camera", owner, 1)) from None


def exponent(owner: str, value: Any) -> float:
    """n, 0 to 1e9."""
    found = number(owner, "n", value, least=0.0, expected="a number from 0 to 1e9")
    if found > 1e9:
        raise refuse(owner, "n", "a number from 0 to 1e9", value)
    return found


def material(owner: str, k_a: Any, k_d: Any, k_s: Any, n: Any) -> Material:
    """The coefficients, each a number or one per channel, and the exponent."""
    ka, kd, ks = (coefficient(owner, name, value) for name, value in (("k_a", k_a), ("k_d", k_d), ("k_s", k_s)))
    return Material(ka, kd, ks, exponent(owner, n))


def _per_light(owner: str, name: str, value: Any) -> Array:
    """(L, 3) float64 from an array of L rows or a list of L 3-vectors; without any element L is 0."""
    if isinstance(value, (list, tuple)):
        listed = [vector(owner, f"{name}[{k}]", item) for k, item in enumerate(value)]
        return np.array(listed).reshape(-1, 3)
    found = array(owner, name, value)
    if found.size == 0:
        return np.zeros((0, 3))
    if found.ndim == 3 and found.shape[1:] in ((1, 3), (3, 1)):
        found = found.reshape(-1, 3)
    if found.ndim != 2 or found.shape[1] != 3:
        raise refuse(owner, name, "an array of shape (L, 3), rows are lights, or a list of 3-vectors", found)
    return rows(owner, name, found, 3).astype(np.float64)


def lights(owner: str, l_pos: Any, l_int: Any) -> tuple[Array, Array]:
    """Positions and intensities, (L, 3) float64 each."""
    positions, intensities = _per_light(owner, "l_pos", l_pos), _per_light(owner, "l_int", l_int)
    if len(positions) != len(intensities):
        raise refuse(owner, "l_int", f"one row per light of l_pos ({len(positions)})", f"{len(intensities)} rows")
    return positions, intensities


def corners(owner: str, name: str, value: Any, shape: tuple[int, int]) -> Array:
    """A small float64 array of exactly this shape, finite."""
    found = array(owner, name, value)
    if found.shape != shape:
        raise refuse(owner, name, f"an array of shape {shape}", found)
    found = found.astype(np.float64)
    if not np.isfinite(found).all():
        raise refuse(owner, name, "finite numbers", found.tolist())
    return found


def _all_finite(owner: str, name: str, found: Array) -> None:
    """Raises InputError for NaN or infinity in a large array."""
    with np.errstate(over="ignore", invalid="ignore"):
        # The sum is cheap, and finite unless something is not or it overflows.
        if found.dtype.kind == "f" and not np.isfinite(found.sum()) and not np.isfinite(found).all():
            raise refuse(owner, name, "finite numbers", "NaN or infinity")


def texel_array(owner: str, value: Any) -> Array:
    """`texture_map` as a contiguous array of its own type."""
    found = array(owner, "texture_map", value)
    if found.ndim != 3 or found.shape[2] != 3 or 0 in found.shape:
        raise refuse(owner, "texture_map", "an array of shape (h, w, 3)", found)
    _all_finite(owner, "texture_map", found)
    return np.ascontiguousarray(found)


def texture(owner: str, image: Array) -> Texture:
    """The Texture of a `texel_array`, looked up as the course does."""
    try:
        return Texture(image, lookup="course")
    except InputError as error:
        raise InputError(str(error).replace("Texture: image", f"{owner}: texture_map", 1)) from None


def image(owner: str, value: Any) -> Array:
    """A copy of image X, (M, N, 3) float64."""
    found = array(owner, "X", value)
    if found.ndim != 3 or found.shape[2] != 3 or not 0 < min(found.shape) <= max(found.shape) <= MAX_RESOLUTION:
        raise refuse(owner, "X", f"an array of shape (M, N, 3) with M and N from 1 to {MAX_RESOLUTION}", found)
    _all_finite(owner, "X", found)
    return np.array(found, np.float64, order="C")
