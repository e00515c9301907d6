"""`bench --limits`: what is asked of `--budget` and `--tolerance` against what they get."""

from __future__ import annotations

import csv
import json

import pytest

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.bench import limits
from clshade.measure.bench.limits import Truth, statements
from clshade.scene.builtin.scenes import builtin

TRUTH = Truth(
    {"unchanged": 4.0, "shaded-4": 10.0, "shaded-16": 40.0}, {"unchanged": 0.02, "shaded-4": 0.006, "shaded-16": 0.002}
)


def test_an_outcome_is_measured_against_what_was_asked_for():
    budget = TRUTH.outcome("a", "budget", 16.0, ["shaded-4", "shaded-4"])
    assert (budget.got, budget.ratio, budget.other, budget.best, budget.same) == (10.0, 0.625, 0.006, 0.006, True)
    assert budget.row() == ("a", "budget", "16 ms", "shaded-4", "10", "0.625", "0.006", "1")
    missed = TRUTH.outcome("a", "budget", 16.0, ["unchanged", "shaded-16"])
    assert (missed.other, missed.best, missed.same) == (0.02, 0.006, False)
    again = TRUTH.outcome("a", "budget", 16.0, ["shaded-4", "shaded-4"], ms=12.0)
    assert (again.got, again.ratio) == (12.0, 0.75)
    tolerance = TRUTH.outcome("a", "tolerance", 0.01, ["shaded-16"], ms=33.0)
    assert (tolerance.got, tolerance.ratio, tolerance.other, tolerance.best) == (0.002, 0.2, 40.0, 10.0)


def test_a_refusal_is_right_if_nothing_keeps_the_limit():
    assert not TRUTH.outcome("a", "tolerance", 0.001, [""]).is_wrong_refusal
    assert not TRUTH.outcome("a", "budget", 4.1, [""]).is_wrong_refusal  # within what measuring is off
    wrong = TRUTH.outcome("a", "budget", 8.0, [""])
    assert wrong.is_wrong_refusal
    assert wrong.row() == ("a", "budget", "8 ms", "refused", "4", "0.5", "-", "-")


@pytest.mark.parametrize(
    ("choices", "passed", "said"),
    [
        (["shaded-4"] * 10, True, "10 of 10 at most 10% above what was asked for, the most 0.625 times it"),
        (
            ["shaded-4"] * 9 + ["shaded-16"],
            False,
            "9 of 10 at most 10% above what was asked for, the most 2.5 times it",
        ),
        (
            [""] + ["shaded-4"] * 9,
            False,
            "9 of 9 at most 10% above what was asked for, the most 0.625 times it; 1 refused, 1 of",
        ),
    ],
)
def test_what_is_said(choices, passed, said):
    found = [TRUTH.outcome("a", "budget", 16.0, [name, name]) for name in choices]
    lines, kept = statements(found)
    assert lines[0].startswith(f"budget: {said}")
    assert kept == passed
    near, _ = statements([TRUTH.outcome("a", "budget", 9.5, ["shaded-4"])] * 10)
    assert near[0].startswith("budget: 10 of 10 at most 10% above what was asked for, the most 1.05 times it")


def test_an_unknown_scene_is_refused():
    with pytest.raises(InputError, match=r"scene: expected names of teapot, torus_knot, .*'teapott': did you mean"):
        limits.run(names=["teapott"])


@pytest.mark.long
def test_the_table_is_printed_and_written(device, tmp_path, monkeypatch, capsys):
    """Of a budget and a tolerance that every variant keeps, and of a tolerance that none does."""
    monkeypatch.setattr(limits, "SCENES", {"icosphere": (lambda: builtin("icosphere", level=2), {})})
    monkeypatch.setattr(limits, "LEVELS", {"budget": (1e6,), "tolerance": (0.9, 1e-9)})
    monkeypatch.setattr(limits, "RESOLUTION", (48, 36))
    code = main(["bench", "--limits", "-o", str(tmp_path / "found")])
    out = capsys.readouterr().out
    assert code == 0, out
    found = json.loads((tmp_path / "found.json").read_text())["outcomes"]
    assert [each["kind"] for each in found] == ["budget", "tolerance", "tolerance"]
    assert found[0]["chosen"] == "shaded-16"
    assert (found[2]["chosen"], found[2]["best"]) == ("", None)
    assert 0.0 < found[1]["got"] < 0.9
    rows = list(csv.reader((tmp_path / "found.csv").open()))
    assert rows[0] == list(limits.HEADER)
    assert len(rows) == 4
    assert "tolerance: 1 of 1 at most 10% above what was asked for" in out
