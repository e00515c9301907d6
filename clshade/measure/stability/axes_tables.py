"""Errors and times along the axes of stiffness as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ..report.csv_table import power_fields, time_fields
from ..report.power_law import expected
from .axes import PLAIN, SIDE, USELESS, Axis, Series, stats

Found = dict[Axis, list[Series]]
ABOUT = (
    f"RMS of |value - oracle| / light over an image of {SIDE}x{SIDE} pixels, light being the most that a point of the scene "
    "can send, then milliseconds of a frame; wrong: pixels of wrong coverage, where there are any; oracle: how large its "
    "own error may be, below which nothing is known"
)
TIMES = f"{PLAIN} is computed by NumPy: its times say how they grow, not how fast float32 is"
CSV = (
    *("axis", "stiffness", "way", "rms", "largest", "wrong", "ms", "ms_low", "ms_high", "oracle"),
    *("of", "power", "power_low", "power_high", "expected"),
)


def _off(series: Sequence[Series]) -> list[Series]:
    """Return the ways with pixels of wrong coverage."""
    return [each for each in series if any(point.wrong for point in each.points)]


def header(series: Sequence[Series], axis: Axis) -> text_tables.Row:
    ways = [each.way for each in series]
    return (
        axis.name,
        *ways,
        "oracle",
        *(f"{each.way}: wrong" for each in _off(series)),
        *(f"{way}: ms" for way in ways),
    )


def rows(series: Sequence[Series], axis: Axis) -> list[text_tables.Row]:
    found: list[text_tables.Row] = []
    for k, value in enumerate(axis.stiffness):
        errors = [digits(each.points[k].rms, 2) for each in series]
        wrong = [str("-" if each.points[k].wrong is None else each.points[k].wrong) for each in _off(series)]
        medians = [digits(ms.median if ms else None) for ms in (each.points[k].ms for each in series)]
        found.append((f"{value:g}", *errors, digits(axis.own(value), 2), *wrong, *medians))
    return found


def notes(series: Sequence[Series], axis: Axis) -> list[str]:
    """Return a sentence for each way: the powers that its error and its time follow, and the one expected."""
    said = []
    for each in series:
        power, time_power, last = each.power(), each.time_power(), each.fit[-1].stiffness if each.fit else None
        useless = last is not None and last < axis.stiffness[-1]
        where = (
            f" up to {last:g}; beyond it images are useless (errors above {USELESS:g}) or cannot be drawn"
            if useless
            else ""
        )
        if power is None:
            error = "too few to fit"
        elif all((point.rms or 0.0) <= axis.own(point.stiffness) for point in each.fit):
            error = f"power {power}; all within the oracle's own error: the two agree, and no more is known"
        else:
            error = f"power {power}{where}; {expected(power, axis.expected(each.way))}"
        time = "" if time_power is None else f"; time: power {time_power}"
        said.append(f"{each.way}: error: {error}{time}")
    return said


def lines(series: Sequence[Series], axis: Axis) -> list[str]:
    """Return one axis's table as lines for the terminal."""
    table = text_tables.as_lines(header(series, axis), rows(series, axis))
    said = [f"the oracle's own error is at most {axis.own_about}", *notes(series, axis)]
    return ["", axis.title, *table, *(text_tables.wrapped(note, 2) for note in said)]


def markdown(found: Found, device: str) -> str:
    text = ["# Error against stiffness", "", f"{device}. {ABOUT}. {TIMES}.", ""]
    for axis, series in found.items():
        text += [f"## {axis.title}", "", *text_tables.as_markdown(header(series, axis), rows(series, axis)), ""]
        text += [f"- {note}" for note in notes(series, axis)]
        text += [f"- the oracle's own error is at most {axis.own_about}", ""]
    return "\n".join(text)


def csv_rows(found: Found) -> list[text_tables.Row]:
    """Return one row per axis, stiffness and way, and per fitted power, in full precision."""
    rows: list[dict[str, object]] = []
    for axis, series in found.items():
        for each in series:
            name = {"axis": axis.name, "way": each.way}
            for point in each.points:
                times = {"ms": None} if point.ms is None else time_fields(point.ms)
                own = {"oracle": axis.own(point.stiffness)}
                rows.append({**name, **point._asdict(), **times, **own})
            law = {"expected": axis.expected(each.way).exponent}
            rows += [{**name, "of": "error", **power_fields(each.power()), **law}]
            rows += [{**name, "of": "time", **power_fields(each.time_power())}]
    return [tuple("" if row.get(key) is None else str(row[key]) for key in CSV) for row in rows]


FILES = ("axes.csv", "axes.json", "axes.md")


def write(found: Found, device: str, folder: Path) -> list[Path]:
    """Write FILES. Raises OutputError."""
    figures = {"device": device, "axes": [stats(axis, series) for axis, series in found.items()]}
    texts = (text_tables.as_csv(CSV, csv_rows(found)), json.dumps(figures, indent=2) + "\n", markdown(found, device))
    for name, text in zip(FILES, texts, strict=True):
        atomic_files.write_bytes(folder / name, text.encode())
    return [folder / name for name in FILES]
