"""The progress of a run and its rate on standard error: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time

from ..base import console
from ..base.progress_bar import Bar
from .job import DrawnFrame

LINES = 10.0  # seconds between two lines without a terminal


def rate_text(rate: float) -> str:
    return f"{rate:.1f} frames/s" if rate >= 10.0 else f"{rate:.3g} frames/s"


class Progress:
    """A counter of frames that shows progress, and each distinct warning once. Nothing is shown before the first frame,
    so that a refusal is a single line.

    total: frames of the run. done: those that existed before it, which do not count in the rate.
    """

    def __init__(self, total: int, done: int, shown: bool) -> None:
        self._total, self._done, self._shown = total, done, shown and sys.stderr is not None
        self._start, self._began = time.perf_counter(), time.time()  # for the rate, and for the bar
        self._bar: Bar | None = None
        self._told = self._start  # time of the latest line
        self._said: set[str] = set()
        self.drawn = 0
        self.seconds = 0.0  # from the start to the latest frame
        self._first = 0.0  # the same to the first one, which waits for the compiler: it tells nothing of those to come

    @property
    def rate(self) -> float:
        """Frames drawn per second, since the start."""
        return self.drawn / self.seconds if self.seconds else 0.0

    def say(self, message: str) -> None:
        """Print a warning above the bar."""
        if self._bar is not None:
            self._bar.clear()
        console.warning(message)

    def advance(self, drawn: DrawnFrame) -> None:
        for warning in drawn.warnings:
            if warning not in self._said:
                self._said.add(warning)
                self.say(f"frame {drawn.number}: {warning}")
        self.drawn += 1
        self.seconds = time.perf_counter() - self._start
        if self.drawn == 1:
            self._first = self.seconds
        if not self._shown:
            return
        if sys.stderr.isatty():
            self._draw_bar()
        else:
            self._print_line()

    def _draw_bar(self) -> None:
        if self._bar is None:
            self._bar = Bar(self._total, clock=time.perf_counter, done=self._done, left=True, began=self._began)
        self._bar.advance(rate_text(self.rate))

    def _print_line(self) -> None:
        """Print a line: a log would keep every state of a bar."""
        count, now = self._done + self.drawn, self._start + self.seconds
        if count == self._total:
            console.progress(f"{count}/{self._total} frames, {rate_text(self.rate)}")
        elif now - self._told >= LINES:
            self._told = now
            line = f"{count}/{self._total} frames, {rate_text(self.rate)}"
            if self.seconds > self._first:
                left = (self._total - count) * (self.seconds - self._first) / (self.drawn - 1)
                line += f", about {left:.0f} s left"
            console.progress(line)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
