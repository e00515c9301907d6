"""Checks of the arguments of the course's functions; they return what the rest of clshade works with.

Each error is an `InputError` of the form `function: argument: expected ..., found ...`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal, TypeAlias, TypeVar, cast, get_args

import numpy as np

from ..base.arrays import Array, Floats
from ..base.spelling import hint
from ..base.validation import choice, coefficient, value_error, vector
from ..errors import InputError
from ..scene.camera import MAX_RESOLUTION
from ..scene.formats import course_npy
from ..scene.model import Texture

Shader: TypeAlias = Literal["gouraud", "phong", "nolight"]

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
Check: TypeAlias = Callable[[str, str, Any], Any]  # function, argument and value -> the value that is kept


class CallError(InputError, TypeError):
    """Arguments that do not fit a function's signature: too few, too many, or with other names."""


def fitting(function: Function) -> Function:
    """Decorate a function so that a call that does not fit its signature raises a CallError, which lists the expected
    arguments in order and what was found in place of each."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def called(*positional: Any, **keywords: Any) -> Any:
        try:
            return function(*positional, **keywords)
        except TypeError:
            _check_call(function.__name__, signature, positional, keywords)
            raise

    return cast(Function, called)


def _check_call(
    owner: str, signature: inspect.Signature, positional: tuple[Any, ...], keywords: Mapping[str, Any]
) -> None:
    """Raise CallError if the arguments do not fit the signature."""
    names = list(signature.parameters)
    try:
        bound = signature.bind_partial(*positional, **keywords).arguments
        missing = [name for name in names if name not in bound]
        if not missing:
            return
        reason = f"missing {', '.join(missing)}"
    except TypeError as error:
        unknown = next((name for name in keywords if name not in names), None)
        reason = f"{error}{hint(unknown, names, _WORDS)}"
    places = [*names, *("one more" for _ in positional[len(names) :])]
    arguments = [f"{name} = {_kind(value)}" for name, value in zip(places, positional, strict=False)]
    arguments += [f"{name} = {_kind(value)}" for name, value in keywords.items()]
    if any(_is_object(value) for value in (*positional, *keywords.values())):
        reason += "; a material or a light is given by its numbers, not as an object"
    expected = f"{', '.join(names)}, in this order"
    found_words = ", ".join(arguments) or "none"
    raise CallError(f"{owner}: arguments: expected {expected}, found {found_words}: {reason}") from None


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
        kinds = dict.fromkeys(type(item).__name__ for item in value)
        return f"{type(value).__name__} of {len(value)}" + (f" {next(iter(kinds))}" if len(kinds) == 1 else "")
    if isinstance(value, (int, float, np.number, str)):
        text = repr(value)
        return text if len(text) <= 20 and text.isprintable() else type(value).__name__
    return type(value).__name__


def array(owner: str, name: str, value: Any) -> Array:
    """Return an array of reals. Raises InputError for text, objects, complex numbers and ragged rows."""
    try:
        numbers = np.asarray(value)
    except (TypeError, ValueError):
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "fiub":
        raise value_error(owner, name, "an array of numbers", value)
    return numbers


def values(owner: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a function by name, each as its check makes it, l_pos and l_int both (L, 3) float64. Those of
    meshes and cameras, which are judged together, are as they were."""
    checked = {
        name: _CHECKS[name](owner, name, value) if name in _CHECKS else value for name, value in arguments.items()
    }
    if "l_pos" in checked:
        lights = course_npy.lights(owner, ("l_pos", "l_int"), checked["l_pos"], checked["l_int"])
        checked["l_pos"], checked["l_int"] = lights
    return checked


def mesh(owner: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays of a Mesh by field, from 3xN or Nx3 ones: `verts`, `faces`, and `colors` or `uvs` and `uv_faces`."""
    names = {field: name for field, name in _NAMES.items() if name in arguments}
    arrays = {field: array(owner, name, arguments[name]) for field, name in names.items()}
    return course_npy.mesh_fields(owner, names, arrays)


def texture(owner: str, image: Array) -> Texture:
    """Return the Texture of checked texels, with the course's lookup."""
    try:
        return Texture(image, lookup="course")
    except InputError as error:
        raise InputError(str(error).replace("Texture: image", f"{owner}: texture_map", 1)) from None


def _array_of(form: str, fits: Callable[[tuple[int, ...]], bool], convert: Callable[[Array], Array]) -> Check:
    """Return a check of finite numbers. form: their shape in words; fits: whether a shape is that."""

    def check(owner: str, name: str, value: Any) -> Array:
        numbers = array(owner, name, value)
        if not fits(numbers.shape):
            raise value_error(owner, name, form, numbers if numbers.ndim > 1 else value)
        with np.errstate(over="ignore", invalid="ignore"):
            # The sum is cheap, and finite unless an element is not or it overflows.
            if numbers.dtype.kind == "f" and not np.isfinite(numbers.sum()) and not np.isfinite(numbers).all():
                content = numbers.tolist() if numbers.size < 10 else "NaN or infinity"
                raise value_error(owner, name, "finite numbers", content)
        return convert(numbers)

    return check


def _floats(numbers: Array) -> Floats:
    return np.array(numbers, np.float64, order="C")


def _is_image(shape: tuple[int, ...]) -> bool:
    return len(shape) == 3 and shape[2] == 3 and 0 not in shape


_MATRIX = _array_of("an array of shape (3, 3)", ((3, 3),).__contains__, _floats)
_CHECKS: dict[str, Check] = {
    **dict.fromkeys(("point", "normal", "color", "cam_pos", "bcoords"), vector),
    **dict.fromkeys(("k_a", "k_d", "k_s", "l_amb", "light_amb", "bg_color"), coefficient),
    "n": lambda owner, _, value: course_npy.exponent(owner, value),
    "shader": partial(choice, allowed=get_args(Shader)),
    "verts_p": _array_of("an array of shape (3, 2)", ((3, 2),).__contains__, _floats),
    **dict.fromkeys(("verts_n", "verts_c"), _MATRIX),
    "uv": _array_of("two finite numbers", ((2,), (1, 2), (2, 1)).__contains__, lambda uv: _floats(uv).reshape(1, 2)),
    "texture_map": _array_of("an array of shape (h, w, 3)", _is_image, np.ascontiguousarray),
    "X": _array_of(
        f"an array of shape (M, N, 3) with M and N from 1 to {MAX_RESOLUTION}",
        lambda shape: _is_image(shape) and max(shape) <= MAX_RESOLUTION,
        _floats,
    ),
}
