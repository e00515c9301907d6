"""What goes to standard error besides errors and warnings: how far something slow is, and details for who wants them.

Standard output is left to results. The command line sets the level: `--quiet`, `--verbose`.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any, TextIO

QUIET, NORMAL, VERBOSE = range(3)

_level = NORMAL


@contextlib.contextmanager
def at_level(level: int) -> Iterator[None]:
    """In the block this process tells so much."""
    global _level
    before, _level = _level, level
    try:
        yield
    finally:
        _level = before


def quiet() -> bool:
    """Whether bars of progress are left out, too."""
    return _level < NORMAL


def _is_worker() -> bool:
    """Whether multiprocessing started this process: lines of many would mix with what their parent shows."""
    module = sys.modules.get("multiprocessing.process")
    return module is not None and module.parent_process() is not None


def warning(text: str) -> None:
    """A line about what is other than was meant, unless quiet or in a worker."""
    if _level >= NORMAL and not _is_worker():
        _print(f"warning: {text}")


def progress(text: str) -> None:
    """A line that says what takes long, unless quiet or in a worker."""
    if _level >= NORMAL and not _is_worker():
        _print(text)


def detail(text: str) -> None:
    """A line about what was done and how long it took, where details are wanted."""
    if _level >= VERBOSE:
        _print(text)


def error(text: str) -> None:
    """The line about what ends a command, or a part of it."""
    _print(text)


def _print(text: str) -> None:
    print(f"clshade: {in_one_line(text)}", file=sys.stderr, flush=True)


def in_one_line(text: str) -> str:
    """A message whatever it names: runs of white space are a blank, and nothing in it moves or colors a terminal."""
    return printable(" ".join(text.split()))


def printable(text: str, encoding: str = "utf-8") -> str:
    r"""Lines without control characters, and without what the encoding lacks: as `\x1b`, `\u2026`. A byte of a file's
    name that is no UTF-8 is one of these, as Python has it: 0xe9 is `\udce9`."""
    if not text.replace("\n", "").isprintable():
        text = "".join(each if each.isprintable() or each == "\n" else ascii(each)[1:-1] for each in text)
    return text.encode(encoding, "backslashreplace").decode(encoding)


class Printable:
    """A text stream on which everything can be printed, see `printable`. The rest is the stream's own."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        self.stream.write(printable(text, getattr(self.stream, "encoding", None) or "utf-8"))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)
