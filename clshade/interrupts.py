"""Ctrl-C while a compiler or a kernel runs: Python notices when it returns, which can take seconds."""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
import time
from typing import NoReturn

INTERRUPTED = 130  # exit code
GRACE = 0.3  # seconds that Python has to end the process in its own way

_told = threading.Lock()


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
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()


def _watch(reader: int) -> NoReturn:
    while signal.SIGINT not in os.read(reader, 64):
        pass
    time.sleep(GRACE)
    tell()
    with contextlib.suppress(Exception):
        sys.stdout.flush()
    atexit._run_exitfuncs()  # removes what is temporary
    os._exit(INTERRUPTED)
