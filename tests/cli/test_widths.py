"""Tables fit a terminal of 100 columns for any names and values, and nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import needs_device, run
from hypothesis import given
from hypothesis import strategies as st
from speeds import results_of, timed

from clshade.base import text_tables
from clshade.errors import ClshadeError
from clshade.images import compare, exr, statistics
from clshade.images.image_file import Picture
from clshade.measure.bench import bench
from clshade.measure.report import report
from clshade.measure.stability import stability
from clshade.measure.stability.cases import Outcome, all_cases
from clshade.measure.timing import Spread
from clshade.pipeline.opencl import device as devices

LONG = "a_name_with_very_many_letters" * 8
CELLS = st.text(alphabet="abc|. ", max_size=30).map(str.strip)


def assert_fits(text: str | list[str]) -> None:
    lines = text.splitlines() if isinstance(text, str) else "\n".join(text).splitlines()
    assert lines
    too_long = [line for line in lines if len(line) > 100]
    assert not too_long, too_long


# The table itself


@given(st.data(), st.integers(1, 14), st.integers(1, 4), st.integers(1, 2))
def test_any_table_fits_and_holds_every_cell(data, columns, count, left):
    left = min(left, columns)
    header, *rows = [[data.draw(CELLS) for _ in range(columns)] for _ in range(count)]
    lines = text_tables.as_lines(header, rows, left)
    assert_fits([*lines, "."])
    blocks = len(lines) // count
    assert len(lines) == blocks * count
    for k, row in enumerate((header, *rows)):
        words = " ".join(lines[block * count + k] for block in range(blocks)).split()
        for cell in row:
            assert all(word in words for word in cell.split()), (cell, words)


def test_what_does_not_fit_goes_on_below():
    header = ("name", *(f"column {k}" for k in range(20)))
    lines = text_tables.as_lines(header, [("one", *map(str, range(20))), ("two", *map(str, range(20, 40)))])
    assert_fits(lines)
    assert len(lines) == 9
    assert [line.split()[0] for line in lines] == ["name", "one", "two"] * 3
    assert lines[3].split()[:3] == ["name", "column", "9"]  # the first that did not fit above
    assert lines[4].split()[:2] == ["one", "9"]
    assert text_tables.as_lines(("a", "b"), [("x", "1")]) == ["a  b", "x  1"]


def test_names_without_end_are_cut_in_the_middle():
    (head, line) = text_tables.as_lines(("name", "n"), [("start" + LONG + "end", "12345")])
    assert_fits([head, line])
    assert line.startswith("start")
    assert line.endswith("end  12345")
    assert "..." in line
    assert_fits(text_tables.as_lines((LONG, LONG, LONG), [(LONG, LONG, LONG)], 2))


def test_paragraphs_are_wrapped_between_words():
    text = text_tables.wrapped("label   " + "some words " * 30, 8)
    assert_fits(text)
    assert [line[:8].strip() for line in text.splitlines()] == ["label", "", "", ""]
    assert " ".join(text.split()) == "label " + " ".join(["some words"] * 30)
    assert LONG in text_tables.wrapped(f"wrote {LONG}")


# All that commands print


def long_layers() -> dict[str, np.ndarray]:
    wild = np.float32([[1.2345678e-38, -9.8765432e37, np.nan, np.inf]])
    return {
        **dict.fromkeys("RGBA", wild),
        LONG: wild,
        f"{LONG}.X": wild,
        f"{LONG}.Y": wild,
        "id": np.uint32([[2**32 - 1] * 4]),
    }


def test_inspect():
    assert_fits(statistics.format_statistics(statistics.image_statistics(long_layers())))


def test_compare():
    changed = {
        name: np.where(np.isfinite(plane), plane / 2, plane).astype(plane.dtype)
        for name, plane in long_layers().items()
    }
    comparison = compare.compare_layers(Picture(changed, name="a"), Picture(long_layers(), name="b"), (), 1.2345678e-30)
    table = [line for line in comparison.lines() if not any(LONG in word for word in line.split())]
    assert len(table) > 10
    assert_fits(table)


def test_stability():
    worst = Outcome(123456, 1.23e-7, 16.0, "sqrt(n)*2^-24", 7.39e10, "some words about what was looked at " * 5)
    some = [stability.Result(case, "0:0", outcome, 12345.67) for case in all_cases() for outcome in (worst, Outcome())]
    assert_fits(stability.summarize(some, {"device 0:0": "a device"}).lines())
    assert_fits(stability.listing())


def test_bench():
    assert_fits(bench.listing())
    slow = {"triangles": 16_777_216, "resolution": (16384, 16384), "ms": Spread(12345.6, 123456.7, 234567.8)}
    wide = {f"a-stage-{k}": 12345.678 for k in range(20)}
    error = ClshadeError("some words about what was wrong " * 5)
    timings = results_of(timed(LONG, **slow, stages=wide), timed(), errors={"w": error})
    assert_fits([line for line in timings.lines() if LONG not in line])


def test_report_lists():
    assert_fits(report.listing())  # its tables: tests/measure/test_report.py


def test_devices(monkeypatch, capsys):
    name = "Some Processor " * 9
    infos = [devices.DeviceInfo("0:0", "A Platform", name, driver="1.2.3 " * 20, works=True, problem="")]
    infos += [devices.DeviceInfo("1:0", "Another", name, problem="it does not build a program, " * 9)]
    for listed in (infos, infos[1:], []):
        monkeypatch.setattr(devices, "list_devices", lambda listed=listed: listed)
        assert_fits(run(capsys, "devices", "--verbose")[1])


@pytest.mark.long
@needs_device
def test_render(folder, capsys):
    command = ("render", "quads", "--resolution", "32,24", "-o", "out", "--layers", "Z,id", "--check", "all")
    code, out, _ = run(capsys, *command, "--explain")
    assert code == 0
    assert_fits(out)
    for word in ("scene", "device", "frame", "wrote", "check", "explain", "left out: ", "saved: "):
        assert word in out
    assert set(exr.read("out.exr")[0]) >= {"R", "Z", "id"}
