"""How long a worker may be silent: when that is told, and when its frames are given to others."""

from __future__ import annotations

import time

POLL = 0.1  # seconds after which Python looks whether there was an interrupt
SILENT = 10.0  # seconds without a sign until that is told
PREPARING = 120.0  # seconds that a worker may take beyond --frame-timeout to start and to compile the kernels
AWAY = 3.0  # seconds between two looks at the workers that only a process that was stopped itself lets pass
ATTEMPTS = 3  # workers that may be lost at a frame before it is given up: it may be what ends them


class Clock:
    """Runs since the last sign of a worker, or of a frame that it has."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self._since = time.monotonic()
        self._told = 0.0

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._since

    def due(self, latest: float) -> float | None:
        """The seconds of silence where they are to be told now: after SILENT, or twice what the `latest` frame took where
        that is more, and each time that they have doubled."""
        seconds = self.seconds
        if seconds < max(SILENT, 2.0 * latest, 2.0 * self._told):
            return None
        self._told = seconds
        return seconds

    def skip(self, seconds: float) -> None:
        """These do not count."""
        self._since += seconds


class Pauses:
    """For how long this process itself was stopped (Ctrl-Z): workers gave no sign as nobody could take one."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def latest(self) -> float:
        """Seconds, 0 for what may be work, since this was asked last."""
        last, self._last = self._last, time.monotonic()
        seconds = self._last - last
        return seconds if seconds > AWAY else 0.0
