"""Checks of values from users: each returns the value in the form that is kept, or raises an InputError."""

from __future__ import annotations

import functools
import inspect
import math
import os
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ..errors import InputError
from .arrays import Array, Faces, Floats, Reals
from .spelling import hint

Function = TypeVar("Function", bound=Callable[..., Any])

_VECTOR_SHAPES = ((3,), (1, 3), (3, 1))


def _describe(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape} and type {value.dtype}"
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."


def value_error(owner: str, name: str, expected: str, found: Any, remark: str = "") -> InputError:
    """Build the error for a refused value: owner, field, expected, found, and a remark on what to write instead."""
    return InputError(f"{owner}: {name}: expected {expected}, found {_describe(found)}{remark}")


def choice(owner: str, name: str, value: Any, allowed: Iterable[str], **hints: Any) -> str:
    """Return one of the allowed texts; the error for another suggests the closest. hints: for `spelling.hint`."""
    allowed = tuple(allowed)
    if not isinstance(value, str) or value not in allowed:
        raise value_error(owner, name, "one of " + ", ".join(allowed), value, hint(value, allowed, **hints))
    return value


def known(owner: str, names: Iterable[str], allowed: Iterable[str], **hints: Any) -> None:
    """Raise InputError for the first keyword not allowed, suggesting the closest. hints: for `spelling.hint`."""
    allowed = tuple(allowed)
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            field = name if isinstance(name, str) else _describe(name)
            names_and_hint = f"{', '.join(allowed)}, found no such field{hint(name, allowed, **hints)}"
            raise InputError(f"{owner}: {field}: expected one of {names_and_hint}")


