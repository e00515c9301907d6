"""The parent's side of a renderer in a process of its own, which may crash, hang or print what it likes."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...base.json_values import in_line
from ...errors import ClshadeError
from ..child_process import Child, ending
from . import PEERS
from .drawing import Picture

LIMIT = 180.0  # seconds that a renderer has for each answer; the first may compile
T = TypeVar("T")


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
        self._child = Child(command, variables)
        try:
            self.title = self._answer("title", str)
        except BaseException:  # an interrupt too
            self.close()
            raise

    def draw(self) -> float:
        """Draw a frame, and return its milliseconds."""
        return self._ask("draw", "ms", float)

    def picture(self) -> Picture:
        """Return the last frame."""
        with tempfile.TemporaryDirectory() as folder:
            found = np.load(self._ask(str(Path(folder) / "frame.npz"), "wrote", str))
            return Picture(*(found[name] for name in Picture._fields))

    def _ask(self, request: str, field: str, kind: Callable[[Any], T]) -> T:
        self._child.write(request)  # if it has ended, the answer says why
        return self._answer(field, kind)

    def _answer(self, field: str, kind: Callable[[Any], T]) -> T:
        end = time.monotonic() + self._limit
        try:
            line = self._child.line(end)
            code = None if line else self._child.code(end)
        except TimeoutError:
            raise self._failed(f"no answer within {self._limit:g} s") from None
        if code is not None:
            said = self._child.said()
            raise self._failed(f"ended with {ending(code)}" + (f": {said}" if said else ""))
        try:
            fields = json.loads(line)
            if "missing" in fields:
                raise self._failed(in_line(str(fields["missing"]).removeprefix(f"{self.name}: ")))
            return kind(fields[field])
        except (ValueError, TypeError, KeyError, OverflowError):
            raise self._failed(f"expected a line of JSON with {field!r}, found {line[:60]!r}") from None

    def _failed(self, reason: str) -> PeerError:
        self.close()
        return PeerError(f"{self.name}: {reason}")

    def close(self) -> None:
        """End the process."""
        self._child.close()
