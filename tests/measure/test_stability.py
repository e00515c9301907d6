"""`stability`: every case passes and can fail; curves of scenes that grow stiff; the output and files of the command."""

from __future__ import annotations

import csv
import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run

from clshade.measure.stability import curves, stability
from clshade.measure.stability.cases import Bench, Case, Outcome, all_cases
from clshade.measure.stability.cases.light import exact_highlights, in_the_lobe
from clshade.measure.stability.curves import AXES, PLAIN
from clshade.oracle import shade
from clshade.pipeline.frame import Frame

CASES = {case.name: case for case in all_cases()}
EXPONENT = AXES[0]


class Spoiled(Bench):
    """A bench with an error planted in all its results, a different one in every call."""

    calls = 0

    def draw(self, scene, **options):
        frame = super().draw(scene, **options)
        self.calls += 1
        rgba, layers = frame.rgba.copy(), {name: frame[name].copy() for name in frame.layers}
        rows, columns = layers["id"].shape
        at = (self.calls * 7) % rows, (self.calls * 11) % columns
        rgba[at] = 7.0, 7.0, 7.0, 1.0 - rgba[at][3]
        layers["id"][at] += 1
        return Frame(rgba, layers, frame.scene, frame.settings, lambda: frame.stats)

    def highlights(self, *arguments):
        return super().highlights(*arguments) * np.float32(1.25) + np.float32(1e-3)


every_case = pytest.mark.parametrize(
    "case", [pytest.param(case, id=name, marks=[pytest.mark.long] * case.slow) for name, case in CASES.items()]
)


@pytest.mark.long
@every_case
def test_every_case_passes(device, case):
    outcome = case.run(Bench(device, triangles=2000))
    assert outcome.passed, outcome


@pytest.mark.sampled
@every_case
def test_every_case_can_fail(device, case, tmp_path):
    """An image wrong in one pixel, light off by a quarter: found by the cases affected, and drawn."""
    outcome = case.run(Spoiled(device, triangles=2000))
    assert not outcome.passed
    written = stability.write_pictures(stability.Result(case, device.index, outcome, 0.0), tmp_path)
    assert len(written) == (3 if outcome.pictures else 0)


@pytest.mark.long
def test_errors_are_as_in_theory(device, monkeypatch):
    monkeypatch.setattr(curves, "SIDE", 48)
    monkeypatch.setattr(curves, "FRAMES", 2)
    some = [replace(axis, values=(1.0, 1e3, 1e6)) for axis in AXES]
    rows = [curves.measure(axis, value, device) for axis in some for value in axis.values]
    for row in rows:
        assert set(row.ms) == set(row.rms) - {PLAIN}
        assert all(row.wrong[way] == 0 and row.ms[way] > 0.0 for way in row.ms)
        assert row.rms.get("float64", 0.0) < row.axis.own_error(row.value)
    errors = {axis.name: [row.rms for row in rows if row.axis is axis] for axis in some}
    first, _, last = (rms["standard"] for rms in errors["exponent"])
    assert 100.0 < last / first < 1e4  # sqrt(n) is 1000
    assert last < 1e-4
    distances = [rms["standard"] for rms in errors["distance"]]
    assert distances == pytest.approx(distances[:1] * 3, rel=0.05)
    assert errors["exponent"][2][PLAIN] > 0.02  # no digit is left
    assert errors["distance"][2][PLAIN] > 1e3 * errors["distance"][0][PLAIN]
    assert errors["aspect"][2][PLAIN] > 2.0 * errors["aspect"][2]["standard"] > 1e-5
    assert errors["nearness"][2]["standard"] > 1e4 * errors["nearness"][0]["standard"]
    tables = curves.results(rows, "$device$")
    assert max(map(len, "\n".join(tables.lines()).splitlines())) <= 100
    assert len(tables.tables[0].csv().splitlines()) == 13
    low, high = curves.figure(rows, "$device$").axes[0].get_ylim()
    assert low < high


@pytest.mark.parametrize("n", [1.0, 1e4, 1e9])
def test_the_oracle_s_own_error_of_a_highlight(n):
    pytest.importorskip("mpmath")
    points, normals, light = in_the_lobe(n, 60)
    values = shade.specular(shade.Directions.at(points, normals, np.zeros(3), light), np.float64(n))
    assert np.abs(values - exact_highlights(points, normals, light, n)).max() < EXPONENT.own_error(n)


def made_up(name: str, outcome: Outcome | Exception) -> Case:
    def drawn(bench: Bench) -> list[Outcome]:
        if isinstance(outcome, Exception):
            raise outcome
        return [outcome]

    return Case("1", name, "nothing", "all is well", drawn)


def test_a_failing_case_shows_pictures_and_why(monkeypatch, device, capsys, tmp_path):
    rgb = np.random.default_rng(1).uniform(0, 1e3, (5, 7, 3))
    nan = np.where(np.arange(7)[None, :, None] == 3, np.nan, rgb)
    ids = np.arange(35).reshape(5, 7)
    shown = (
        made_up("good", Outcome()),
        made_up("colors", Outcome(0, 40.0, 32.0, "bounds", pictures=(nan, rgb))),
        made_up("ids", Outcome(2, pictures=(ids, ids * 0))),
        made_up("broken", ValueError("two\nlines")),
    )
    monkeypatch.setattr(stability, "all_cases", lambda: shown)
    monkeypatch.setattr(stability, "devices", lambda name: [device, device])
    monkeypatch.setattr(stability.importlib.util, "find_spec", lambda name: None)
    assert not stability.run(out=tmp_path / "new", names=[case.name for case in shown])
    out = capsys.readouterr().out
    assert "8 of 4 cases: 2 passed, 6 failed" in out
    assert "40 of 32 bounds" in out
    assert "broken: expected of nothing: all is well; ValueError: two lines" in out
    assert "mpmath is not installed (pip install" in out
    written = {(path.stem.split("-")[0], path.stem.split("-")[-1]) for path in (tmp_path / "new").glob("*.png")}
    assert written == set(itertools.product(("colors", "ids"), ("rendered", "expected", "difference")))
    rows = list(csv.DictReader((tmp_path / "new" / "stability.csv").open()))
    assert [row["verdict"] for row in rows] == 2 * ["pass", "FAIL", "FAIL", "FAIL"]
    assert rows[1]["stressed"] == "nothing"


def test_the_command_line(monkeypatch, capsys, tmp_path, device):
    assert run(capsys, "stability", "--list")[1].count("\n") == len(CASES)
    chosen = ["stability", "--device", device.index, "--out", tmp_path / "out", "--case", "equal-depth", "22b"]
    code, out, _ = run(capsys, *chosen)
    assert (code, "2 of 2 cases: 2 passed" in out) == (0, True)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {f"stability.{x}" for x in ("csv", "json", "md")}
    monkeypatch.setattr(stability, "Bench", Spoiled)
    assert run(capsys, *chosen)[0] == 1
    assert len(list((tmp_path / "out").glob("equal-depth-*.png"))) == 3


@pytest.mark.long
def test_the_whole_command(tmp_path, device, monkeypatch):
    monkeypatch.setattr(curves, "FRAMES", 1)
    monkeypatch.setattr(stability, "all_cases", lambda: (CASES["equal-depth"],))
    assert stability.run(device.index, out=tmp_path, formats=("png", "pdf"))
    assert (tmp_path / "curves.png").stat().st_size > 50_000
    assert (tmp_path / "curves.pdf").read_bytes().startswith(b"%PDF")
    assert len(json.loads((tmp_path / "stability.json").read_text())["cases"]) == 1
