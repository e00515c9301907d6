"""A process that may crash, hang or print what it likes, read line by line."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..base.interrupts import at_end
from ..base.json_values import in_line

ROOT = Path(__file__).resolve().parents[2]  # of the processes
POLL = 0.1  # seconds, less than the GRACE of interrupts
_running: set[subprocess.Popen[bytes]] = set()


@at_end
def _end_all() -> None:
    """End what runs: a process that this one starts inherits that interrupts are blocked."""
    for running in list(_running):
        running.kill()


class Child:
    """A running process with this clshade on its path; it is ended by `close`, and with this process.

    variables: further environment variables.
    """

    def __init__(self, command: Sequence[str], variables: Mapping[str, str] | None = None) -> None:
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command,
            env={**os.environ, "PYTHONPATH": path, **(variables or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
        )
        _running.add(self._process)
        self._lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(b"")

    def write(self, line: str) -> None:
        """Write a line to its standard input, unless it has ended."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(f"{line}\n".encode())
            self._process.stdin.flush()

    def line(self, end: float) -> bytes:
        """Return the next line, b"" at the end of all. Raises TimeoutError where none comes until `end`, monotonic."""
        while True:
            with contextlib.suppress(queue.Empty):  # an interrupt is handled in between only
                return self._lines.get(timeout=POLL)
            if time.monotonic() > end:
                raise TimeoutError

    def code(self, end: float) -> int:
        """Return its exit code, negative for a signal. Raises TimeoutError where it does not end until `end`."""
        try:
            return self._process.wait(timeout=max(end - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            raise TimeoutError from None

    def said(self) -> str:
        """Return the line of standard error that tells most: the first that names an error, or the last; "" if none."""
        self._errors.seek(0)
        lines = [line for line in self._errors.read().decode(errors="replace").splitlines() if line.strip()]
        # A traceback's own lines are indented; from Python 3.13 on some are lines of the code.
        named = [line for line in lines if not line.startswith((" ", "Traceback")) and "error" in line.lower()]
        return in_line((named or lines[-1:])[0].strip()[:160]) if lines else ""

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        _running.discard(self._process)
        self._reader.join(timeout=1.0)  # what it has started itself may hold its output open
        for file in (self._process.stdin, self._errors):
            with contextlib.suppress(OSError):
                file.close()  # type: ignore[union-attr]


def ending(code: int) -> str:
    """Return how a process ended, in two words."""
    if code >= 0:
        return f"exit code {code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"
