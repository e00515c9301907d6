"""Tables fit a terminal of 100 columns for any names and values, and nothing is lost."""

from __future__ import annotations

import numpy as np
from command_line import run
from hypothesis import given
from hypothesis import strategies as st

from clshade.base import text_tables
from clshade.images import compare, statistics
from clshade.images.image_file import Picture
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


def test_names_without_end_are_cut_in_the_middle():
    (head, line) = text_tables.as_lines(("name", "n"), [("start" + LONG + "end", "12345")])
    assert_fits([head, line])
    assert line.startswith("start")
    assert line.endswith("end  12345")


# All that commands print


def long_layers() -> dict[str, np.ndarray]:
    wild = np.float32([[1.2345678e-38, -9.8765432e37, np.nan, np.inf]])
    return {
        **dict.fromkeys(("R", "G", "B", "A", LONG, f"{LONG}.X", f"{LONG}.Y"), wild),
        "id": np.uint32([[2**32 - 1] * 4]),
    }


def test_statistics_and_comparisons():
    assert_fits(statistics.format_statistics(statistics.image_statistics(long_layers())))
    halves = {name: plane / 2 if plane.dtype == np.float32 else plane for name, plane in long_layers().items()}
    comparison = compare.compare_layers(Picture(halves, name="a"), Picture(long_layers(), name="b"), (), 1.2345678e-30)
    table = [line for line in comparison.lines() if not any(LONG in word for word in line.split())]
    assert len(table) > 10
    assert_fits(table)


def test_devices(monkeypatch, capsys):
    name = "Some Processor " * 9
    infos = [devices.DeviceInfo("0:0", "A Platform", name, driver="1.2.3 " * 20, works=True, problem="")]
    infos += [devices.DeviceInfo("1:0", "Another", name, problem="it does not build a program, " * 9)]
    monkeypatch.setattr(devices, "list_devices", lambda: infos)
    assert_fits(run(capsys, "devices", "--verbose")[1])
