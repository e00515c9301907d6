"""Messages on standard error besides errors and warnings: progress of slow work, and details on request.

Standard output is reserved for results. The command line sets the level: `--quiet`, `--verbose`.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator, Sequence
from functools import partial

QUIET, NORMAL, VERBOSE = range(3)
SLOW = 1.0  # seconds of work that pass without a word

_level = NORMAL
_compilers: list[None] = []  # that are at work for this process


@contextlib.contextmanager
def at_level(level: int) -> Iterator[None]:
    global _level
    before, _level = _level, level
    try:
        yield
    finally:
        _level = before


def quiet() -> bool:
    """Return whether progress bars are hidden, too."""
    return _level < NORMAL


def _is_worker() -> bool:
    """Return whether multiprocessing started this process: output of many would mix with that of their parent."""
    module = sys.modules.get("multiprocessing.process")
    return module is not None and module.parent_process() is not None


def _say(level: int, text: str) -> None:
    if _level >= level and (level == QUIET or not _is_worker()):
        print(f"clshade: {in_one_line(text)}", file=sys.stderr, flush=True)


error = partial(_say, QUIET)  # prints a line on what ends a command, or a part of it
progress = partial(_say, NORMAL)  # about slow work, or on what was chosen for the user
detail = partial(_say, VERBOSE)  # on what was done and how long it took


def warning(text: str) -> None:
    """Print a one-line warning, unless quiet or in a worker."""
    progress(f"warning: {text}")


def table(lines: Sequence[str]) -> None:
    """Print a table, unless quiet or in a worker."""
    if _level >= NORMAL and not _is_worker():
        print(printable("\n".join(lines)), file=sys.stderr, flush=True)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Count a compiler as at work for this process within the block."""
    _compilers.append(None)
    try:
        yield
    finally:
        _compilers.pop()


def is_compiling() -> bool:
    return bool(_compilers)


@contextlib.contextmanager
def told_when_slow(text: str, *, after_compiling: bool = False) -> Iterator[None]:
    """Print a line about the block if it is slow. after_compiling: do not count the time of compilers, which say so
    themselves."""
    ended = threading.Event()

    def tell() -> None:
        waited = 0
        while waited < 10:
            if ended.wait(SLOW / 10):
                return
            waited = 0 if after_compiling and is_compiling() else waited + 1
        progress(text)

    threading.Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def in_one_line(text: str) -> str:
    """Return a message in one line: white space collapsed, and no character that moves or colors a terminal."""
    return printable(" ".join(text.split()))


def printable(text: str, encoding: str = "utf-8") -> str:
    r"""Escape control characters, and characters that the encoding lacks, as `\x1b` or `\u2026`; line ends are kept.

    A byte of a file name that is not UTF-8 is a surrogate in Python, and shown as such: 0xe9 as `\udce9`.
    """
    if not text.replace("\n", "").isprintable():
        text = "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)
    return text.encode(encoding, "backslashreplace").decode(encoding)
