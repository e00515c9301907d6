"""The .npy container of course scenes: a pickled dict in a 0-d object array, read without executing it.

The standard library's interpreter in Python, which Ctrl-C interrupts, reads the opcodes that NumPy writes (protocols 3 and
4), and no others. The only names that a pickle can refer to are those of NumPy's arrays and data types, which stand for
records here: nothing of NumPy is called.

With the memo a few bytes can describe a tree of 2^60 leaves, so no value is hashed, compared, copied or printed as a whole;
keys of dicts are short text. Records become arrays under limits, for the requested fields. A value that a file refers to
many times is counted each time: time and memory stay proportional to the file's size.
"""

from __future__ import annotations

import ast
import gc
import io
import math
import pickle
import pickletools
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error, quoted

MAX_OPCODES = 1 << 20
MAX_KEY = 64  # characters of a dict's key
MAX_ARGUMENTS = 8  # of a call and in a state; NumPy uses up to 8
MAX_HEADER = 4096  # bytes; a course file's header has 118
MAX_LISTED = 1 << 20  # numbers in all lists
MAX_REPEATED = 1 << 18  # numbers in all lists beyond one per byte of the file, for values referred to repeatedly
_NUMBERS = "a number or an array of numbers"
_MAX_PART = 16  # numbers in an array inside a list
_MAX_DEPTH = 3
_DTYPES = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")


class Refused(Exception):
    """Content of the file that is not accepted; the message says what was found."""


