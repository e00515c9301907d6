"""`stability`: every case passes and every case can fail; the output and files of the command."""

from __future__ import annotations

import csv
import itertools
import json
import string

import numpy as np
import pytest
from command_line import run

from clshade.measure.stability import curves, stability
from clshade.measure.stability.cases import Bench, Case, Outcome, all_cases, flat
from clshade.measure.stability.cases import bench as bench_module
from clshade.pipeline.frame import Frame

CASES = {case.name: case for case in all_cases()}
TRIANGLES = 2000


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


def cases() -> list:
    """Return every case, the slow ones marked long."""
    return [pytest.param(case, id=name, marks=[pytest.mark.long] * case.slow) for name, case in CASES.items()]


@pytest.mark.long
@pytest.mark.parametrize("case", cases())
def test_every_case_passes(device, case):
    outcome = case.run(Bench(device, triangles=TRIANGLES))
    assert outcome.passed, outcome


@pytest.mark.sampled
@pytest.mark.parametrize("case", cases())
def test_every_case_can_fail(device, case, tmp_path):
    """An image wrong in one pixel, light off by a quarter: found by the cases affected, and drawn."""
    outcome = case.run(Spoiled(device, triangles=TRIANGLES))
    assert not outcome.passed
    written = stability.write_pictures(stability.Result(case, device.index, outcome, 0.0), tmp_path)
    assert len(written) == (3 if outcome.pictures else 0)


def test_numbers_and_names_are_unique():
    numbers = {case.number.rstrip(string.ascii_lowercase) for case in CASES.values()}
    assert numbers <= {str(number) for number in range(1, 31)}
    assert len(CASES) == len(all_cases()) == len({case.number for case in CASES.values()})


@pytest.mark.long
def test_a_million_triangles(device):
    outcome = CASES["random-triangles"].run(Bench(device, triangles=1_000_000))
    assert outcome.passed, outcome


# The parts


def test_the_worst_of_several():
    fine, off = Outcome(0, 1.0, 32.0, "bounds", 2.0), Outcome(0, 40.0, 32.0, "bounds", 90.0)
    wrong, undefined = Outcome(3), Outcome(0, float("nan"), 32.0, "bounds")
    assert bench_module.worst([fine, fine]).passed
    assert bench_module.worst([fine, off]).error == 40.0
    assert bench_module.worst([off, fine]).amplification == 90.0
    for bad in (off, wrong, undefined):
        for outcomes in ([fine, bad], [bad, fine], [fine, bad, wrong]):
            assert not bench_module.worst(outcomes).passed
    assert bench_module.worst([wrong, off, wrong]).wrong == 6


def test_a_wrong_depth_is_noticed(device):
    """`Spoiled` leaves depths as they are."""
    frame = Bench(device).draw(flat.scene_of(np.array([[2.0, 2], [9, 3], [4, 9]]), flat.ONE, (12, 12)))
    assert bench_module.against_oracle(frame).passed
    layers = {"id": frame["id"], "Z": frame["Z"] * np.float32(1.0 + 1e-6)}
    off = Frame(frame.rgba, layers, frame.scene, frame.settings, dict)
    assert bench_module.against_oracle(off).wrong == 1


# The command


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
    assert code == 0
    assert "2 of 2 cases: 2 passed" in out
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
