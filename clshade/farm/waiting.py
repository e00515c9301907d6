"""How long a worker may be silent: when that is reported, and when its frames are given to others."""

from __future__ import annotations

import time

POLL = 0.1  # seconds between checks for an interrupt
SILENT = 10.0  # seconds without a sign until it is reported
PREPARING = 120.0  # seconds that a worker may take beyond --frame-timeout to start and to compile the kernels
AWAY = 3.0  # seconds between two checks of the workers that pass only if this process was stopped itself
ATTEMPTS = 3  # workers that may be lost at a frame before the run ends: the frame may be what ends them


class Clock:
    """The time since the last sign of a worker, or of a frame that it has."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self._since = time.monotonic()
        self._told = 0.0

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._since

    def due(self, latest: float) -> float | None:
        """Return the seconds of silence if they are to be reported now: after SILENT, or twice the duration of the
        `latest` frame if that is longer, and each time that they have doubled."""
        seconds = self.seconds
        if seconds < max(SILENT, 2.0 * latest, 2.0 * self._told):
            return None
        self._told = seconds
        return seconds

    def skip(self, seconds: float) -> None:
        """Do not count these seconds."""
        self._since += seconds


class Pauses:
    """How long this process itself was stopped (Ctrl-Z): workers gave no sign because nobody could receive one."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def latest(self) -> float:
        """Return the seconds since the previous call, 0 if they may have been work."""
        last, self._last = self._last, time.monotonic()
        seconds = self._last - last
        return seconds if seconds > AWAY else 0.0
