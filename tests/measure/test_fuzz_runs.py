"""`python -m clshade fuzz`: ranges of seeds, their totals, and the log that resumes a run."""

from __future__ import annotations

import io
import json
import re

import pytest

from clshade.cli.main import main
from clshade.errors import InputError, OutputError
from clshade.measure.fuzz import campaign, file_mutations, fuzz
from clshade.measure.fuzz.fuzz import Tally


@pytest.mark.long
def test_run_and_exit_codes(monkeypatch, capsys, opened):
    arguments = ["fuzz", "--scenes", "3", "--files", "5", "--device", opened.index]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "5 files (seed 0): 0 failed" in printed
    assert re.search(r"3 scenes \(seed 0\): 0 failed, .* s; .* pixels, .* covered; excepted: 0 ", printed)
    monkeypatch.setattr(file_mutations, "problem", lambda number, seed: "planted" if number == 8 else "")
    assert main(["fuzz", "--scenes", "0", "--files", "5", "--first", "6"]) == 1
    assert "file 8: planted\n5 files (seed 0): 1 failed" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["-1", "1..", "5..4", "1.5", "many", "1..2..3", ""])
def test_seeds_that_are_none_are_refused(capsys, text):
    assert main(["fuzz", f"--seed={text}"]) == 2
    assert f"expected a whole number from 0 or a range such as 1..20, found {text!r}" in capsys.readouterr().err


def test_the_counts_are_printed_to_a_stream():
    stream = io.StringIO()
    assert campaign.run(scenes=0, files=2, seed=5, stream=stream)
    assert stream.getvalue().startswith("2 files (seed 5): 0 failed, ")


@pytest.fixture
def looked_at(monkeypatch):
    """Record what is run, as (number, seed); scene 3 of seed 2 fails."""
    seen: list[tuple[int, int]] = []

    def failures(device, numbers, seed, tally):
        (number,) = numbers
        seen.append((number, seed))
        tally.scenes, tally.pixels, tally.gates = tally.scenes + 1, tally.pixels + 10, tally.gates + 1
        return [fuzz.Failure("scene", number, "planted")] if (number, seed) == (3, 2) else []

    monkeypatch.setattr(fuzz, "scene_failures", failures)
    monkeypatch.setattr(campaign, "STEP", 4)
    return seen


def run(log, **options):
    stream = io.StringIO()
    passed = campaign.run(scenes=10, files=0, seed=range(1, 4), log=str(log), stream=stream, **options)
    return passed, stream.getvalue()


def test_seeds_are_summed_up_and_a_log_is_gone_on_from(looked_at, tmp_path, opened):
    log = tmp_path / "log"
    passed, printed = run(log, device=opened.index)
    assert not passed
    assert looked_at == [(number, seed) for seed in (1, 2, 3) for number in range(10)]
    assert "scene 3: planted" in printed
    assert "10 scenes (seed 2): 1 failed" in printed
    assert re.search(r"30 scenes \(3 seeds\): 1 failed, .* s; 300 pixels, 0 covered; excepted: 30 ", printed)
    lines = log.read_text().splitlines()
    assert len(lines) == 9  # 4 + 4 + 2 of each seed
    log.write_text("\n".join(lines[:5]) + "\n")
    looked_at.clear()
    passed, again = run(log, device=opened.index)
    assert not passed
    assert looked_at == [(8, 2), (9, 2), *((number, 3) for number in range(10))]
    without_times = [re.sub(r", [0-9.]+ s", "", text) for text in (printed, again)]
    assert without_times[0] == without_times[1]


def test_an_interrupted_run_keeps_what_it_has_done(looked_at, monkeypatch, tmp_path, opened):
    counted = fuzz.scene_failures

    def interrupted(device, numbers, seed, tally):
        if (numbers, seed) == ([6], 1):
            raise KeyboardInterrupt
        return counted(device, numbers, seed, tally)

    monkeypatch.setattr(fuzz, "scene_failures", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "log", device=opened.index)
    monkeypatch.setattr(fuzz, "scene_failures", counted)
    looked_at.clear()
    run(tmp_path / "log", device=opened.index)
    assert looked_at[:3] == [(4, 1), (5, 1), (6, 1)]


def test_logs_of_others_are_refused(looked_at, tmp_path, opened):
    log = tmp_path / "log"
    run(log, device=opened.index)
    lines = log.read_text().splitlines()
    other = json.dumps({**json.loads(lines[0]), "device": "another"})
    for line, message in (
        ("no JSON", "expected lines that an earlier run wrote"),
        ("[" * 100_000, "expected lines that an earlier run wrote"),
        ('{"what": "scenes"}', "expected lines that an earlier run wrote"),
        (other, "found one of another"),
    ):
        log.write_text(lines[0] + "\n" + line + "\n")
        with pytest.raises(InputError, match=message) as refused:
            run(log, device=opened.index)
        assert "line 2" in str(refused.value)


def test_a_log_that_cannot_be_kept_is_refused_before_anything_is_done(looked_at, tmp_path, opened):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\0")
    for name, error, message in (
        ("", OutputError, "cannot be written: Is a directory"),
        ("none/log", OutputError, "there is no folder"),
        ("binary", InputError, "found another in .*binary, line 1"),
    ):
        with pytest.raises(error, match=message):
            run(tmp_path / name, device=opened.index)
    assert looked_at == []


def test_a_tally_adds_up():
    one, two = Tally(1, 2, 3, 4, 5, 6, 7), Tally(10, 20, 30, 40, 50, 60, 70)
    assert one + two == Tally(11, 22, 33, 44, 55, 66, 77)
