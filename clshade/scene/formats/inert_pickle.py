"""Pickles of NumPy arrays as inert records: nothing in a pickle is executed, and none takes long.

An interpreter of the opcodes that NumPy writes (protocols 3 and 4), and of no others. The only names that a pickle can
refer to are those of NumPy's arrays and data types, which stand for records here: `unpickle` calls nothing of NumPy.

Each opcode takes time and memory in proportion to its own bytes. With the memo a few bytes can describe a tree of 2^60
leaves, so no value is hashed, compared, copied or printed as a whole; keys of dicts are short text. Code that walks the
result has to count. Unlike `pickle.Unpickler` it is written in Python, not C: Ctrl-C works.
"""

from __future__ import annotations

import gc
import pickle
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ...base.input_files import quoted

MAX_OPCODES = 1 << 20
MAX_KEY = 64  # characters of a dict's key
MAX_ARGUMENTS = 8  # of a call and in a state; NumPy uses up to 8

_NAMES = {
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
}


class Refused(Exception):
    """Content of the file that is not accepted; the message says what was found."""


@contextmanager
def paused_collection() -> Iterator[None]:
    """Pause Python's cyclic garbage collector.

    A million small records would make it traverse all objects of the process again and again, and none of them is
    garbage.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class PickledArray:
    """An array. state: (shape, dtype, whether Fortran order, data), unchecked; None without one."""

    __slots__ = ("state",)

    def __init__(self) -> None:
        self.state: Any = None


class PickledDtype:
    """A data type: its name, such as `f4`, and its byte order; unchecked."""

    __slots__ = ("name", "order")

    def __init__(self, name: Any) -> None:
        self.name, self.order = name, "="


class _Name:
    """One of _NAMES."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name


