"""`bench --workers`: its table, its files, and failure if frames differ in their bits."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest
from devices import working_devices

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import workers

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")


@pytest.mark.long
@needs_device
def test_two_processes_against_one(tmp_path, monkeypatch):
    monkeypatch.setattr(workers, "RESOLUTION", (32, 24))
    out = io.StringIO()
    prefix = str(tmp_path / "crews")
    assert workers.run((2,), frames=4, rounds=1, scene="quads", out=prefix, stream=out)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        f"crews.{kind}" for kind in ("csv", "json", "md", "png")
    ]
    found = json.loads(Path(f"{prefix}.json").read_text())
    one, two = found["crews"]
    assert (one["name"], two["name"], found["frames"]) == ("1 process", "2 processes", 4)
    assert one["digest"] == two["digest"]
    assert one["seconds"]["median"] > 0.0
    assert out.getvalue().count(" yes") == 2


def test_other_bits_fail(tmp_path, monkeypatch):
    def fake(scene, frames, options, turn):
        return 2.0 / options[1], 5.0, "one" if options == ("--workers", 1) else "another"

    monkeypatch.setattr(workers, "_draw", fake)
    out = io.StringIO()
    assert not workers.run((4,), rounds=2, stream=out)
    rows = [line.split() for line in out.getvalue().splitlines() if re.match(r"\d+ process(es)? ", line)]
    assert rows[1][:2] == ["4", "processes"]
    assert rows[1][-3:] == ["4", "5", "NO"]  # speedup, ms per frame, same files


def test_bits_that_change_from_turn_to_turn_fail(monkeypatch):
    monkeypatch.setattr(workers, "_draw", lambda scene, frames, options, turn: (1.0, 1.0, str(turn)))
    assert not workers.run((1,), rounds=2, stream=io.StringIO())


def test_refusals(tmp_path, capsys):
    with pytest.raises(InputError, match="above 0"):
        workers.run((0,))
    for further in (("quads",), ("--targets",), ("--scaling",), ("--peers", "none")):
        assert main(["bench", *further, "--workers", "2"]) == 2
        assert "either --workers" in capsys.readouterr().err
    assert main(["bench", "--workers", "two"]) == 2
    assert "whole numbers such as 2,4" in capsys.readouterr().err
    assert main(["bench", "--workers", "2", "-o", str(tmp_path / "none" / "x")]) == 2
    assert "there is no folder" in capsys.readouterr().err
