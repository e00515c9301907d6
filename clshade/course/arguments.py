"""Checks of the arguments of the course's functions; they return what the rest of clshade works with.

Each error is an `InputError` of the form `function: argument: expected ..., found ...`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias, TypeVar, cast, get_args

import numpy as np

from ..base.arrays import Array, Floats
from ..base.spelling import hint
from ..base.validation import coefficient, value_error
from ..errors import InputError
from ..scene.camera import MAX_RESOLUTION
from ..scene.formats import course_npy as values
from ..scene.model import Material, Texture

Shader: TypeAlias = Literal["gouraud", "phong", "nolight"]
SHADERS: tuple[Shader, ...] = get_args(Shader)

_NAMES = {"verts": "verts", "colors": "verts_colors", "faces": "faces", "uvs": "uvs", "uv_faces": "uvs_faces"}

# Names of the arguments in other years' versions of the course.
_WORDS = {
    **dict.fromkeys(("vertsp", "verts2d", "vertices2d", "triangle", "canvas_coords"), "verts_p"),
    **dict.fromkeys(("vertsn", "normals", "vert_normals"), "verts_n"),
    **dict.fromkeys(("vertsc", "vcolors"), "verts_c"),
    **dict.fromkeys(("vert_colors", "colors", "vcolor"), "verts_colors"),
    **dict.fromkeys(("face_indices", "t_pos_idx", "faces_indices"), "faces"),
    **dict.fromkeys(("face_uv_indices", "uv_indices"), "uvs_faces"),
    **dict.fromkeys(("texture", "texture_image", "tex_map"), "texture_map"),
    **dict.fromkeys(("ka", "ambient"), "k_a"),
    **dict.fromkeys(("kd", "diffuse"), "k_d"),
    **dict.fromkeys(("ks", "specular"), "k_s"),
    **dict.fromkeys(("n_phong", "phong_n", "exponent", "shininess"), "n"),
    **dict.fromkeys(("light_pos", "light_positions", "lpos"), "l_pos"),
    **dict.fromkeys(("light_int", "light_intensities", "lint"), "l_int"),
    **dict.fromkeys(("cam_eye", "camera_position"), "eye"),
    **dict.fromkeys(("cam_lookat", "target"), "lookat"),
    **dict.fromkeys(("cam_up",), "up"),
    **dict.fromkeys(("img", "image", "canvas"), "X"),
}

Function = TypeVar("Function", bound=Callable[..., Any])


class CallError(InputError, TypeError):
    """Arguments that do not fit a function's signature: too few, too many, or with other names."""


def fitting(function: Function) -> Function:
    """Decorate a function so that a call that does not fit its signature raises a CallError, which lists the expected
    arguments in order and what was found in place of each."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def called(*given: Any, **named: Any) -> Any:
        try:
            return function(*given, **named)
        except TypeError:
            _check_call(function.__name__, signature, given, named)
            raise

    return cast(Function, called)


def _check_call(owner: str, signature: inspect.Signature, given: tuple[Any, ...], named: Mapping[str, Any]) -> None:
    """Raise CallError if the arguments do not fit the signature."""
    names = list(signature.parameters)
    try:
        bound = signature.bind_partial(*given, **named).arguments
        missing = [name for name in names if name not in bound]
        if not missing:
            return
        reason = f"missing {', '.join(missing)}"
    except TypeError as error:
        unknown = next((name for name in named if name not in names), None)
        reason = f"{error}{hint(unknown, names, _WORDS)}"
    places = [*names, *("one more" for _ in given[len(names) :])]
    found = [f"{name} = {_kind(value)}" for name, value in zip(places, given, strict=False)]
    found += [f"{name} = {_kind(value)}" for name, value in named.items()]
    if any(_is_object(value) for value in (*given, *named.values())):
        reason += "; a material or a light is given by its numbers, not as an object"
    expected = f"{', '.join(names)}, in this order"
    raise CallError(f"{owner}: arguments: expected {expected}, found {', '.join(found) or 'none'}: {reason}") from None


def _is_object(value: Any) -> bool:
    """Return whether a value, or an item of it, has attributes, as materials and lights do."""
    if isinstance(value, (list, tuple)):
        return any(map(_is_object, value))
    return hasattr(value, "__dict__") and not isinstance(value, (np.ndarray, type))


def _kind(value: Any) -> str:
    """Describe a value in a few words."""
    if isinstance(value, np.ndarray):
        return f"array {value.shape}"
    if isinstance(value, (list, tuple)):
        kinds = dict.fromkeys(type(each).__name__ for each in value)
        return f"{type(value).__name__} of {len(value)}" + (f" {next(iter(kinds))}" if len(kinds) == 1 else "")
    if isinstance(value, (int, float, np.number, str)):
        text = repr(value)
        return text if len(text) <= 20 and text.isprintable() else type(value).__name__
    return type(value).__name__


def array(owner: str, name: str, value: Any) -> Array:
    """Return an array of reals. Raises InputError for text, objects, complex numbers and ragged rows."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        found = np.asarray(None)
    if found.dtype.kind not in "fiub":
        raise value_error(owner, name, "an array of numbers", value)
    return found


