"""The .npy container of course scenes: a pickled dict in a 0-d object array, read without running what it says.

Three guards, each sufficient against code: only the opcodes that NumPy writes are admitted; the only names that can be
referred to are those of NumPy's arrays and data types; and these stand for inert records, of which arrays are made
afterwards, under limits. Nothing of NumPy is ever called with arguments out of the file.
"""

from __future__ import annotations

import ast
import io
import pickle
import pickletools
from typing import Any

import numpy as np

from .reading import complaint, quoted
from .validation import Array

MAX_OPCODES = 1 << 20
MAX_HEADER = 4096  # bytes; a course file's header has 118
MAX_LISTED = 1 << 20  # numbers in lists, per field
_MAX_PART = 16  # numbers in an array inside a list
_MAX_DEPTH = 3

_NAMES = {
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
}
_WRITTEN = (  # the opcodes that numpy.save writes with protocols 2 to 4
    "PROTO FRAME MEMOIZE STOP MARK BINGET LONG_BINGET BINPUT LONG_BINPUT GLOBAL STACK_GLOBAL REDUCE BUILD NONE NEWTRUE "
    "NEWFALSE BININT BININT1 BININT2 LONG1 BINFLOAT SHORT_BINUNICODE BINUNICODE SHORT_BINBYTES BINBYTES BINBYTES8 "
    "EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_LIST APPEND APPENDS EMPTY_DICT SETITEM SETITEMS"
)
_OPCODES = frozenset(_WRITTEN.split())
_DTYPES = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")


class _Refused(Exception):
    """What was found in the file and is not taken."""


class _Inert:
    """The base of what an admitted name stands for: no attributes, and no state unless the class takes one."""

    __slots__ = ()

    def __setstate__(self, state: Any) -> None:
        raise _Refused("a state for something that has none")


class _Array(_Inert):
    """A pickled array: its state (version, shape, dtype, whether Fortran order, data), not yet looked at."""

    __slots__ = ("state",)

    def __init__(self) -> None:
        self.state: Any = None

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) != 5 or self.state is not None:
            raise _Refused("an array's state of an unknown form")
        self.state = state[1:]


class _Dtype(_Inert):
    """A pickled data type: its name, such as `f4`, and its byte order."""

    __slots__ = ("name", "order")

    def __init__(self, name: Any) -> None:
        self.name, self.order = name, "="

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, tuple) or len(state) < 5 or any(part is not None for part in state[2:5]):
            raise _Refused("a structured data type")
        self.order = state[1]


