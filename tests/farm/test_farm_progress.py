"""Progress of a run: lines without a terminal, a bar on a terminal, and the same rate everywhere."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace

import pytest

from clshade.base import progress_bar
from clshade.farm import running
from clshade.farm.job import DrawnFrame, Lost, Silent
from clshade.farm.running import Progress


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch) -> list[float]:
    """Control all clocks, in seconds."""
    now = [0.0]
    clocks = SimpleNamespace(perf_counter=lambda: now[0], time=lambda: 1e9 + now[0])
    for module in (running, progress_bar):
        monkeypatch.setattr(module, "time", clocks)
    monkeypatch.setattr("tqdm.std.time", lambda: 1e9 + now[0])
    return now


def draw(bar: Progress, number: int, *warnings: str) -> None:
    bar.advance(DrawnFrame(number, 1.0, 1.0, 1, warnings, "here:1"))


def test_silent_and_lost_workers_are_reported(capsys):
    reports = [Silent((3,), "7", 12.3), Lost((3, 4), "7 is gone"), DrawnFrame(3, 1.0, 1.0, 5, (), "8")]
    with Progress(2, 0, False) as bar:
        bar.follow(reports, limited=False)
    assert capsys.readouterr().err.splitlines() == [
        "clshade: warning: no sign of worker 7 for 12 s, at frame 3 (--frame-timeout SECONDS gives frames of such "
        "workers to others)",
        "clshade: warning: frames 3, 4 drawn again: the worker 7 is gone",
    ]
    assert (bar.drawn, bar.lost, bar.size, bar.workers) == (1, 1, 5, {"8"})


def test_lines_now_and_then_without_a_terminal(now, monkeypatch):
    """The first frame, which waits for the compiler, does not count in what is left."""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with Progress(100, 0, True) as bar:
        now[0] += 60.0
        for number in range(1, 12):
            now[0] += 1.0
            draw(bar, number, *(["odd"] if number > 2 else []))
    lines = sys.stderr.getvalue().splitlines()
    assert [line for line in lines if "warning" in line] == ["clshade: warning: frame 3: odd"]
    assert lines[-1] == "clshade: 11/100 frames, 0.155 frames/s, about 89 s left"
    assert (bar.drawn, bar.seconds) == (11, 71.0)


def test_a_bar_on_a_terminal_and_nothing_where_nothing_is_to_be(now, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen())
    with Progress(4, 1, True) as bar:
        for number in (2, 3, 4):
            now[0] += 2.0
            draw(bar, number)
        now[0] += 60.0  # while workers end
    last = sys.stderr.getvalue().split("\r")[-1]
    assert "4/4 [" in last
    assert last.rstrip().endswith(", 0.5 frames/s]")
    for stream in (Screen(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        with Progress(1, 0, stream is None) as bar:
            now[0] += 1.0
            draw(bar, 1)
        assert (bar.rate, stream is None or stream.getvalue()) == (1.0, stream is None or "")
