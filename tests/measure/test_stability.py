"""`stability`: every case passes and every case can fail; the output and files of the command."""

from __future__ import annotations

import csv
import io
import string
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clshade.cli.main import main
from clshade.errors import InputError
from clshade.measure.stability import curves, results, stability
from clshade.measure.stability.cases import Bench, Case, Outcome, all_cases, flat
from clshade.measure.stability.cases import bench as bench_module
from clshade.measure.stability.cases.coverage import triangles_of_size
from clshade.oracle import coverage
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

    def light(self, *arguments, **options):
        return super().light(*arguments, **options) * np.float32(1.25) + np.float32(1e-3)

    def look_up(self, *arguments):
        return super().look_up(*arguments) + 1e-5

    def through_file(self, channels, **options):
        found, warnings = super().through_file(channels, **options)
        found["R"] = found["R"] + 1
        return found, warnings


def cases() -> list:
    """Return every case, the slow ones marked long."""
    return [pytest.param(case, id=name, marks=[pytest.mark.long] * case.slow) for name, case in CASES.items()]


@pytest.mark.long
@pytest.mark.parametrize("case", cases())
def test_every_case_passes(device, case, tmp_path):
    outcome = case.run(Bench(device, tmp_path, triangles=TRIANGLES))
    assert outcome.passed, outcome
    assert not list(tmp_path.iterdir())


@pytest.mark.sampled
@pytest.mark.parametrize("case", cases())
def test_every_case_can_fail(device, case, tmp_path):
    """An image wrong in one pixel, light off by a quarter, a texel by 1e-5, a file by 1: found by the cases
    affected."""
    assert not case.run(Spoiled(device, tmp_path, triangles=TRIANGLES)).passed


def test_the_list_is_complete():
    numbers = {case.number.rstrip(string.ascii_lowercase) for case in CASES.values()}
    assert numbers == {str(number) for number in range(1, 31)}
    assert len(CASES) == len(all_cases())
    for case in CASES.values():
        assert case.title
        assert case.expected
        assert f"{case.number:>4} {case.name}" in stability.listing()


@pytest.mark.long
def test_a_million_triangles(device, tmp_path):
    outcome = CASES["random-triangles"].run(Bench(device, tmp_path, triangles=1_000_000))
    assert outcome.passed, outcome


# The parts