@contextmanager
def paused_collection() -> Iterator[None]:
    """Pause the cyclic garbage collector, which a million small records would keep busy in vain."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@dataclass(slots=True, eq=False, repr=False)
class PickledArray:
    """An array. state: (shape, dtype, whether Fortran order, data), unchecked."""

    state: Any = None


@dataclass(slots=True, eq=False, repr=False)
class PickledDtype:
    """A data type, unchecked. name: such as `f4`."""

    name: Any
    order: Any = "="


# What pickles may refer to, and what stands for it.
_NAMES: dict[tuple[str, str], Any] = {
    ("numpy.core.multiarray", "_reconstruct"): PickledArray,
    ("numpy._core.multiarray", "_reconstruct"): PickledArray,
    ("numpy", "ndarray"): None,
    ("numpy", "dtype"): PickledDtype,
}
_ACCEPTED = (
    "PROTO FRAME STOP MARK NONE NEWTRUE NEWFALSE BININT BININT1 BININT2 LONG1 BINFLOAT SHORT_BINUNICODE BINUNICODE "
    "SHORT_BINBYTES BINBYTES BINBYTES8 EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 EMPTY_LIST EMPTY_DICT BINPUT LONG_BINPUT "
    "MEMOIZE BINGET LONG_BINGET GLOBAL STACK_GLOBAL"
)


class _Steps:
    """The functions of the accepted opcodes, of which MAX_OPCODES may be looked up."""

    left = MAX_OPCODES

    def __getitem__(self, code: int) -> Any:
        self.left -= 1
        if self.left < 0:
            raise Refused(f"more than {MAX_OPCODES} opcodes")
        if code not in _STEPS:
            names = {ord(opcode.code): opcode.name for opcode in pickletools.opcodes}
            raise Refused(f"the pickle opcode {names.get(code, f'{code:#04x}')}")
        return _STEPS[code]


class _Unpickler(pickle._Unpickler):
    """An unpickler that creates records, and checks what others hash, call or grow."""

    stack: list[Any]

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _NAMES:
            raise Refused(f"a reference to {quoted(f'{module}.{name}')}")
        return _NAMES[module, name]

    def append_items(self, items: list[Any]) -> None:
        if not isinstance(self.stack[-1], list):
            raise Refused("items for what is no list")
        self.stack[-1].extend(items)

    def set_items(self, items: list[Any]) -> None:
        # Keys are checked before they are hashed: hashing a nested tuple may take forever, and integers can be chosen such
        # that all of them collide. Text cannot, see PYTHONHASHSEED.
        changed = self.stack[-1]
        if not isinstance(changed, dict) or len(items) % 2:
            raise Refused("items for what is no dict")
        for key, value in zip(items[::2], items[1::2], strict=True):
            if not isinstance(key, str) or len(key) > MAX_KEY:
                raise Refused(f"a key other than text of at most {MAX_KEY} characters")
            changed[key] = value

    def call(self) -> None:
        arguments, function = self.stack.pop(), self.stack.pop()
        good = isinstance(arguments, tuple) and len(arguments) <= MAX_ARGUMENTS
        if good and function is PickledArray:
            self.stack.append(PickledArray())
        elif good and function is PickledDtype and arguments:
            self.stack.append(PickledDtype(arguments[0]))
        else:
            raise Refused("a call of something other than NumPy's functions")

    def build(self) -> None:
        """Set the state of an array, (version, shape, dtype, whether Fortran order, data), or of a data type, (version,
        byte order, parts ...), of which a plain one has no parts."""
        state, built = self.stack.pop(), self.stack[-1]
        if not isinstance(state, tuple) or not 5 <= len(state) <= MAX_ARGUMENTS:
            raise Refused("a state of an unknown form")
        if isinstance(built, PickledArray) and built.state is None and len(state) == 5:
            built.state = state[1:]
        elif isinstance(built, PickledDtype) and all(part is None for part in state[2:5]):
            built.order = state[1]
        else:
            raise Refused("a structured data type" if isinstance(built, PickledDtype) else "a state of an unknown form")


_STEPS: dict[int, Any] = {
    **{code: pickle._Unpickler.dispatch[code] for code in (getattr(pickle, name)[0] for name in _ACCEPTED.split())},
    pickle.APPEND[0]: lambda machine: machine.append_items([machine.stack.pop()]),
    pickle.APPENDS[0]: lambda machine: machine.append_items(machine.pop_mark()),
    pickle.SETITEM[0]: lambda machine: machine.set_items([machine.stack.pop(), machine.stack.pop()][::-1]),
    pickle.SETITEMS[0]: lambda machine: machine.set_items(machine.pop_mark()),
    pickle.REDUCE[0]: _Unpickler.call,
    pickle.BUILD[0]: _Unpickler.build,
}


def unpickle(data: bytes, start: int = 0) -> Any:
    """Return the value of the pickle from byte `start` on: built-in values, PickledArray and PickledDtype, nested and shared
    in any way, including cycles.

    Raises Refused for content that NumPy would not write, and exceptions of any type for damaged data.
    """
    file = io.BytesIO(data)
    file.seek(start)
    machine: Any = _Unpickler(file)
    machine.dispatch = _Steps()
    return machine.load()


class Content:
    """The dict in a course file: `in` tests for a key, `value` returns a field."""

    def __init__(self, fields: dict[str, Any], owner: str, size: int) -> None:
        self._fields, self._owner = fields, owner
        self._left = min(MAX_LISTED, size + MAX_REPEATED)  # numbers that lists may still hold

    def __contains__(self, name: str) -> bool:
        return name in self._fields

    def value(self, name: str) -> Any:
        """Return a field as an array, a number or None; lists become arrays.

        Raises InputError for a missing key, text, dicts, object arrays, ragged or very long lists.
        """
        if name not in self._fields:
            raise file_error(self._owner, name, "this key", "none")
        packed = self._fields[name]
        try:
            if not isinstance(packed, (list, tuple)):
                return _single(packed)
            array = np.array(self._listed(packed, _MAX_DEPTH, {}))
            if array.dtype.kind not in "fiub":
                raise Refused("a list of something else")
            return array
        except ValueError:
            raise file_error(self._owner, name, _NUMBERS, "a list whose parts differ in shape") from None
        except Refused as refused:
            raise file_error(self._owner, name, _NUMBERS, str(refused)) from None

    def _listed(self, packed: Any, depth: int, cache: dict[int, Any]) -> Any:
        """Return a list of numbers, arrays of a few numbers and such lists, with arrays in place of their records.

        cache: converted parts by identity of their records: a file may refer to an array a million times.
        """
        if isinstance(packed, (list, tuple)):
            if depth == 0:
                raise Refused("a list that is nested too deep")
            if len(packed) > self._left:
                raise Refused("a list that is too long")
            self._left -= 1
            return [self._listed(part, depth - 1, cache) for part in packed]
        part = cache.get(id(packed))
        if part is None:
            part = cache[id(packed)] = _single(packed)
        size = part.size if isinstance(part, np.ndarray) else 1
        if part is None or size > _MAX_PART:
            raise Refused("a list with None" if part is None else f"a list with an array of {size} numbers")
        self._left -= max(size, 1)
        if self._left < 0:
            raise Refused("a list that is too long")
        return part


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
    found = quoted(data[start:end])
    with suppress(Exception):  # literal_eval raises exceptions of many types
        header = ast.literal_eval(data[start:end].decode("latin-1").strip())
        found = f"an array of shape {header['shape']!r} and type {header['descr']!r}"
        if header["shape"] == () and header["descr"] in ("|O", "O"):
            return end
    raise file_error(owner, "header", expected, found if len(found) < 120 else quoted(found))


def _single(packed: Any) -> Any:
    """Return an array, a number or None: anything but a list."""
    if isinstance(packed, PickledArray):
        return _array(packed)
    if isinstance(packed, int) and abs(packed) >= 1 << 63:
        raise Refused("an integer beyond 64 bits")
    if packed is None or isinstance(packed, (int, float)):
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
    size = math.prod((kind.itemsize, *shape))
    if not isinstance(data, bytes) or len(data) != size:
        raise Refused(f"an array of shape {shape} with other than {size} bytes of data")
    try:
        array = np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
    except ValueError:
        raise Refused(f"an array of shape {shape}") from None
    return array.astype(kind.newbyteorder("="), copy=False)
