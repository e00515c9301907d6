"""Progress of a run: lines without a terminal, a bar on a terminal, and the same rate everywhere."""

from __future__ import annotations

import io
import json
import re
import sys
from types import SimpleNamespace

import pytest
from devices import working_devices

from clshade.base import progress_bar
from clshade.cli.main import main
from clshade.farm import Run, running
from clshade.farm.job import DrawnFrame
from clshade.farm.running import Progress, rate_text


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


def test_lines_now_and_then_without_a_terminal(now, monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with Progress(100, 20, True) as bar:
        for number in range(1, 81):
            now[0] += 0.25
            draw(bar, number, *(["odd"] if number > 2 else []))
    assert sys.stderr.getvalue().splitlines() == [
        "clshade: warning: frame 3: odd",
        "clshade: 60/100 frames, 4 frames/s, about 10 s left",
        "clshade: 100/100 frames, 4 frames/s",
    ]
    assert (bar.drawn, bar.seconds, bar.rate) == (80, 20.0, 4.0)


@pytest.mark.parametrize("stream", [io.StringIO, Screen])
def test_the_first_frame_does_not_count_in_what_is_left(now, monkeypatch, stream):
    """It waits for the compiler: 61 s, the others one each."""
    monkeypatch.setattr(sys, "stderr", stream())
    with Progress(100, 0, True) as bar:
        now[0] += 60.0
        for number in range(1, 12):
            now[0] += 1.0
            draw(bar, number)
    shown = sys.stderr.getvalue()
    if stream is Screen:
        assert "1/100 [01:01<?" in shown
        assert "11/100 [01:11<01:29" in shown
    else:
        assert shown.splitlines() == [
            "clshade: 1/100 frames, 0.0164 frames/s",
            "clshade: 11/100 frames, 0.155 frames/s, about 89 s left",
        ]


def test_a_bar_on_a_terminal(now, monkeypatch):
    monkeypatch.setattr(sys, "stderr", Screen())
    with Progress(4, 1, True) as bar:
        for number in (2, 3, 4):
            now[0] += 2.0
            draw(bar, number)
        now[0] += 60.0  # while workers end
    states = sys.stderr.getvalue().split("\r")
    assert "4/4 [" in states[-1]
    assert states[-1].rstrip().endswith(", 0.5 frames/s]")


@pytest.mark.parametrize("stream", [io.StringIO, Screen])
def test_nothing_is_shown_where_nothing_is_to_be(now, monkeypatch, stream):
    monkeypatch.setattr(sys, "stderr", stream())
    with Progress(1, 0, False) as bar:
        now[0] += 1.0
        draw(bar, 1)
    assert (sys.stderr.getvalue(), bar.rate) == ("", 1.0)
    monkeypatch.setattr(sys, "stderr", None)
    with Progress(1, 0, True) as bar:
        draw(bar, 1)


def test_rates_are_in_frames_a_second():
    assert [rate_text(rate) for rate in (1234.56, 10.0, 9.876, 0.01666)] == [
        "1234.6 frames/s",
        "10.0 frames/s",
        "9.88 frames/s",
        "0.0167 frames/s",
    ]
    summary = Run(3, 90, 0, 180.0, 100.0, 1, 2, "a", "b")
    assert (summary.rate, summary.stats()["frames_per_second"]) == (3 / 180.0, 3 / 180.0)
    assert "180.0 s, 0.0167 frames/s; a frame 100 ms (median); 2 workers" in summary.lines()[1]
    assert not any("frames/s" in line for line in Run(0, 90, 0, 0.0, 0.0, 0, 0, "a", "b").lines())


@pytest.mark.long
@pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")
def test_progress_and_figures_agree(folder, capsys):
    arguments = ("turntable", "icosphere", "--count", "3", "--resolution", "32,24", "--preset", "course")
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert "\r" not in err
    rates = [re.findall(r"([0-9.]+) frames/s", text) for text in (err, out)]
    assert rates[0] == rates[1]
    assert len(rates[0]) == 1
    (folder / "out.0002.png").unlink()
    assert main([*arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert summary["frames_per_second"] == summary["drawn"] / summary["seconds"] == 1 / summary["seconds"]
    assert f"3/3 frames, {rate_text(summary['frames_per_second'])}\n" in err


def test_frames_that_are_there_are_found_by_reading_the_folder_once(tmp_path, monkeypatch):
    looked: list[str] = []
    is_there = running._is_there
    monkeypatch.setattr(running, "_is_there", lambda name: looked.append(name) or is_there(name))
    pattern = running.parse_pattern(str(tmp_path / "f.#.exr"), 100_000)
    assert len(running._left(pattern, range(1, 100_001))) == 100_000
    (tmp_path / "other").touch()
    assert len(running._left(pattern, range(1, 100_001))) == 100_000
    assert looked == []
    for name in ("f.7.exr", "f.7.png", "f.8.exr", "f.9.exr", "f.9.png"):
        (tmp_path / name).write_bytes(b"" if name == "f.9.png" else b"some")
    assert running._left(pattern, range(5, 11)) == [5, 6, 8, 9, 10]
    odd = running.parse_pattern(str(tmp_path / "é.#.exr"), 10)
    (tmp_path / "é.1.exr").write_bytes(b"some")
    (tmp_path / "é.1.png").write_bytes(b"some")
    assert running._left(odd, range(1, 3)) == [2]
    assert running._left(running.parse_pattern(str(tmp_path / "none" / "#"), 10), range(1, 3)) == [1, 2]