def test_rational_and_integer_coverage_agree():
    for size in (1, 4, 16):
        xy, _ = triangles_of_size(np.random.default_rng(size), size, 60)
        for corners in xy:
            moved = corners - 256 * (corners.min(axis=0) // 256)
            assert np.array_equal(
                flat.rational_mask(moved, size + 2, size + 1), coverage.triangle_mask(moved, size + 2, size + 1)
            )


def test_rational_coverage_notices_an_edge():
    """A square's right column and bottom row of centers lie on its edges, and do not belong to it."""
    square = np.array([[128, 128], [1152, 128], [128, 1152]])
    mask = flat.rational_mask(square, 6, 6)
    assert not mask[0].any()
    assert mask[1, :3].all()
    assert not mask[1, 3]


def test_the_worst_of_several():
    fine, off = Outcome(0, 1.0, 32.0, "bounds", 2.0), Outcome(0, 40.0, 32.0, "bounds", 90.0)
    wrong, undefined = Outcome(3), Outcome(0, float("nan"), 32.0, "bounds")
    assert bench_module.worst([fine, fine]).passed
    assert bench_module.worst([fine, off]).error == 40.0
    assert bench_module.worst([off, fine]).amplification == 90.0
    for bad in (off, wrong, undefined):
        for given in ([fine, bad], [bad, fine], [fine, bad, wrong]):
            assert not bench_module.worst(given).passed
    assert bench_module.worst([wrong, off, wrong]).wrong == 6


@pytest.mark.long
def test_naive_forms_are_worse(device, tmp_path):
    """The baselines of the figure are as described: wrong where float32 is, correct elsewhere."""
    bench = Bench(device, tmp_path)
    highlight = curves.exponent(bench, 3.0)
    for curve in (highlight, curves.offset(bench), curves.distance(bench)):
        assert len(curve.ours) == len(curve.naive) == len(curve.stiffness)
        assert not max(curve.naive) <= 50 * max(curve.ours)
        assert curve.naive[0] <= 20 * max(curve.ours[0], 1e-8)
    assert all(ours <= bound for ours, bound in zip(highlight.ours, highlight.bound, strict=True))


# The command


def made_up(name: str, outcome: Outcome | Exception, number: str = "1") -> Case:
    def run(bench: Bench) -> Outcome:
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    return Case(number, name, "nothing", "all is well", run)


def run(monkeypatch, device, folder, cases: list[Case]) -> tuple[bool, str]:
    monkeypatch.setattr(stability, "all_cases", lambda: tuple(cases))
    monkeypatch.setattr(stability, "devices", lambda name: [device])
    text = io.StringIO()
    passed = stability.run(out=folder, names=[case.name for case in cases], stream=text)
    return passed, text.getvalue()


def test_a_failing_case_shows_pictures(monkeypatch, device, tmp_path):
    rgb = np.random.default_rng(1).uniform(0, 1e3, (5, 7, 3))
    nan = np.where(np.arange(7)[None, :, None] == 3, np.nan, rgb)
    ids = np.arange(35).reshape(5, 7)
    failing = [
        made_up("colors", Outcome(0, 40.0, 32.0, "bounds", pictures=(nan, rgb))),
        made_up("ids", Outcome(2, pictures=(ids, ids * 0))),
        made_up("broken", ValueError("two\nlines")),
    ]
    passed, text = run(monkeypatch, device, tmp_path / "new", [made_up("good", Outcome()), *failing])
    assert not passed
    assert "3 failed" in text
    assert "ValueError: two lines" in text
    names = {path.name.split("-")[0] + path.name[-14:] for path in (tmp_path / "new").glob("*.png")}
    assert len(names) == 6
    rows = list(csv.DictReader((tmp_path / "new" / "stability.csv").open()))
    assert [row["verdict"] for row in rows] == ["pass", "FAIL", "FAIL", "FAIL"]
    assert (tmp_path / "new" / "stability.md").read_text().count("| FAIL |") == 3


def test_other_bits_on_another_device_fail():
    case = made_up("bits", Outcome())
    first = results.Result(case, "one", Outcome(fingerprint="a"), 0.0)
    same, other = (replace(first, device="two", outcome=Outcome(fingerprint=f)) for f in "ab")
    assert stability.compared(same, [first]).passed
    assert stability.compared(other, [first]).problem == "other bits than one"


def test_without_mpmath_it_says_so(monkeypatch, device, tmp_path):
    monkeypatch.setattr(stability.importlib.util, "find_spec", lambda name: None)
    passed, text = run(monkeypatch, device, tmp_path, [made_up("good", Outcome())])
    assert passed
    assert "mpmath is not installed (pip install" in text


def test_the_command_line(monkeypatch, capsys, tmp_path, device):
    assert main(["stability", "--list"]) == 0
    assert capsys.readouterr().out.count("\n") == len(CASES)
    chosen = ["stability", "--device", device.index, "--out", str(tmp_path / "out"), "--case", "windings", "6"]
    assert main(chosen) == 0
    shown = capsys.readouterr().out
    assert "2 runs of 2 cases" in shown
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"stability.csv", "stability.md"}
    monkeypatch.setattr(stability, "Bench", Spoiled)
    assert main(chosen) == 1
    assert len(list((tmp_path / "out").glob("windings-*.png"))) == 3
    assert main(["stability", "--case", "nothing"]) == 2
    assert main(["stability", "--case", "6", "--triangles", "0"]) == 2
    (tmp_path / "file").write_text("")
    assert main([*chosen[:4], str(tmp_path / "file" / "x"), "--case", "6"]) == 2
    assert capsys.readouterr().err.count("\n") == 3


def test_an_unknown_case_names_all():
    with pytest.raises(InputError, match=r"expected names or numbers of shared-edges.*found 'x'"):
        stability.chosen(["x"])
    assert [case.number for case in stability.chosen(["22b", "exponents"])] == ["22b", "23"]


@pytest.mark.long
def test_the_whole_command(tmp_path, device):
    stability.run(device.index, out=Path(tmp_path), triangles=TRIANGLES)
    assert (tmp_path / "stability.png").stat().st_size > 50_000
