"""Pickles of NumPy arrays as inert records: nothing in a pickle is executed, and none takes long.

The standard library's interpreter in Python, which Ctrl-C interrupts, for the opcodes that NumPy writes (protocols 3 and
4), and for no others. The only names that a pickle can refer to are those of NumPy's arrays and data types, which stand
for records here: nothing of NumPy is called.

Each opcode takes time and memory in proportion to its own bytes. With the memo a few bytes can describe a tree of 2^60
leaves, so no value is hashed, compared, copied or printed as a whole; keys of dicts are short text. Code that walks the
result has to count.
"""

from __future__ import annotations

import gc
import io
import pickle
import pickletools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ...base.input_files import quoted

MAX_OPCODES = 1 << 20
MAX_KEY = 64  # characters of a dict's key
MAX_ARGUMENTS = 8  # of a call and in a state; NumPy uses up to 8


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

    def __init__(self) -> None:
        self.left = MAX_OPCODES

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
        """Set items of a dict. Keys are checked before they are hashed.

        Hashing a nested tuple may take forever, and integers can be chosen such that all of them collide. Text cannot, see
        PYTHONHASHSEED.
        """
        changed = self.stack[-1]
        if not isinstance(changed, dict) or len(items) % 2:
            raise Refused("items for what is no dict")
        for key, value in zip(items[::2], items[1::2], strict=True):
            if not isinstance(key, str) or len(key) > MAX_KEY:
                raise Refused(f"a key other than text of at most {MAX_KEY} characters")
            changed[key] = value

    def call(self) -> None:
        arguments, called = self.stack.pop(), self.stack.pop()
        if not isinstance(arguments, tuple) or len(arguments) > MAX_ARGUMENTS:
            raise Refused("a call of something other than NumPy's functions")
        if called is PickledArray:
            self.stack.append(PickledArray())
        elif called is PickledDtype and arguments:
            self.stack.append(PickledDtype(arguments[0]))
        else:
            raise Refused("a call of something other than NumPy's functions")

    def build(self) -> None:
        """Set the state of an array, (version, shape, dtype, whether Fortran order, data), or of a data type.

        That of a data type is (version, byte order, parts ...); a plain one has no parts.
        """
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
    """Return the value of the pickle that begins at byte `start`.

    None, bool, int, float, text, bytes, tuple, list, dict, PickledArray and PickledDtype, nested and shared in any way,
    including cycles. Raises Refused for content that NumPy would not write, and exceptions of any type for damaged
    data.
    """
    file = io.BytesIO(data)
    file.seek(start)
    machine: Any = _Unpickler(file)
    machine.dispatch = _Steps()
    return machine.load()