class _Name(_Inert):
    """One of _NAMES."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *arguments: Any) -> _Inert:
        if self.name == "_reconstruct":
            return _Array()
        if self.name == "dtype" and arguments:
            return _Dtype(arguments[0])
        raise _Refused(f"a call of {self.name}")


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> _Name:
        if (module, name) not in _NAMES:
            raise _Refused(f"a reference to {quoted(f'{module}.{name}')}")
        return _Name(name)


def unpack(data: bytes, owner: str) -> dict[str, Any]:
    """The dict in a course file's bytes; its values are plain objects, lists and records for `value`.

    Raises InputError when the file is anything else than the pickle of a dict in a 0-d object array.
    """
    pickled = memoryview(data)[_header_end(data, owner) :].tobytes()
    expected = "a dict of arrays and numbers, pickled by numpy.save"
    try:
        _admit(pickled)
        top = _Unpickler(io.BytesIO(pickled), fix_imports=False).load()
    except _Refused as refused:
        raise complaint(owner, "pickle", expected, str(refused)) from None
    except Exception as error:  # a broken pickle raises anything at all
        raise complaint(owner, "pickle", expected, quoted(str(error) or type(error).__name__)) from None
    content = None
    if isinstance(top, _Array) and top.state is not None and top.state[0] == ():
        content = top.state[3]
    if not isinstance(content, list) or len(content) != 1 or not isinstance(content[0], dict):
        raise complaint(owner, "pickle", expected, "something else")
    return content[0]


def _header_end(data: bytes, owner: str) -> int:
    """Where the .npy header, which has to announce a 0-d object array, ends."""
    expected = "a .npy file (a dict in a 0-d object array)"
    if data[:6] != b"\x93NUMPY" or len(data) < 12:
        raise complaint(owner, "header", expected, quoted(data[:8]))
    start = 10 if data[6] == 1 else 12
    end = start + int.from_bytes(data[8:start], "little")
    if data[6] not in (1, 2, 3) or end - start > MAX_HEADER or end > len(data):
        raise complaint(owner, "header", f"format 1, 2 or 3 and at most {MAX_HEADER} bytes", "something else")
    try:
        header = ast.literal_eval(data[start:end].decode("latin-1").strip())
        found = f"an array of shape {header['shape']!r} and type {header['descr']!r}"
        good = header["shape"] == () and header["descr"] in ("|O", "O")
    except Exception:  # literal_eval raises many things
        good, found = False, quoted(data[start:end])
    if not good:
        raise complaint(owner, "header", expected, found if len(found) < 120 else quoted(found))
    return end


def _admit(pickled: bytes) -> None:
    """Check every opcode before anything is loaded: its kind, their number, and that the memo stays in proportion."""
    for count, (opcode, argument, _) in enumerate(pickletools.genops(pickled)):
        if opcode.name not in _OPCODES:
            raise _Refused(f"the pickle opcode {opcode.name}")
        if count >= MAX_OPCODES:
            raise _Refused(f"more than {MAX_OPCODES} opcodes")
        if opcode.name == "LONG_BINPUT" and int(argument or 0) > count:
            raise _Refused(f"the memo index {argument}")


def value(owner: str, name: str, packed: Any) -> Any:
    """A field of `unpack`'s dict as an array, a number or None: lists become arrays.

    Raises InputError for everything else: text, dicts, object arrays, ragged or very long lists.
    """
    try:
        return _value(packed)
    except _Refused as refused:
        raise complaint(owner, name, "a number or an array of numbers", str(refused)) from None


def _value(packed: Any) -> Any:
    if isinstance(packed, _Array):
        return _array(packed)
    if isinstance(packed, (list, tuple)):
        plain = _listed(packed, _MAX_DEPTH, [MAX_LISTED])
        try:
            array = np.array(plain)
        except ValueError:
            raise _Refused("a list whose parts differ in shape") from None
        if array.dtype.kind not in "fiub":
            raise _Refused("a list of something else")
        return array
    if packed is None or isinstance(packed, (bool, float)):
        return packed
    if isinstance(packed, int):
        if abs(packed) >= 1 << 63:
            raise _Refused("an integer beyond 64 bits")
        return packed
    raise _Refused(quoted(packed) if isinstance(packed, (str, bytes)) else f"a value of type {type(packed).__name__}")


def _listed(packed: Any, depth: int, budget: list[int]) -> Any:
    """A list of numbers, arrays of a few numbers and such lists, with arrays in place of their records."""
    if not isinstance(packed, (list, tuple)):
        part = _value(packed)
        if isinstance(part, np.ndarray) and part.size > _MAX_PART:
            raise _Refused(f"a list with an array of {part.size} numbers")
        if part is None:
            raise _Refused("a list with None")
        budget[0] -= np.size(part) + 1
        return part
    if depth == 0 or len(packed) > budget[0]:
        raise _Refused("a list that is nested too deep" if depth == 0 else "a list that is too long")
    budget[0] -= 1
    return [_listed(part, depth - 1, budget) for part in packed]


def _array(packed: _Array) -> Array:
    """The NumPy array, in native byte order, that a record describes; it may share the file's bytes."""
    if packed.state is None:
        raise _Refused("an array without content")
    shape, dtype, fortran, data = packed.state
    if not isinstance(dtype, _Dtype) or dtype.name not in _DTYPES or dtype.order not in ("<", ">", "|", "="):
        name = dtype.name if isinstance(dtype, _Dtype) and isinstance(dtype.name, str) else "unknown"
        raise _Refused(f"an array of type {quoted(name)}")
    if (
        not isinstance(shape, tuple)
        or len(shape) > 4
        or not all(isinstance(extent, int) and 0 <= extent < 1 << 48 for extent in shape)
    ):
        raise _Refused("an array without a proper shape")
    kind = np.dtype(dtype.name).newbyteorder("=" if dtype.order == "|" else dtype.order)
    size = kind.itemsize
    for extent in shape:
        size *= extent
    if not isinstance(data, bytes) or len(data) != size:
        raise _Refused(f"an array of shape {shape} with other than {size} bytes of data")
    try:
        array = np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
    except ValueError:
        raise _Refused(f"an array of shape {shape}") from None
    return array.astype(kind.newbyteorder("="), copy=False)
