"""How long a worker may be silent: when that is reported, and when its frames are given to others."""

from __future__ import annotations

import time

POLL = 0.1  # seconds between checks for an interrupt
SILENT = 10.0  # seconds without a sign until it is reported
PREPARING = 120.0  # seconds that a worker may take beyond --frame-timeout to start and to compile the kernels
AWAY = 3.0  # seconds between two readings of `now` that pass only if this process was stopped itself
ATTEMPTS = 3  # workers that may be lost at a frame before the run ends: the frame may be what ends them

_read = _away = 0.0  # when `now` was last read, and for how long in total it was not


def now() -> float:
    """Return the time, in seconds, without that in which this process was stopped (Ctrl-Z): workers gave no sign then
    because nobody could receive one. To be read at least every AWAY seconds."""
    global _read, _away
    before, _read = _read, time.monotonic()
    if _read - before > AWAY:
        _away += _read - before
    return _read - _away


class Clock:
    """The time since the last sign of a worker, or of a frame that it has."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self._since = now()
        self._reported = 0.0

    @property
    def seconds(self) -> float:
        return now() - self._since

    def is_over(self, limit: float, ready: bool) -> bool:
        """Return whether a frame has taken longer than `limit`; without `ready`, starting and compiling have their time."""
        return self.seconds > limit + (0.0 if ready else PREPARING)

    def due(self, latest: float) -> float | None:
        """Return the seconds of silence if they are to be reported now: after SILENT, or twice the duration of the
        `latest` frame if that is longer, and each time that they have doubled."""
        seconds = self.seconds
        if seconds < max(SILENT, 2.0 * latest, 2.0 * self._reported):
            return None
        self._reported = seconds
        return seconds
