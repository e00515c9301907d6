"""What goes to standard error besides errors and warnings: how far something slow is, and details for who wants them.

Standard output is left to results. The command line sets the level: `--quiet`, `--verbose`.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

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


def _print(text: str) -> None:
    print(f"clshade: {text}", file=sys.stderr, flush=True)
