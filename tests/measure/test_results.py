"""Results of commands: one list of columns gives terminal, CSV, JSON, Markdown and HTML."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest

from clshade.errors import OutputError
from clshade.measure.results import Column, Results, Table, check_files, files, wrote

COLUMNS = (
    Column("variant", "name", lambda row: row[0], str),
    Column("ms", "frame_ms", lambda row: row[1]),
    Column("", "psnr", lambda row: row[2]),
    Column("share", "", lambda row: row[1] / 10, lambda value: f"{value:.0%}"),
)
RECORDS = [("plain | bar", 1.23456789, None), ("<fast>", 2.0, float("inf"))]
RESULTS = Results(
    "Speed",
    {"device": "a CPU"},
    [Table("All frames", COLUMNS, RECORDS, about="Median.", notes=("ms: of 5 frames",)), Table("None", COLUMNS, [])],
    {"seed": 7},
)


def test_people_see_titled_columns_with_few_digits() -> None:
    assert RESULTS.lines() == [
        "device  a CPU",
        *("", "All frames", "Median."),
        "variant        ms  share",
        "plain | bar  1.23    12%",
        "<fast>          2    20%",
        "ms: of 5 frames",
    ]


def test_programs_read_named_columns_in_full_precision() -> None:
    rows = list(csv.DictReader(io.StringIO(RESULTS.tables[0].csv())))
    assert rows[0] == {"name": "plain | bar", "frame_ms": "1.23456789", "psnr": ""}
    document = json.loads(RESULTS.json())
    assert document["device"] == "a CPU"
    assert document["seed"] == 7
    assert document["all_frames"][1] == {"name": "<fast>", "frame_ms": 2.0, "psnr": None}  # JSON has no infinity
    assert document["none"] == []


def test_markdown_and_html_escape_names() -> None:
    assert r"| plain \| bar | 1.23 | 12% |" in RESULTS.markdown()
    assert "- ms: of 5 frames" in RESULTS.markdown()
    page = RESULTS.html("above", style="p { color: red }").decode()
    assert "&lt;fast&gt;" in page
    assert "<fast>" not in page
    assert page.index("above") < page.index("All frames")
    assert "color: red" in page


def test_files_are_checked_before_and_written_after(tmp_path: Path) -> None:
    paths = files(tmp_path / "speed", "png")
    assert [path.name for path in paths] == ["speed.csv", "speed.json", "speed.md", "speed.png"]
    check_files(paths)
    written = RESULTS.write(tmp_path / "speed")
    assert written == paths[:3]
    assert all(path.read_text() for path in written)
    assert wrote(written[:1]) == [f"wrote {tmp_path / 'speed.csv'}"]
    with pytest.raises(OutputError, match="there is no folder"):
        check_files(files(tmp_path / "missing" / "speed"))
