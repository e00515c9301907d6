"""Ctrl-C while a compiler or a kernel runs: Python handles it only when that returns, which can take seconds."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import signal
import sys
import threading
import time

TYPE_CHECKING = False  # `typing` is slow to import, and an interrupt meanwhile would be lost
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import NoReturn

INTERRUPTED = 130  # exit code
GRACE = 0.3  # seconds for Python to end the process normally
CLEARING = 1.0  # seconds for the message and the removal of temporary files after that

_told = threading.Lock()
_stderr: int | None = None  # a copy of standard error: images/exr.py redirects the original at times
_at_end: list[Callable[[], None]] = []
_exit_codes: list[int] = []  # that of the command that `run` has run
_late = threading.Event()
open_lines: set[object] = set()  # progress bars: the message begins on a line of its own


def at_end(clear: Callable[[], None]) -> Callable[[], None]:
    """Register `clear` to be called when the process ends, even by an interrupt that its main thread cannot handle.

    For what would otherwise remain on the disk. It may be called twice, and in another thread while the main one
    runs; its exceptions are ignored.
    """

    def quietly() -> None:
        with contextlib.suppress(Exception):
            clear()

    _at_end.append(quietly)
    atexit.register(quietly)
    return clear


def tell() -> None:
    """Report the interrupt in one line on standard error; once per process."""
    if not _told.acquire(blocking=False):
        return
    message = "\n" * bool(open_lines) + "clshade: interrupted\n"
    if _stderr is None:
        print(message, end="", file=sys.stderr)
        return
    with contextlib.suppress(OSError):
        os.write(_stderr, message.encode())


def run(command: Callable[[], int]) -> NoReturn:
    """Run a command as this process's: end it with the command's exit code, or one line and 130 after an interrupt.

    A script that imports much before calls `leave_soon` first.
    """
    code = INTERRUPTED
    try:
        leave_soon()
        code = command()
    except KeyboardInterrupt:
        tell()
    if code == INTERRUPTED:
        ignore()  # only cleanup is left
    _exit_codes.append(code)
    sys.exit(code)


@atexit.register  # of all that are registered later, it runs last
def _end() -> None:
    """End the process of `run` with its exit code: to clear modules and libraries from memory takes longer than all else."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if _exit_codes:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(_exit_codes[0])


def leave_soon(*, quiet: bool = False) -> None:
    """Let an interrupt end the process even if its main thread cannot handle it.

    For the main thread of a process that runs a command, before it starts others. quiet: another process reports it.
    """
    global _stderr
    if signal.getsignal(signal.SIGINT) is _raise:
        return
    if quiet:
        _told.acquire(blocking=False)
    with contextlib.suppress(OSError):
        _stderr = os.dup(2)
    signal.signal(signal.SIGINT, _raise)
    if not hasattr(signal, "pthread_sigmask"):
        return
    # Blocked in all threads but the one that waits for it: LLVM, the compiler of some runtimes, handles the signal by
    # removing the file that it is writing, and then reports it as missing.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # Both start now, because a process that is ending cannot start threads.
    threading.Thread(target=_wait, daemon=True).start()
    threading.Thread(target=_end_by_force, daemon=True).start()


def ignore() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _raise(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, but not during an import: a C extension may abort the process on an exception."""
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
        # The main thread may go on meanwhile, and fail where its files and processes are taken from it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        sys.stdout.flush()
    for clear in reversed(_at_end):
        clear()
    os._exit(INTERRUPTED)


def _end_by_force() -> NoReturn:
    """End the process when cleaning up is blocked, by a full pipe or a folder that does not respond."""
    _late.wait()
    time.sleep(CLEARING)
    os._exit(INTERRUPTED)
