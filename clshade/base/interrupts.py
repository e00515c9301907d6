"""Ctrl-C while a compiler or a kernel runs: Python notices when it returns, which can take seconds."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import signal
import sys
import threading
import time

TYPE_CHECKING = False  # `typing` takes long to import, and an interrupt meanwhile goes unnoticed
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import NoReturn

INTERRUPTED = 130  # exit code
GRACE = 0.3  # seconds that Python has to end the process in its own way
CLEARING = 1.0  # seconds that it may then take to say so and to remove what is temporary

_told = threading.Lock()
_stderr: int | None = None  # standard error as it was at first: what prints by itself is kept from it at times (exr.py)
_at_end: list[Callable[[], None]] = []
_late = threading.Event()


def at_end(clear: Callable[[], None]) -> Callable[[], None]:
    """Has `clear` called when the process ends, even if an interrupt ends it that its main thread cannot handle.

    For what would stay on the disk otherwise. It may be called twice, and in another thread while the main one goes on;
    where it fails there is nobody left to tell.
    """

    def quietly() -> None:
        with contextlib.suppress(Exception):
            clear()

    _at_end.append(quietly)
    atexit.register(quietly)
    return clear


def tell() -> None:
    """Says so, in one line on standard error; once in a process."""
    if not _told.acquire(blocking=False):
        return
    if _stderr is None:
        print("clshade: interrupted", file=sys.stderr)
        return
    with contextlib.suppress(OSError):
        os.write(_stderr, b"clshade: interrupted\n")


def leave_soon(*, quiet: bool = False) -> None:
    """From now on an interrupt ends the process even if its main thread does not get to handle it. For the main thread
    of a process that runs a command, before it starts others. quiet: another process says so."""
    global _stderr
    if quiet:
        _told.acquire(blocking=False)
    with contextlib.suppress(OSError):
        _stderr = os.dup(2)
    signal.signal(signal.SIGINT, _raise)
    if not hasattr(signal, "pthread_sigmask"):
        return
    # For a thread that waits for it, as nobody else may see the signal: LLVM, which compiles for some runtimes, handles it
    # by removing the file that it is writing, and then complains of the loss.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Both started now: a process that is ending can't start threads.
    threading.Thread(target=_wait, daemon=True).start()
    threading.Thread(target=_end_by_force, daemon=True).start()


def ignore() -> None:
    """From now on interrupts do nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _raise(number: int, frame: FrameType | None) -> None:
    """As Python does, but not during an import: one of a module in C may abort the process where it gets an exception."""
    while frame is not None:
        if frame.f_globals.get("__name__") == "importlib._bootstrap":
            return
        frame = frame.f_back
    raise KeyboardInterrupt


def _wait() -> NoReturn:
    signal.sigwait({signal.SIGINT})
    _thread.interrupt_main(signal.SIGINT)
    time.sleep(GRACE)
    _late.set()
    with contextlib.suppress(Exception):
        tell()
        sys.stdout.flush()
    for clear in reversed(_at_end):
        clear()
    os._exit(INTERRUPTED)


def _end_by_force() -> NoReturn:
    """Ends the process where clearing up waits for something, a full pipe or a folder that does not answer."""
    _late.wait()
    time.sleep(CLEARING)
    os._exit(INTERRUPTED)