def text(owner: str, name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise value_error(owner, name, "a text", value)
    return value


def path(owner: str, name: str, value: Any) -> str:
    """Return a file name, text or a path object, as text. Refuses bytes and open files."""
    if not isinstance(value, (str, os.PathLike)) or isinstance(os.fspath(value), bytes):
        raise value_error(owner, name, "a path (text)", value)
    return os.fspath(value)


def flag(owner: str, name: str, value: Any) -> bool:
    """Return a bool of Python or NumPy as bool; any other value, such as "no" or 0, is ambiguous and refused."""
    if not isinstance(value, (bool, np.bool_)):
        raise value_error(owner, name, "True or False", value)
    return bool(value)


def keywords(owner: str, name: str, value: Any, allowed: Iterable[str]) -> dict[str, Any]:
    """Return a mapping whose names are all allowed as a dict of its own; an empty one for None."""
    value = {} if value is None else value
    if not isinstance(value, Mapping):
        raise value_error(owner, name, "a dict", value)
    known(f"{owner}: {name}", value, allowed)
    return dict(value)


def count_or_all(owner: str, name: str, value: Any, of: int) -> int:
    """Return a whole number from 1 on, at most `of`, which "all" means."""
    if isinstance(value, str) and value == "all":
        return of
    return min(integer(owner, name, value, 1, 2**63, 'a whole number from 1 on, or "all"'), of)


def arguments(**checks: type | Callable[[str, str, Any], Any]) -> Callable[[Function], Function]:
    """Decorate a public function whose arguments are checked before it runs: each is of a class, or becomes what a check
    of this module makes of it. One that is its default is left as it is."""

    def decorate(function: Function) -> Function:
        signature, owner = inspect.signature(function), function.__qualname__.removesuffix(".__init__")

        @functools.wraps(function)
        def checked(*args: Any, **named: Any) -> Any:
            bound = signature.bind(*args, **named)
            for name, check in checks.items():
                value = bound.arguments.get(name, default := signature.parameters[name].default)
                if value is default:
                    continue
                if not isinstance(check, type):
                    bound.arguments[name] = check(owner, name, value)
                elif not isinstance(value, check):
                    raise value_error(owner, name, f"a {check.__name__}", value)
            return function(*bound.args, **bound.kwargs)

        return checked  # type: ignore[return-value]

    return decorate


def sequence(value: Any) -> tuple[Any, ...] | None:
    """Return the items of an iterable as a tuple, or None for anything else."""
    try:
        return tuple(value)
    except TypeError:
        return None


def items(
    owner: str, name: str, value: Any, expected: str = "a sequence", count: int | None = None, kinds: Any = object
) -> tuple[Any, ...]:
    """Return the items of an iterable other than a text as a tuple. count: their number. kinds: their class or classes."""
    values = None if isinstance(value, str) else sequence(value)
    if values is None or count not in (None, len(values)):
        raise value_error(owner, name, expected, value)
    for item in values:
        if not isinstance(item, kinds):
            raise value_error(owner, name, expected, item)
    return values


def floats(owner: str, name: str, value: Any, expected: str) -> Array:
    try:
        array = value if type(value) is np.ndarray else np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
    except (TypeError, ValueError):
        raise value_error(owner, name, expected, value) from None
    return array


def vector(owner: str, name: str, value: Any, *, finite: bool = True) -> Floats:
    """Return a 3-vector given as (3,), (1,3) or (3,1), as a read-only (3,) float64 array."""
    expected = "three finite numbers" if finite else "three numbers"
    array = floats(owner, name, value, expected)
    if array.shape not in _VECTOR_SHAPES:
        raise value_error(owner, name, expected, value)
    array = array.astype(np.float64).reshape(3)
    if finite and not all(map(math.isfinite, array.tolist())):
        raise value_error(owner, name, expected, array.tolist())
    return read_only(array)


def coefficient(owner: str, name: str, value: Any) -> Floats:
    """Return a scalar or 3-vector coefficient as a read-only (3,) float64 array (one value per channel)."""
    expected = "a number or three finite numbers"
    array = floats(owner, name, value, expected)
    if array.dtype.kind == "b" or (array.ndim and array.shape not in _VECTOR_SHAPES):
        raise value_error(owner, name, expected, value)
    return vector(owner, name, array if array.ndim else np.full(3, array.item()))


def limits_of(above: float = -math.inf, least: float = -math.inf, most: float = math.inf) -> str:
    """Return the limits of a number in words, with a blank before them; nothing if there are none."""
    if most < math.inf:
        return f" above {above:g}, at most {most:g}" if above > -math.inf else f" from {least:g} to {most:g}"
    return (f" above {above:g}" if above > -math.inf else "") + (f" of at least {least:g}" if least > -math.inf else "")


def one_of(owner: str, name: str, value: Any, numbers: tuple[int, ...]) -> int:
    result = integer(owner, name, value, min(numbers), max(numbers))
    if result not in numbers:
        raise value_error(owner, name, " or ".join(map(str, numbers)), value)
    return result


def number(
    owner: str,
    name: str,
    value: Any,
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
    expected: str = "",
) -> float:
    """Return a finite real number above `above`, from `least` to `most`, as a float; refuses arrays and bools."""
    if type(value) is float and above < value and least <= value <= most and math.isfinite(value):
        return value  # at once: materials by the thousand have ten numbers
    expected = expected or f"a {'finite ' if most == math.inf else ''}number{limits_of(above, least, most)}"
    array = floats(owner, name, value, expected)
    result = math.nan if array.ndim or array.dtype.kind == "b" else float(array.item())
    if not math.isfinite(result) or result <= above or not least <= result <= most:
        raise value_error(owner, name, expected, value)
    return result


fraction = partial(number, least=0.0, most=1.0)


def instance(owner: str, name: str, value: Any, kind: type) -> Any:
    """Return an instance of a class, or None."""
    if value is not None and not isinstance(value, kind):
        raise value_error(owner, name, f"a {kind.__name__} or None", value)
    return value


def integer(owner: str, name: str, value: Any, least: int, most: int, expected: str = "") -> int:
    expected = expected or f"a whole number from {least} to {most}"
    array = floats(owner, name, value, expected)
    result = math.nan if array.ndim or array.dtype.kind == "b" else array.item()
    if not math.isfinite(result) or result != int(result) or not least <= result <= most:
        raise value_error(owner, name, expected, value)
    return int(result)


def rows(owner: str, name: str, value: Any, width: int, *, finite: bool = True, least: int = 0) -> Reals:
    """Return a (K, width) array of reals in its own precision (float32 or float64), contiguous and read-only."""
    expected = f"an array of shape (K, {width}) of {'finite ' if finite else ''}numbers"
    array = floats(owner, name, value, expected)
    if array.ndim != 2 or array.shape[1] != width or array.shape[0] < least:
        raise value_error(owner, name, expected + (f" with K of at least {least}" if least else ""), array)
    array = np.ascontiguousarray(array, None if array.dtype in (np.float32, np.float64) else np.float64)
    if finite and not np.isfinite(array).all():
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise value_error(owner, name, "finite numbers", f"{array[bad].tolist()} in row {bad}")
    return read_only(array.view())


def indices(owner: str, name: str, value: Any, count: int) -> Faces:
    """Return an (F, 3) array of indices below `count`, range-checked before it is narrowed to int32; read-only."""
    count = min(count, 1 << 31)
    expected = "an array of shape (F, 3) of whole numbers"
    array = floats(owner, name, value, expected)
    if array.size == 0:
        array = np.zeros((0, 3), np.int32)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise value_error(owner, name, expected, value)
    if array.size and (array.min() < 0 or array.max() >= count):
        face, corner = np.argwhere((array < 0) | (array >= count))[0]
        raise value_error(owner, name, f"indices from 0 to {count - 1}", f"{array[face, corner]} in face {face}")
    return read_only(np.ascontiguousarray(array, np.int32).view())


def read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array
