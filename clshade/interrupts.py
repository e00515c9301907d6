"""Ctrl-C while a compiler or a kernel runs: Python notices when it returns, which can take seconds."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import NoReturn

INTERRUPTED = 130  # exit code
GRACE = 0.3  # seconds that Python has to end the process in its own way
CLEARING = 1.0  # seconds that it may then take to say so and to remove what is temporary

_told = threading.Lock()
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
    if _told.acquire(blocking=False):
        print("clshade: interrupted", file=sys.stderr)


def leave_soon() -> None:
    """From now on an interrupt ends the process even if its main thread does not get to handle it. For the main thread
    of a process that runs a command."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)  # told at once of every signal that Python handles
    if hasattr(signal, "siginterrupt"):  # compilers complain of reads that a signal ends
        signal.siginterrupt(signal.SIGINT, False)
    # Both started now: a process that is ending can't start threads.
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()
    threading.Thread(target=_end_by_force, daemon=True).start()


def _watch(reader: int) -> NoReturn:
    while signal.SIGINT not in os.read(reader, 64):
        pass
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