def mesh(owner: str, **given: Any) -> dict[str, Any]:
    """Return the arrays of a Mesh by field, from 3xN or Nx3 ones: `verts`, `faces` and, if given, `colors`, `uvs`..."""
    return values.mesh_fields(
        owner, _NAMES, {field: array(owner, _NAMES[field], value) for field, value in given.items()}
    )


def material(owner: str, k_a: Any, k_d: Any, k_s: Any, n: Any) -> Material:
    """Return a Material of the coefficients, each a number or one per channel, and the exponent."""
    ka, kd, ks = (coefficient(owner, name, value) for name, value in (("k_a", k_a), ("k_d", k_d), ("k_s", k_s)))
    return Material(ka, kd, ks, values.exponent(owner, n))


def lights(owner: str, l_pos: Any, l_int: Any) -> tuple[Floats, Floats]:
    """Return positions and intensities, (L, 3) float64 each."""
    return values.lights(owner, ("l_pos", "l_int"), l_pos, l_int)


def corners(owner: str, name: str, value: Any, shape: tuple[int, int]) -> Floats:
    """Return a finite float64 array of exactly this shape."""
    found = array(owner, name, value)
    if found.shape != shape:
        raise value_error(owner, name, f"an array of shape {shape}", found)
    found = found.astype(np.float64)
    if not np.isfinite(found).all():
        raise value_error(owner, name, "finite numbers", found.tolist())
    return found


def _all_finite(owner: str, name: str, found: Array) -> None:
    """Raise InputError for NaN or infinity in a large array."""
    with np.errstate(over="ignore", invalid="ignore"):
        # The sum is cheap, and finite unless an element is not or it overflows.
        if found.dtype.kind == "f" and not np.isfinite(found.sum()) and not np.isfinite(found).all():
            raise value_error(owner, name, "finite numbers", "NaN or infinity")


def texel_array(owner: str, value: Any) -> Array:
    """Return `texture_map` as a contiguous array of its own type."""
    found = array(owner, "texture_map", value)
    if found.ndim != 3 or found.shape[2] != 3 or 0 in found.shape:
        raise value_error(owner, "texture_map", "an array of shape (h, w, 3)", found)
    _all_finite(owner, "texture_map", found)
    return np.ascontiguousarray(found)


def texture(owner: str, image: Array) -> Texture:
    """Return the Texture of a `texel_array`, with the course's lookup."""
    try:
        return Texture(image, lookup="course")
    except InputError as error:
        raise InputError(str(error).replace("Texture: image", f"{owner}: texture_map", 1)) from None


def image(owner: str, value: Any) -> Floats:
    """Return a copy of image X, (M, N, 3) float64."""
    found = array(owner, "X", value)
    if found.ndim != 3 or found.shape[2] != 3 or not 0 < min(found.shape) <= max(found.shape) <= MAX_RESOLUTION:
        raise value_error(owner, "X", f"an array of shape (M, N, 3) with M and N from 1 to {MAX_RESOLUTION}", found)
    _all_finite(owner, "X", found)
    return np.array(found, np.float64, order="C")
