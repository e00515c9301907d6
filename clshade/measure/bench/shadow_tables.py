"""The results of `bench --shadows` as tables for the terminal, CSV, JSON and Markdown, and as a figure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ...images import figures
from .results import Verdict
from .shadow_rays import WORKLOADS
from .shadow_results import LightTimes, ShadowTimes
from .tables import TARGETS, paths, verdict_row

RATES = ("scene", "light", "rays", "dark", "our Mrays/s", "Embree's", "ratio", "of medians", "95 %", "turns")
BUILDS = ("scene", "triangles", "our build, ms", "Embree's", "our bytes a triangle", "Embree's")
ANSWERS = ("scene", "light", "differ", "decided", "ties", "ours wrong", "Embree wrong", "of the others", "wrong")
NOTES = (
    "light: x16, 16 points at random of a sphere about it, each pixel's own, of every eighth block; AO: so many rays of "
    "ambient occlusion, at random about the face's normal, by their cosine",
    "rays: from what each pixel shows to the light, where it shines on that side of the face; blocks of 4x4 pixels; both "
    "traced in turns in a process that has one processor",
    "Mrays/s: of the fastest turn; of medians: their ratio with its bootstrap interval",
    "build: the fastest; Embree's bytes: by which its process grew when it first built, what it needs to build included",
    "decided: exactly, in integers, of the rays on which both differ, evenly spread; ties: where a change by 2^-40 of the "
    "lengths changes the answer; of the others: rays on which both agree, decided likewise",
)
CSV = (
    *("scene", "triangles", "light", "rays", "dark", "mrays_s", "embree_mrays_s", "ratio", "ratio_of_medians"),
    *("ratio_low", "ratio_high", "turns", "build_ms", "embree_build_ms", "bytes", "embree_bytes"),
    *("differ", "checked", "ties", "ours_wrong", "theirs_wrong", "agreed", "both_wrong"),
)


@dataclass(frozen=True)
class ShadowSpeed:
    """All results of a run. device, machine: descriptions."""

    device: str
    machine: str
    results: tuple[ShadowTimes, ...]

    @property
    def passed(self) -> bool:
        return all(each.passed for each in self.results)

    def verdicts(self) -> list[Verdict]:
        named = {each.name: each for each in WORKLOADS}
        return [verdict for each in self.results for verdict in each.verdicts(named[each.name])]

    def stats(self) -> dict[str, Any]:
        return {
            "device": self.device,
            "machine": self.machine,
            "scenes": [each.stats() for each in self.results],
            "bars": [each.stats() for each in self.verdicts()],
        }


def _rate(result: ShadowTimes, number: str, each: LightTimes) -> text_tables.Row:
    interval = each.interval
    return (
        result.name,
        number,
        f"{each.rays:,}",
        f"{100.0 * each.dark / each.rays:.1f} %",
        *map(digits, (each.ours_rate, each.theirs_rate, each.least_ratio, each.ratio)),
        "-" if interval is None else f"{digits(interval[0])} to {digits(interval[1])}",
        str(len(each.ours_ms)),
    )


def _build(result: ShadowTimes) -> text_tables.Row:
    ours, theirs = result.ours, result.theirs
    return (
        result.name,
        f"{result.triangles:,}",
        digits(min(ours.ms)),
        digits(min(theirs.ms) if theirs else None),
        digits(ours.bytes),
        digits(theirs.bytes if theirs else None),
    )


def _answers(result: ShadowTimes, number: str, each: LightTimes) -> text_tables.Row:
    counts = vars(each.answers)
    return (result.name, number, *(f"{count:,}" for count in counts.values()))


def _tables(speed: ShadowSpeed, targets: bool) -> list[tuple[str, int, text_tables.Row, list[text_tables.Row]]]:
    """Return title, number of text columns, header and rows of each table that is not empty."""
    lights = [(result, *each) for result in speed.results for each in result.numbered]
    decided = [_answers(*each) for each in lights if each[2].theirs_ms]
    found: list[tuple[str, int, text_tables.Row, list[text_tables.Row]]] = [
        ("Rays", 1, RATES, [_rate(*each) for each in lights]),
        ("Hierarchies", 1, BUILDS, [_build(each) for each in speed.results]),
        ("Answers", 1, ANSWERS, decided),
        ("Targets", 2, TARGETS, [verdict_row(each) for each in speed.verdicts()] if targets else []),
    ]
    return [each for each in found if each[3]]


def _facts(speed: ShadowSpeed) -> list[str]:
    return [f"device   {speed.device}", f"machine  {speed.machine}"]


def _notes(speed: ShadowSpeed) -> list[str]:
    titles = dict.fromkeys(f"Embree: {each.theirs.title}" for each in speed.results if each.theirs)
    missing = dict.fromkeys(each.missing for each in speed.results if each.missing)
    free = {each.name: each.processors for each in speed.results if each.processors != 1}
    loose = [f"{name}: {count or 'any number of'} processors, not one" for name, count in free.items()]
    return [*NOTES, *titles, *missing, *loose]


def lines(speed: ShadowSpeed, *, targets: bool = False) -> list[str]:
    """Return the tables as lines for the terminal. targets: also what was asked for."""
    found = [*(text_tables.wrapped(fact, 9) for fact in _facts(speed)), ""]
    for _, left, header, rows in _tables(speed, targets):
        found += [*text_tables.as_lines(header, rows, left), ""]
    return [*found, *(text_tables.wrapped(note, 2) for note in _notes(speed))]


def markdown(speed: ShadowSpeed, *, targets: bool = False) -> str:
    found = ["# Shadow rays", "", *(f"- {fact}" for fact in _facts(speed)), ""]
    for title, _, header, rows in _tables(speed, targets):
        found += [f"## {title}", "", *text_tables.as_markdown(header, rows), ""]
    return "\n".join([*found, *(f"- {note}" for note in _notes(speed)), ""])


def csv_rows(speed: ShadowSpeed) -> list[text_tables.Row]:
    """Return a row for each light in full precision; fields that do not apply are empty."""
    rows: list[dict[str, object]] = []
    for result in speed.results:
        theirs = result.theirs
        for number, each in result.numbered:
            rows.append(
                {
                    **{"scene": result.name, "triangles": result.triangles, "light": number},
                    **{"rays": each.rays, "dark": each.dark, "turns": len(each.ours_ms)},
                    **{"mrays_s": each.ours_rate, "embree_mrays_s": each.theirs_rate},
                    **{"ratio": each.least_ratio, "ratio_of_medians": each.ratio},
                    **dict(zip(("ratio_low", "ratio_high"), each.interval or (None, None), strict=True)),
                    **{"build_ms": min(result.ours.ms), "embree_build_ms": theirs and min(theirs.ms)},
                    **{"bytes": result.ours.bytes, "embree_bytes": theirs and theirs.bytes},
                    **vars(each.answers),
                }
            )
    return [tuple("" if row[name] is None else str(row[name]) for name in CSV) for row in rows]


def write(speed: ShadowSpeed, prefix: str, *, targets: bool = False) -> list[Path]:
    """Write CSV, JSON, Markdown and the figure; return their paths."""
    found = paths(prefix)
    texts = (
        text_tables.as_csv(CSV, csv_rows(speed)),
        json.dumps(speed.stats(), indent=2) + "\n",
        markdown(speed, targets=targets),
    )
    for path, text in zip(found, texts, strict=False):
        atomic_files.write_bytes(path, text.encode())
    _plot(speed, found[-1])
    return found


def _plot(speed: ShadowSpeed, path: Path) -> None:
    """Draw the rates of both as bars, one pair for each light."""
    lights = [(f"{result.name}, {number}", each) for result in speed.results for number, each in result.numbered]
    figure = figures.blank(6.5, 1.6 + 0.5 * len(lights))
    axes = figure.subplots()
    places = np.arange(len(lights))
    axes.barh(places - 0.2, [each.ours_rate for _, each in lights], 0.38, color=figures.OURS, label="clshade")
    theirs = [each.theirs_rate or 0.0 for _, each in lights]
    if any(theirs):
        axes.barh(places + 0.2, theirs, 0.38, color=figures.OTHER, label="Embree")
    axes.set_yticks(places, [name for name, _ in lights])
    axes.invert_yaxis()
    axes.set(xlabel="million rays a second, one thread")
    axes.legend(fontsize=8)
    figure.suptitle(f"{speed.device}\n{speed.machine}", fontsize=8)
    figures.save(figure, path, colors=64)
