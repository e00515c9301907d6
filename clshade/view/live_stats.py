"""Times of the pictures of a live view, by kind."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable
from weakref import WeakKeyDictionary

import numpy as np

from ..base import text_tables
from .live_session import Drawing

KEPT = 10_000  # pictures of each kind


class LiveStats:
    """What the pictures of all clients took, by samples and scale, and how fast they followed each other in motion."""

    def __init__(self) -> None:
        self._times: dict[tuple[int, int], deque[dict[str, float]]] = defaultdict(lambda: deque(maxlen=KEPT))
        self._intervals: deque[float] = deque(maxlen=KEPT)
        # session -> when its latest picture was drawn, if it was in motion
        self._latest: WeakKeyDictionary[object, float] = WeakKeyDictionary()

    def add(self, session: object, drawing: Drawing, now: float) -> None:
        """Note a picture that was drawn at the time `now`, s. Pictures follow at the pace at which a client shows them."""
        step = drawing.task.step
        self._times[step.samples, step.scale].append(drawing.times_ms)
        before = self._latest.pop(session, None)
        if drawing.task.is_first:
            self._latest[session] = now
            if before is not None:
                self._intervals.append(now - before)

    def lines(self) -> list[str]:
        """Return a table of medians in ms, and the frames per second in motion; empty if nothing was drawn."""
        if not self._times:
            return []
        kinds = sorted(self._times.items())
        names = list(dict.fromkeys(name for _, times in kinds for one in times for name in one))
        header = ["samples", "pixels", "pictures", *(f"{name} ms" for name in names)]
        rows = [
            [f"{samples}", f"1/{scale**2}" if scale > 1 else "all", f"{len(times):,}", *_medians(times, names)]
            for (samples, scale), times in kinds
        ]
        lines = text_tables.as_lines(header, rows)
        if self._intervals:
            rate = 1.0 / float(np.median(self._intervals))
            lines.append(f"in motion {rate:.1f} frames/s, median of {len(self._intervals):,} intervals")
        return lines


def _medians(times: Iterable[dict[str, float]], names: Iterable[str]) -> list[str]:
    found = []
    for name in names:
        values = [one[name] for one in times if name in one]
        found.append(f"{np.median(values):.2f}" if values else "-")
    return found
