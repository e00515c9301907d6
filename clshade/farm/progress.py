"""The progress of a run and its rate on standard error: a bar on a terminal, elsewhere a line now and then."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from ..base import console
from .job import DrawnFrame

if TYPE_CHECKING:
    from tqdm import tqdm

LINES = 10.0  # seconds between two lines without a terminal
BAR = "{percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}{postfix}]"


def rate_text(rate: float) -> str:
    return f"{rate:.1f} frames/s" if rate >= 10.0 else f"{rate:.3g} frames/s"


class Progress:
    """A counter of frames that shows progress, and each distinct warning once. Nothing is shown before the first frame,
    so that a refusal is a single line.

    total: frames of the run. done: those that existed before it, which do not count in the rate.
    """

    def __init__(self, total: int, done: int, shown: bool) -> None:
        self._total, self._done, self._shown = total, done, shown and sys.stderr is not None
        self._start, self._began = time.perf_counter(), time.time()  # for the rate, and by tqdm's clock
        self._bar: tqdm | None = None
        self._told = self._start  # time of the latest line
        self._said: set[str] = set()
        self.drawn = 0
        self.seconds = 0.0  # from the start to the latest frame

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
        if not self._shown:
            return
        if sys.stderr.isatty():
            self._draw_bar()
        else:
            self._print_line()

    def _draw_bar(self) -> None:
        if self._bar is None:
            from tqdm import tqdm

            self._bar = tqdm(total=self._total, initial=self._done, smoothing=0.1, bar_format=BAR)
            self._bar.start_t = self._bar.last_print_t = self._began
        self._bar.set_postfix_str(rate_text(self.rate), refresh=False)
        self._bar.update()

    def _print_line(self) -> None:
        """Print a line: a log would keep every state of a bar."""
        count, now = self._done + self.drawn, self._start + self.seconds
        if count == self._total:
            console.progress(f"{count}/{self._total} frames, {rate_text(self.rate)}")
        elif now - self._told >= LINES:
            self._told = now
            left = (self._total - count) / self.rate
            console.progress(f"{count}/{self._total} frames, {rate_text(self.rate)}, about {left:.0f} s left")

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
