"""`stability`: every case passes and every case can fail; the output and files of the command."""

from __future__ import annotations

import csv
import itertools
import json
import math
import string
from fractions import Fraction

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade.measure.stability import curves, stability
from clshade.measure.stability.cases import Bench, Case, Outcome, all_cases, flat
from clshade.measure.stability.cases import bench as bench_module
from clshade.measure.stability.cases.coverage import triangles_of_size
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


def rational_mask(xy: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Return the pixels of one snapped triangle in rational arithmetic, (rows, columns) bool, row 0 at the BOTTOM.

    The top-left rule treats a center as displaced a little to the right and, far less, downwards. The pixels of a row
    are therefore a half-open interval between two crossings; edges that end at the row's height belong to the side
    below it.
    """
    mask = np.zeros((rows, columns), bool)
    corners = [[Fraction(int(value), flat.SUB) for value in corner] for corner in xy]
    low, high = min(c[1] for c in corners), max(c[1] for c in corners)
    for row in range(max(math.floor(low - Fraction(1, 2)), 0), min(math.ceil(high), rows - 1) + 1):
        y = row + Fraction(1, 2)
        crossings = []
        for i in range(3):
            (x0, y0), (x1, y1) = corners[i], corners[i - 2]
            if (y0 < y) != (y1 < y):
                crossings.append(x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        if crossings:
            first = max(math.ceil(min(crossings) - Fraction(1, 2)), 0)
            end = min(math.ceil(max(crossings) - Fraction(1, 2)), columns)
            mask[row, first : max(first, end)] = True
    return mask


def test_integer_coverage_is_rational_coverage():
    for size in (1, 4, 16):
        xy, _ = triangles_of_size(np.random.default_rng(size), size, 300)
        for corners in xy:
            moved = corners - flat.SUB * (corners.min(axis=0) // flat.SUB)
            columns, rows = size + 2, size + 1
            integers = flat.exact(moved[None], (columns, rows))[::-1] > 0
            assert np.array_equal(rational_mask(moved, columns, rows), integers)


def test_rational_coverage_notices_an_edge():
    """A square's right column and bottom row of centers lie on its edges, and do not belong to it."""
    square = flat.HALF * np.array([[1, 1], [9, 1], [1, 9]])
    mask = rational_mask(square, 6, 6)
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


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("--case", "nothing"), ("--case: expected names or numbers of shared-edges", "'nothing'")),
        (("--case", "6", "--triangles", "0"), ("--triangles", "above 0")),
        (("--case", "6", "--format", "pdf"), ("--format", "--case")),
        (("--case", "6", "--out", "file/x"), ("file/x", "--out")),
        (("--format", "gif"), ("--format", "png, pdf, svg", "'gif'")),
        (("quads", "--case", "6"), ("--case: is for the cases, and cannot go with 'quads'",)),
        (("no_such_scene",), ("SCENE: expected a file or one of teapot", "'no_such_scene'")),
        (("quads", "--list"), ("--list: is for the cases",)),
        (("quads", "teapot"), ("SCENE alone", "'teapot'")),
        (("--samples", "4"), ("--samples: needs a SCENE",)),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_bad_input(capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert_refused(run(capsys, "stability", *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.long
def test_the_whole_command(tmp_path, device, monkeypatch):
    monkeypatch.setattr(curves, "FRAMES", 1)
    assert stability.run(device.index, out=tmp_path, triangles=TRIANGLES, formats=("png", "pdf"))
    assert (tmp_path / "curves.png").stat().st_size > 50_000
    assert (tmp_path / "curves.pdf").read_bytes().startswith(b"%PDF")
    assert len(json.loads((tmp_path / "stability.json").read_text())["cases"]) == len(CASES)
