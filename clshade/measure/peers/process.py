"""The parent's side of a renderer in a process of its own, which may crash, hang or print what it likes."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...base.interrupts import at_end
from ...base.json_values import in_line
from ...errors import ClshadeError
from ..bench.children import ROOT
from . import PEERS
from .drawing import Picture

LIMIT = 180.0  # seconds that a renderer has for each answer; the first may compile
POLL = 0.1  # seconds, less than the GRACE of interrupts
T = TypeVar("T")
_running: set[subprocess.Popen[bytes]] = set()


@at_end
def _end_all() -> None:
    """End what runs: a process that this one starts inherits that interrupts are blocked."""
    for running in list(_running):
        running.kill()


class PeerError(ClshadeError):
    """A renderer that is missing, crashed, hung or answered with something else; the message names it in one line."""


def command(name: str, scene: str | Path, samples: int, threads: int) -> tuple[list[str], dict[str, str]]:
    """Return the command that opens a renderer with a pickled scene, and its environment variables. threads: 0: all."""
    variables = dict.fromkeys(PEERS[name].threads, str(threads)) if threads else {}
    module = "clshade.measure.peers.child"
    return [sys.executable, "-m", module, name, str(scene), str(samples), str(threads)], variables


class Process:
    """A renderer that has opened its scene. title: its name and version.

    Raises PeerError if it does not; the process is ended then, as after any PeerError, and with this process.
    """

    def __init__(
        self, name: str, command: Sequence[str], variables: Mapping[str, str] | None = None, limit: float = LIMIT
    ) -> None:
        self.name, self._limit = name, limit
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
        try:
            self.title = self._answer("title", str)
        except BaseException:  # an interrupt too
            self.close()
            raise

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(b"")

    def draw(self) -> float:
        """Draw a frame, and return its milliseconds."""
        return self._ask("draw", "ms", float)

    def picture(self) -> Picture:
        """Return the last frame."""
        with tempfile.TemporaryDirectory() as folder:
            found = np.load(self._ask(str(Path(folder) / "frame.npz"), "wrote", str))
            return Picture(*(found[name] for name in Picture._fields))

    def _ask(self, request: str, field: str, kind: Callable[[Any], T]) -> T:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended: the answer says why
            self._process.stdin.write(f"{request}\n".encode())
            self._process.stdin.flush()
        return self._answer(field, kind)

    def _answer(self, field: str, kind: Callable[[Any], T]) -> T:
        end = time.monotonic() + self._limit
        try:
            line = self._line(end)
            code = None if line else self._process.wait(timeout=max(end - time.monotonic(), 0.0))
        except (queue.Empty, subprocess.TimeoutExpired):
            raise self._failed(f"no answer within {self._limit:g} s") from None
        if code is not None:
            raise self._failed(f"ended with {_ending(code)}{self._said()}")
        try:
            fields = json.loads(line)
            if "missing" in fields:
                raise self._failed(in_line(str(fields["missing"]).removeprefix(f"{self.name}: ")))
            return kind(fields[field])
        except (ValueError, TypeError, KeyError, OverflowError):
            raise self._failed(f"expected a line of JSON with {field!r}, found {line[:60]!r}") from None

    def _line(self, end: float) -> bytes:
        """Return the next line, b"" at the end of all. Raises queue.Empty where none comes until `end`."""
        while True:
            with contextlib.suppress(queue.Empty):  # an interrupt is handled in between only
                return self._lines.get(timeout=POLL)
            if time.monotonic() > end:
                raise queue.Empty

    def _failed(self, reason: str) -> PeerError:
        self.close()
        return PeerError(f"{self.name}: {reason}")

    def _said(self) -> str:
        """Return the line of standard error that tells most: the first that names an error, or the last."""
        self._errors.seek(0)
        lines = [line for line in self._errors.read().decode(errors="replace").splitlines() if line.strip()]
        # A traceback's own lines are indented; from Python 3.13 on some are lines of the code.
        named = [line for line in lines if not line.startswith((" ", "Traceback")) and "error" in line.lower()]
        return f": {in_line((named or lines[-1:])[0].strip()[:160])}" if lines else ""

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        _running.discard(self._process)
        self._reader.join(timeout=1.0)  # what it has started itself may hold its output open
        for file in (self._process.stdin, self._errors):
            with contextlib.suppress(OSError):
                file.close()  # type: ignore[union-attr]


def _ending(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"