class _Machine:
    """The state of the interpreter. stack: above the last mark. below: the stacks under the marks, innermost last."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.stack: list[Any] = []
        self.below: list[list[Any]] = []
        self.memo: dict[int, Any] = {}

    def run(self, at: int) -> Any:
        data = self.data
        for _ in range(MAX_OPCODES):
            code = data[at]
            if code == pickle.STOP[0]:
                return self.stack[-1]
            step = _STEPS.get(code)
            if step is None:
                raise Refused(f"the pickle opcode {_opcode_name(code)}")
            at = step(self, at + 1)
        raise Refused(f"more than {MAX_OPCODES} opcodes")

    def count(self, at: int, width: int) -> int:
        return int.from_bytes(self.data[at : at + width], "little")

    def take_marked(self) -> list[Any]:
        """Pop the last mark and return what lies above it."""
        found, self.stack = self.stack, self.below.pop()
        return found


_Step = Callable[[_Machine, int], int]  # executes an opcode; start of its argument -> end of it
_STEPS: dict[int, _Step] = {}


def unpickle(data: bytes, start: int = 0) -> Any:
    """Return the value of the pickle that begins at byte `start`.

    None, bool, int, float, text, bytes, tuple, list, dict, PickledArray and PickledDtype, nested and shared in any way,
    including cycles. Raises Refused for content that NumPy would not write, and exceptions of any type for damaged
    data.
    """
    return _Machine(data).run(start)


def _opcode_name(code: int) -> str:
    import pickletools

    return next((each.name for each in pickletools.opcodes if ord(each.code) == code), f"{code:#04x}")


# The opcodes


def _opcode(*codes: bytes) -> Callable[[_Step], _Step]:
    def enter(step: _Step) -> _Step:
        _STEPS.update((code[0], step) for code in codes)
        return step

    return enter


def _skip(code: bytes, width: int) -> None:
    @_opcode(code)
    def step(machine: _Machine, at: int) -> int:
        return at + width


def _push(code: bytes, made: Callable[[], Any]) -> None:
    @_opcode(code)
    def step(machine: _Machine, at: int) -> int:
        machine.stack.append(made())
        return at


def _number(code: bytes, form: str) -> None:
    packed = struct.Struct(form)

    @_opcode(code)
    def step(machine: _Machine, at: int) -> int:
        machine.stack += packed.unpack_from(machine.data, at)
        return at + packed.size


def _sized(code: bytes, width: int, made: Callable[[bytes], Any]) -> None:
    """Register an opcode for bytes preceded by their number, which takes `width` bytes."""

    @_opcode(code)
    def step(machine: _Machine, at: int) -> int:
        start = at + width
        end = start + machine.count(at, width)
        if end > len(machine.data):
            raise Refused("an end within a value")
        machine.stack.append(made(machine.data[start:end]))
        return end


def _memo(put: bytes, get: bytes, width: int) -> None:
    @_opcode(put)
    def step_put(machine: _Machine, at: int) -> int:
        machine.memo[machine.count(at, width)] = machine.stack[-1]
        return at + width

    @_opcode(get)
    def step_get(machine: _Machine, at: int) -> int:
        machine.stack.append(machine.memo[machine.count(at, width)])
        return at + width


def _text(data: bytes) -> str:
    return data.decode("utf-8", "surrogatepass")


def _whole(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)


_skip(pickle.PROTO, 1)
_skip(pickle.FRAME, 8)
_push(pickle.NONE, lambda: None)
_push(pickle.NEWTRUE, lambda: True)
_push(pickle.NEWFALSE, lambda: False)
_push(pickle.EMPTY_TUPLE, tuple)
_push(pickle.EMPTY_LIST, list)
_push(pickle.EMPTY_DICT, dict)
_number(pickle.BININT, "<i")
_number(pickle.BININT1, "<B")
_number(pickle.BININT2, "<H")
_number(pickle.BINFLOAT, ">d")
_sized(pickle.LONG1, 1, _whole)
_sized(pickle.SHORT_BINUNICODE, 1, _text)
_sized(pickle.BINUNICODE, 4, _text)
_sized(pickle.SHORT_BINBYTES, 1, bytes)
_sized(pickle.BINBYTES, 4, bytes)
_sized(pickle.BINBYTES8, 8, bytes)
_memo(pickle.BINPUT, pickle.BINGET, 1)
_memo(pickle.LONG_BINPUT, pickle.LONG_BINGET, 4)


@_opcode(pickle.MEMOIZE)
def _memoize(machine: _Machine, at: int) -> int:
    machine.memo[len(machine.memo)] = machine.stack[-1]
    return at


@_opcode(pickle.MARK)
def _mark(machine: _Machine, at: int) -> int:
    machine.below.append(machine.stack)
    machine.stack = []
    return at


@_opcode(pickle.TUPLE)
def _tuple(machine: _Machine, at: int) -> int:
    items = machine.take_marked()
    machine.stack.append(tuple(items))
    return at


@_opcode(pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3)
def _short_tuple(machine: _Machine, at: int) -> int:
    first = len(machine.stack) - (machine.data[at - 1] - pickle.TUPLE1[0] + 1)
    if first < 0:
        raise Refused("a tuple without its items")
    items = tuple(machine.stack[first:])
    del machine.stack[first:]
    machine.stack.append(items)
    return at


@_opcode(pickle.APPEND)
def _append(machine: _Machine, at: int) -> int:
    item = machine.stack.pop()
    return _extended(machine, [item], at)


@_opcode(pickle.APPENDS)
def _appends(machine: _Machine, at: int) -> int:
    items = machine.take_marked()
    return _extended(machine, items, at)


def _extended(machine: _Machine, items: list[Any], at: int) -> int:
    grown = machine.stack[-1]
    if not isinstance(grown, list):
        raise Refused("items for what is no list")
    grown += items
    return at


@_opcode(pickle.SETITEM)
def _set_item(machine: _Machine, at: int) -> int:
    value, key = machine.stack.pop(), machine.stack.pop()
    return _updated(machine, [key, value], at)


@_opcode(pickle.SETITEMS)
def _set_items(machine: _Machine, at: int) -> int:
    items = machine.take_marked()
    return _updated(machine, items, at)


def _updated(machine: _Machine, items: list[Any], at: int) -> int:
    """Set items of a dict. Keys are checked before they are hashed.

    Hashing a nested tuple may take forever, and integers can be chosen such that all of them collide. Text cannot, see
    PYTHONHASHSEED.
    """
    changed = machine.stack[-1]
    if not isinstance(changed, dict) or len(items) % 2:
        raise Refused("items for what is no dict")
    if not items:
        return at
    for key, value in zip(items[::2], items[1::2], strict=True):
        if not isinstance(key, str) or len(key) > MAX_KEY:
            raise Refused(f"a key other than text of at most {MAX_KEY} characters")
        changed[key] = value
    return at


@_opcode(pickle.GLOBAL)
def _global(machine: _Machine, at: int) -> int:
    middle = machine.data.index(b"\n", at)
    end = machine.data.index(b"\n", middle + 1)
    return _referred(machine, _text(machine.data[at:middle]), _text(machine.data[middle + 1 : end]), end + 1)


@_opcode(pickle.STACK_GLOBAL)
def _stack_global(machine: _Machine, at: int) -> int:
    name, module = machine.stack.pop(), machine.stack.pop()
    if not isinstance(module, str) or not isinstance(name, str):
        raise Refused("a reference without a name")
    return _referred(machine, module, name, at)


def _referred(machine: _Machine, module: str, name: str, at: int) -> int:
    if (module, name) not in _NAMES:
        raise Refused(f"a reference to {quoted(f'{module}.{name}')}")
    machine.stack.append(_Name(name))
    return at


@_opcode(pickle.REDUCE)
def _reduce(machine: _Machine, at: int) -> int:
    arguments, called = machine.stack.pop(), machine.stack.pop()
    if not isinstance(called, _Name) or not isinstance(arguments, tuple) or len(arguments) > MAX_ARGUMENTS:
        raise Refused("a call of something other than NumPy's functions")
    if called.name == "_reconstruct":
        machine.stack.append(PickledArray())
    elif called.name == "dtype" and arguments:
        machine.stack.append(PickledDtype(arguments[0]))
    else:
        raise Refused(f"a call of {called.name}")
    return at


@_opcode(pickle.BUILD)
def _build(machine: _Machine, at: int) -> int:
    """Set the state of an array, (version, shape, dtype, whether Fortran order, data), or of a data type.

    That of a data type is (version, byte order, parts ...); a plain one has no parts.
    """
    state, built = machine.stack.pop(), machine.stack[-1]
    if not isinstance(state, tuple) or not 5 <= len(state) <= MAX_ARGUMENTS:
        raise Refused("a state of an unknown form")
    if isinstance(built, PickledArray) and built.state is None and len(state) == 5:
        built.state = state[1:]
    elif isinstance(built, PickledDtype) and all(part is None for part in state[2:5]):
        built.order = state[1]
    else:
        raise Refused("a structured data type" if isinstance(built, PickledDtype) else "a state of an unknown form")
    return at
