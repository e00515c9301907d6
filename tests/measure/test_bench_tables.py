"""`bench`: exponents, tables, files, the command line. No times are judged."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import assert_refused, run
from speeds import SMALL, drawn_with, made_up, small_speed

from clshade.base import text_tables
from clshade.errors import ClshadeError
from clshade.images import png
from clshade.measure.bench import bench, figure, results, scaling, starting, tables, workloads
from clshade.measure.bench.peers import PEERS
from clshade.measure.bench.workloads import SCALING, WAYS, Workload

# Exponents


def test_powers():
    sizes = [10.0, 100.0, 1000.0, 10_000.0]
    assert scaling.power(sizes, [3.0 * n**1.2 for n in sizes]) == pytest.approx(1.2)
    assert scaling.power(sizes[:2], [1.0, 2.0]) is None
    fixed = 40.0
    linear = [fixed + 0.5 * n for n in sizes]
    assert scaling.power(sizes, linear) < 0.9
    assert scaling.power_beyond(sizes, linear, fixed, 0.1) == pytest.approx(1.0)
    # Points barely above the fixed cost are not used, nor are smaller ones.
    noisy = [3.0 * fixed, fixed - 1.0, *linear[1:]]
    assert scaling.power_beyond([1.0, *sizes], noisy, fixed, 0.1) == pytest.approx(1.0)
    assert scaling.power_beyond(sizes, linear, fixed, 2.0) is None  # only two points are that much above it
    assert scaling.power_beyond(sizes, [*linear[:3], None], fixed, 0.1) is None


def series_of(measure):
    made = scaling.scaling(measure)
    assert [each.name for each in made] == [f"{way}-{kind}" for way in WAYS for kind in ("triangles", "pixels")]
    return made


def test_series_are_drawn_from_small_to_large():
    asked = []

    def measure(name):
        asked.append(name)
        _, kind, size = name.split("-")
        count = 0 if size == "fixed" else int(size)
        if kind == "triangles":
            return drawn_with(count, 1.0 + 1e-3 * count, peak=100.0 + 1e-2 * count)
        return drawn_with(side=max(count, 16), ms=1.0 + 1e-4 * count**2, peak=50.0)

    triangles, pixels, *others = series_of(measure)
    names = list(SCALING)
    first = ["phong-triangles-fixed", *names[:9], "phong-pixels-fixed", *names[9:15], "gouraud-triangles-fixed"]
    assert asked[: len(first)] == first
    assert len(asked) == len(names) + 6
    assert [each.sizes for each in others] == [triangles.sizes, pixels.sizes] * 2
    assert triangles.sizes == sorted(triangles.sizes)
    assert triangles.exponents()["time beyond the fixed cost"] == pytest.approx(1.0, abs=1e-6)
    assert triangles.exponents()["memory beyond the fixed cost"] == pytest.approx(1.0, abs=1e-6)
    assert pixels.sizes[0] == 256**2
    assert pixels.exponents()["time"] < 1.0
    assert pixels.exponents()["memory beyond the fixed cost"] is None
    asked.clear()
    fewer = scaling.scaling(measure, 200 * 10**6)[0]
    assert fewer.sizes == triangles.sizes[:-3]
    assert asked[6:8] == [names[5], "phong-pixels-fixed"]


# Tables, files, the command


def test_verdicts():
    found = {(each.workload, each.what): (each.value, each.kept) for each in small_speed().verdicts()}
    assert found["w", "times as fast as llvmpipe"] == (6.0, True)
    assert found["w", "ms a frame"] == (2.0, False)
    assert found["start-up", "s with a warm cache"] == (0.5, True)
    assert found["start-up", "s with an empty cache"] == (4.0, False)
    assert found["scaling-phong-triangles", "exponent of time beyond the fixed cost"][1]
    assert len(found) == 7
    least = results.Verdict("", "", 150.0, 150.0, True)
    assert [least.kept, least._replace(value=149.0).kept, least._replace(value=None).kept] == [True, False, None]


def test_targets_are_said_if_asked_for():
    asked, plain = (tables.lines(small_speed(), targets=targets) for targets in (True, False))
    start = next(k for k, line in enumerate(asked) if line.startswith("target  "))
    count = len(small_speed().verdicts()) + 2  # a header, and an empty line
    assert asked[:start] + asked[start + count :] == plain
    assert not any(word in line for line in plain for word in ("asked for", "target"))
    assert any(line.startswith("phong-triangles ") and "0.9" in line for line in plain)
    assert any(line.startswith("empty  ") and "4.00" in line for line in plain)  # start-up


def test_the_tables_hold_what_was_found():
    lines = tables.lines(small_speed(), targets=True)
    # 100 triangles and pixels in 2 ms; 1e6 bytes in 2 ms are half of the copy's 1e9 per second and take as long at the
    # fill's 5e8; 1e7 operations half of 1e10.
    expected = "w 10x10 100 100.0 % 2.00 1.80 to 2.20 5 0.05 0.05 0.5 50.0 % 5 50.0 % 2 1 -"
    first, second = (
        " ".join(line.split())
        for line in lines
        if line.startswith("w  ") and "llvmpipe" not in line and "numpy" not in line and "%" in line
    )
    assert f"{first} {second.removeprefix('w ')}" == expected
    for block in tables.markdown(small_speed(), targets=True).split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1, block
    rows = list(csv.DictReader(io.StringIO(text_tables.as_csv(tables.CSV, tables.csv_rows(small_speed())))))
    assert [(row["workload"], row["peer"]) for row in rows] == [
        ("w", ""),
        *[*[(f"phong-triangles-{size}", "") for size in ("fixed", 10, 100, 1000)]],
        *[("w", "llvmpipe"), ("w", "numpy")],
        *[("start-up-warm", ""), ("start-up-empty", "")],
    ]
    assert float(rows[0]["copy_share"]) == pytest.approx(0.5)
    assert (float(rows[5]["ratio"]), float(rows[5]["bar"]), rows[6]["bar"]) == (6.0, 5.0, "")
    assert float(rows[8]["ms"]) == 4000.0
    assert (rows[5]["turn"], float(rows[5]["ratio_low"]), float(rows[5]["ratio_high"])) == ("3", 2.0, 9.0)
    assert float(rows[0]["floor_ms"]) == pytest.approx(2.0)


@pytest.mark.parametrize("part", ["all", "frames", "series"])
def test_the_figure(tmp_path, part):
    found = small_speed()
    if part == "frames":
        found = made_up(results.Result(found.results[0].workload, drawn_with()))
    if part == "series":
        found = replace(found, results=())
    figure.plot(found, tmp_path / "a.png")
    assert png.read(tmp_path / "a.png").std() > 20.0


def no_constants(text):
    raise AssertionError(f"{text} is no JSON")


@pytest.fixture
def small_workloads(monkeypatch):
    made = (
        *(Workload(name, f"small {name}", make) for name, make in SMALL.items() if name != "lights"),
        Workload("empty", "a small empty image", lambda: workloads.empty(8), peers=("write",), ratios={"write": 1e-9}),
    )
    monkeypatch.setattr(bench, "WORKLOADS", made)
    monkeypatch.setattr(bench, "NAMES", (*(each.name for each in made), starting.NAME))


@pytest.mark.long
@pytest.mark.usefixtures("small_workloads")
def test_the_command_writes_all(opened, capsys, tmp_path):
    command = ("bench", "object", "knot", "--device", opened.index, "--frames", "2", "--peers", "numpy")
    code, out, err = run(capsys, *command, "-o", tmp_path / "b")
    assert (code, err) == (0, [])
    assert {path.name for path in tmp_path.iterdir()} == {"b.csv", "b.json", "b.md", "b.png"}
    figures = json.loads((tmp_path / "b.json").read_text(), parse_constant=no_constants)
    assert [each["workload"] for each in figures["workloads"]] == ["object", "knot"]
    for each in figures["workloads"]:
        (peer,) = each["peers"]
        assert peer["picture"]["same"]
        assert peer["ratio"] == pytest.approx(peer["theirs_ms"]["median"] / peer["ours_ms"]["median"])
        assert each["drawn"]["frames"] == peer["turn"] == 2
        assert peer["rounds"] == 1
        assert peer["interval"][0] <= peer["ratio"] <= peer["interval"][1]
    assert opened.title in out
    assert opened.title in (tmp_path / "b.md").read_text()


@pytest.mark.long
@pytest.mark.usefixtures("small_workloads")
def test_what_fails_late_loses_nothing(opened, monkeypatch):
    def fail(*_):
        raise ClshadeError("no more processes")

    monkeypatch.setattr(bench, "start_up", fail)
    monkeypatch.setattr(bench, "scaling", fail)
    found = bench.measure_all(opened, ["quads", starting.NAME], (), 1, True, lambda _: None)
    assert found.failed == ("start-up: no more processes", "scaling: no more processes")
    assert found.results[0].drawn is not None
    assert not found.passed
    assert set(found.failed) <= set(tables.lines(found))


@pytest.mark.long
@pytest.mark.usefixtures("small_workloads")
def test_the_command_line(opened, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "bench", "quads", "--device", opened.index, "--frames", "1", "--peers", "none")
    assert (code, list(tmp_path.iterdir())) == (0, [])
    assert "quads" in out
    assert "its ms" not in out
    code, out, _ = run(
        capsys, "bench", "empty", "--device", opened.index, "--frames", "1", "--peers", "numpy", "--targets"
    )
    assert code == 0
    assert "times as fast as write" in out  # writing is measured with any peers
    monkeypatch.setattr(bench, "draw_apart", lambda name, device, frames: drawn_with(len(name), frames))
    code, out, _ = run(capsys, "bench", "--scaling", "--frames", "3", "--device", opened.index)
    assert code == 0
    assert "phong-pixels" in out
    assert "object" not in out.split("bar ")[0].split("grows")[0]
    code, out, err = run(capsys, "bench", "--list")
    assert (code, err) == (0, [])
    assert all(name in out for name in (*PEERS, "object", "knot", "quads", "start-up"))


REFUSED = [
    (("object-1024",), ("workload", "'object-1024'", "did you mean 'object-")),
    (("--peers", "lvmpipe"), ("--peers", "'lvmpipe'", "did you mean 'llvmpipe'?")),
    (("--peers", ""), ("--peers", "''")),
    (("--frames", "0"), ("--frames", "0")),
    (("--frames", "x"), ("--frames", "'x'")),
    (("--device", "nothing"), ("device", "'nothing'")),
    (("-o", "file/x"), ("file", "not a folder")),
]


@pytest.mark.usefixtures("opened")
@pytest.mark.parametrize(("options", "parts"), REFUSED, ids=[" ".join(options) for options, _ in REFUSED])
def test_refused(capsys, tmp_path, monkeypatch, options, parts):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    monkeypatch.setattr(bench, "measure", lambda *arguments: pytest.fail("something was measured"))
    assert_refused(run(capsys, "bench", *options), *parts)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
