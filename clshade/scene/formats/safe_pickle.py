"""The .npy container of course scenes: a pickled dict in a 0-d object array, read without executing it.

`inert_pickle` gives plain objects and inert records; these become arrays here, under limits, for the requested fields.
A value that a file refers to many times is counted each time: time and memory stay proportional to the file's size.
"""

from __future__ import annotations

import ast
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error, quoted
from .inert_pickle import PickledArray, PickledDtype, Refused, unpickle

MAX_HEADER = 4096  # bytes; a course file's header has 118
MAX_LISTED = 1 << 20  # numbers in all lists
MAX_REPEATED = 1 << 18  # numbers in all lists beyond one per byte of the file, for values referred to repeatedly
_MAX_PART = 16  # numbers in an array inside a list
_MAX_DEPTH = 3
_DTYPES = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")


class Content:
    """The dict in a course file: `in` tests for a key, `value` returns a field."""

    def __init__(self, fields: dict[str, Any], owner: str, size: int) -> None:
        self._fields, self._owner = fields, owner
        self._left = min(MAX_LISTED, size + MAX_REPEATED)  # numbers that lists may still hold

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def value(self, name: str) -> Any:
        """Return a field as an array, a number or None; lists become arrays.

        Raises InputError for everything else: text, dicts, object arrays, ragged or very long lists.
        """
        try:
            return self._value(self._fields[name])
        except Refused as refused:
            raise file_error(self._owner, name, "a number or an array of numbers", str(refused)) from None

    def _value(self, packed: Any) -> Any:
        if not isinstance(packed, (list, tuple)):
            return _single(packed)
        plain = self._listed(packed, _MAX_DEPTH, {})
        try:
            array = np.array(plain)
        except ValueError:
            raise Refused("a list whose parts differ in shape") from None
        if array.dtype.kind not in "fiub":
            raise Refused("a list of something else")
        return array

    def _listed(self, packed: Any, depth: int, made: dict[int, Any]) -> Any:
        """Return a list of numbers, arrays of a few numbers and such lists, with arrays in place of their records.

        made: converted parts by identity of their records: a file may refer to an array a million times.
        """
        if not isinstance(packed, (list, tuple)):
            part = made.get(id(packed))
            if part is None:
                part = made[id(packed)] = _single(packed)
            size = part.size if isinstance(part, np.ndarray) else 1
            if size > _MAX_PART:
                raise Refused(f"a list with an array of {size} numbers")
            if part is None:
                raise Refused("a list with None")
            self._left -= max(size, 1)
            if self._left < 0:
                raise Refused("a list that is too long")
            return part
        if depth == 0:
            raise Refused("a list that is nested too deep")
        if len(packed) > self._left:
            raise Refused("a list that is too long")
        self._left -= 1
        return [self._listed(part, depth - 1, made) for part in packed]


def unpack(data: bytes, owner: str) -> Content:
    """Return the dict in a course file's bytes.

    Raises InputError unless the file is the pickle of a dict in a 0-d object array.
    """
    expected = "a dict of arrays and numbers, pickled by numpy.save"
    start = _header_end(data, owner)
    try:
        top = unpickle(data, start)
    except Refused as refused:
        raise file_error(owner, "pickle", expected, str(refused)) from None
    except Exception as error:  # a broken pickle raises exceptions of many types
        raise file_error(owner, "pickle", expected, quoted(str(error) or type(error).__name__)) from None
    content = None
    if isinstance(top, PickledArray) and top.state is not None and top.state[0] == ():
        content = top.state[3]
    if not isinstance(content, list) or len(content) != 1 or not isinstance(content[0], dict):
        raise file_error(owner, "pickle", expected, "something else")
    return Content(content[0], owner, len(data))


def _header_end(data: bytes, owner: str) -> int:
    """Return the end of the .npy header, which has to announce a 0-d object array."""
    expected = "a .npy file (a dict in a 0-d object array)"
    if data[:6] != b"\x93NUMPY" or len(data) < 12:
        raise file_error(owner, "header", expected, quoted(data[:8]))
    start = 10 if data[6] == 1 else 12
    end = start + int.from_bytes(data[8:start], "little")
    if data[6] not in (1, 2, 3) or end - start > MAX_HEADER or end > len(data):
        raise file_error(owner, "header", f"format 1, 2 or 3 and at most {MAX_HEADER} bytes", "something else")
    try:
        header = ast.literal_eval(data[start:end].decode("latin-1").strip())
        found = f"an array of shape {header['shape']!r} and type {header['descr']!r}"
        good = header["shape"] == () and header["descr"] in ("|O", "O")
    except Exception:  # literal_eval raises exceptions of many types
        good, found = False, quoted(data[start:end])
    if not good:
        raise file_error(owner, "header", expected, found if len(found) < 120 else quoted(found))
    return end


def _single(packed: Any) -> Any:
    """Return an array, a number or None: anything but a list."""
    if isinstance(packed, PickledArray):
        return _array(packed)
    if packed is None or isinstance(packed, (bool, float)):
        return packed
    if isinstance(packed, int):
        if abs(packed) >= 1 << 63:
            raise Refused("an integer beyond 64 bits")
        return packed
    if isinstance(packed, (str, bytes)):
        raise Refused(quoted(packed))
    raise Refused("a dict" if isinstance(packed, dict) else "a data type")


def _array(packed: PickledArray) -> Array:
    """Return the NumPy array, in native byte order, that a record describes; it may share the file's bytes."""
    if packed.state is None:
        raise Refused("an array without content")
    shape, dtype, fortran, data = packed.state
    if not isinstance(dtype, PickledDtype) or dtype.name not in _DTYPES or dtype.order not in ("<", ">", "|", "="):
        name = dtype.name if isinstance(dtype, PickledDtype) and isinstance(dtype.name, str) else "unknown"
        raise Refused(f"an array of type {quoted(name)}")
    if (
        not isinstance(shape, tuple)
        or len(shape) > 4
        or not all(isinstance(extent, int) and 0 <= extent < 1 << 48 for extent in shape)
    ):
        raise Refused("an array without a proper shape")
    kind = np.dtype(dtype.name).newbyteorder("=" if dtype.order == "|" else dtype.order)
    size = kind.itemsize
    for extent in shape:
        size *= extent
    if not isinstance(data, bytes) or len(data) != size:
        raise Refused(f"an array of shape {shape} with other than {size} bytes of data")
    try:
        array = np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
    except ValueError:
        raise Refused(f"an array of shape {shape}") from None
    return array.astype(kind.newbyteorder("="), copy=False)
