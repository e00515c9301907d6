"""Progress bars: what their estimates leave out."""

import io
import sys
import threading
from types import SimpleNamespace

import pytest

from clshade.base import interrupts, progress_bar
from clshade.base.progress_bar import Bar


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True

    @property
    def states(self) -> list[str]:
        return [state.strip() for state in self.getvalue().split("\r") if state.strip()]


def screen(monkeypatch) -> Screen:
    """Put a terminal in place of standard error; a fixture cannot, before pytest does the same."""
    monkeypatch.setattr(sys, "stderr", Screen())
    return sys.stderr


@pytest.fixture
def clocks(monkeypatch) -> SimpleNamespace:
    """Return all clocks, in seconds: the time, and that of work."""
    clocks = SimpleNamespace(now=0.0, work=0.0)
    monkeypatch.setattr(progress_bar, "time", SimpleNamespace(time=lambda: clocks.now))
    monkeypatch.setattr("tqdm.std.time", lambda: clocks.now)
    return clocks


def test_the_first_item_and_compiling_do_not_count_in_the_estimate(clocks, monkeypatch):
    shown = screen(monkeypatch)
    with Bar(10, "figures", clock=lambda: clocks.work) as bar:
        for compiling, drawing in ((0.0, 50.0), (0.0, 1.0), (30.0, 1.0), (0.0, 1.0), (20.0, 1.0)):
            clocks.now += compiling + drawing
            clocks.work += drawing
            bar.advance()
    times = " ".join(state.partition("[")[2] for state in shown.states)
    assert times == "00:00<?] 00:50<?] 00:51<00:08] 01:22<00:07] 01:23<00:06] 01:44<00:05]"
    assert shown.states[-1].startswith("figures:  50%|")
    assert " 5/10 [" in shown.states[-1]


def test_the_line_on_an_interrupt_does_not_continue_that_of_a_bar(clocks, monkeypatch):
    for closed in (False, True):
        shown = screen(monkeypatch)
        monkeypatch.setattr(interrupts, "_told", threading.Lock())
        with Bar(3, clock=None) as bar:
            if closed:
                bar.close()
            interrupts.tell()
        assert ("]\nclshade: interrupted\n" in shown.getvalue()) is not closed
