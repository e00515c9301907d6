"""The arguments of the course's functions, checked: what comes back is what the rest of clshade works with.

Every refusal is an `InputError` of the form `function: argument: expected ..., found ...`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import course_values as values
from .camera import MAX_RESOLUTION
from .errors import InputError
from .scene import Material, Texture
from .validation import Array, coefficient, refuse

_NAMES = {"verts": "verts", "colors": "verts_colors", "faces": "faces", "uvs": "uvs", "uv_faces": "uvs_faces"}


def array(owner: str, name: str, value: Any) -> Array:
    """An array of reals. Raises InputError for text, objects, complex numbers and rows of different lengths."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        found = np.asarray(None)
    if found.dtype.kind not in "fiub":
        raise refuse(owner, name, "an array of numbers", value)
    return found


def mesh(owner: str, **given: Any) -> dict[str, Any]:
    """The arrays of a Mesh by field, from 3xN or Nx3 ones: `verts`, `faces` and, where given, `colors`, `uvs`..."""
    return values.mesh_fields(
        owner, _NAMES, {field: array(owner, _NAMES[field], value) for field, value in given.items()}
    )


def material(owner: str, k_a: Any, k_d: Any, k_s: Any, n: Any) -> Material:
    """The coefficients, each a number or one per channel, and the exponent."""
    ka, kd, ks = (coefficient(owner, name, value) for name, value in (("k_a", k_a), ("k_d", k_d), ("k_s", k_s)))
    return Material(ka, kd, ks, values.exponent(owner, n))


def lights(owner: str, l_pos: Any, l_int: Any) -> tuple[Array, Array]:
    """Positions and intensities, (L, 3) float64 each."""
    return values.lights(owner, ("l_pos", "l_int"), l_pos, l_int)


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
