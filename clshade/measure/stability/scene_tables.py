"""The stability of one scene as tables for the terminal, CSV, JSON and Markdown."""

from __future__ import annotations

import json
from pathlib import Path

from ...base import atomic_files, text_tables
from ...base.atomic_files import shown
from ...base.text_tables import digits
from . import rounding_tables
from .causes import CAUSES
from .scene_study import SceneStudy, WorstPixel

NOTHING = "nothing is visible: no triangle covers the center of a pixel"
HEADER = ("no", "cause", "row", "column", "face", "kappa", "n", "found", "expected")
ABOUT = "found, expected: the error and the most allowed, of the most light that the point can send"


def _row(number: int, each: WorstPixel) -> text_tables.Row:
    first = str(number), CAUSES.get(each.cause, each.cause), str(each.row), str(each.column), str(each.face)
    return (*first, digits(each.kappa), f"{each.exponent:g}", digits(each.found, 2), digits(each.expected, 2))


def _rows(study: SceneStudy) -> list[text_tables.Row]:
    return [_row(number, each) for number, each in enumerate(study.worst, 1)]


def _reasons(study: SceneStudy) -> list[str]:
    """Return each sentence once, after the numbers of its pixels."""
    numbers: dict[str, list[str]] = {}
    for number, each in enumerate(study.worst, 1):
        numbers.setdefault(each.why, []).append(str(number))
    return [f"{','.join(of)}: {why}" for why, of in numbers.items()]


def _gains(study: SceneStudy) -> tuple[text_tables.Row, list[text_tables.Row]]:
    """Return header and rows: the errors of the worst pixels, and those with other settings."""
    names = ["as drawn", *study.others]
    rows: list[text_tables.Row] = []
    for number, each in enumerate(study.worst, 1):
        pairs = [(each.found, each.expected), *(each.others[name] for name in study.others)]
        rows.append((str(number), *(digits(value, 2) for pair in pairs for value in pair)))
    header = "no", *(text for name in names for text in (f"{name}: found", "expected"))
    return header, rows


def _gain_lines(study: SceneStudy) -> list[str]:
    """Return a sentence for each other setting."""
    lines = []
    for name in study.others:
        pairs = [each.others[name] for each in study.worst]
        found, expected = (max(values) for values in zip(*pairs, strict=True))
        before = max(each.found for each in study.worst), max(each.expected for each in study.worst)
        lines.append(
            f"{name}: largest error there {found:.2g} instead of {before[0]:.2g}, "
            f"expected {expected:.2g} instead of {before[1]:.2g}"
        )
    return lines


def _facts(study: SceneStudy) -> list[tuple[str, str]]:
    scene, check, settings = study.frame.scene, study.check, study.frame.settings
    columns, rows = scene.camera.resolution
    name = shown(scene.name or "unnamed")
    which = "all" if check.complete else "a sample, and where it found rounding amplified most"
    facts = [
        ("scene", f"{name}, {scene.face_count:,} triangles, {columns}x{rows}"),
        ("drawn", f"{settings.shader}, {settings.visibility}, {settings.lighting_at}, {settings.precision}"),
        ("device", study.device),
        ("checked", f"{check.pixels:,} of {check.of:,} pixels: {which}"),
    ]
    quantiles = study.quantiles()
    if not quantiles:
        return [*facts, ("kappa", NOTHING)]
    checked = "" if check.complete else " checked"
    facts += [
        ("kappa", f"median {quantiles['median']:.3g}, 99 % {quantiles['p99']:.3g}, max {quantiles['max']:.3g}"),
        (
            "errors",
            f"{100.0 * study.within:.6g} % of the covered pixels{checked} are within bounds, "
            f"the largest is {check.bounds:.3g} of {check.allowed:.4g} bounds",
        ),
    ]
    return facts


def _verdict(study: SceneStudy) -> str:
    if study.passed:
        return "all within bounds"
    failed = study.check.lines()
    reasons = [] if study.check.passed else [failed[1], failed[3]]
    if study.rounding is not None and not study.rounding.spread.passed:
        reasons.append(rounding_tables.problem(study.rounding.spread))
    return f"FAILED: {'; '.join(reasons)}"


def lines(study: SceneStudy) -> list[str]:
    """Return the tables as lines for the terminal."""
    found = [text_tables.wrapped(f"{name:<9}{text}", 9) for name, text in _facts(study)]
    if study.worst:
        header, gains = _gains(study)
        found += ["", *text_tables.as_lines(HEADER, _rows(study), left=2), ABOUT, ""]
        found += [text_tables.wrapped(reason, 3) for reason in _reasons(study)]
        if study.others:
            found += ["", *text_tables.as_lines(header, gains)]
            found += [text_tables.wrapped(line, 2) for line in _gain_lines(study)]
    if study.rounding is not None:
        found += ["", *rounding_tables.lines(study.rounding)]
    return [*found, *study.notes, "", text_tables.wrapped(_verdict(study), 2)]


def markdown(study: SceneStudy) -> str:
    found = ["# Stability of a scene", "", *(f"- {name}: {text}" for name, text in _facts(study))]
    found += [*(f"- {note}" for note in study.notes), f"- {_verdict(study)}", ""]
    if study.worst:
        rows = [(*row, each.why) for row, each in zip(_rows(study), study.worst, strict=True)]
        found += ["## The worst pixels", "", *text_tables.as_markdown((*HEADER, "why"), rows), "", f"{ABOUT}.", ""]
        if study.others:
            found += ["## With other settings", "", *text_tables.as_markdown(*_gains(study)), ""]
            found += [*(f"- {line}" for line in _gain_lines(study)), ""]
    if study.rounding is not None:
        found += ["## Random rounding", "", *(f"- {line}" for line in rounding_tables.facts(study.rounding.spread)), ""]
    return "\n".join(found)


def _csv(study: SceneStudy) -> str:
    """Return one row per worst pixel, in full precision."""
    fields = ("row", "column", "face", "mesh", "kappa", "exponent", "found", "expected", "cause", "why")
    header = (
        "no",
        *fields,
        "x",
        "y",
        "z",
        *CAUSES,
        *(f"{name} {pair}" for name in study.others for pair in HEADER[-2:]),
    )
    rows = []
    for number, each in enumerate(study.worst, 1):
        others = (value for name in study.others for value in each.others[name])
        values = (*(getattr(each, name) for name in fields), *each.point, *each.factors.values(), *others)
        rows.append((str(number), *map(str, values)))
    return text_tables.as_csv(header, rows)


def write(study: SceneStudy, folder: Path) -> list[Path]:
    """Write stability.csv, .json and .md."""
    texts = {
        "stability.csv": _csv(study),
        "stability.json": json.dumps(study.stats(), indent=2) + "\n",
        "stability.md": markdown(study),
    }
    for name, text in texts.items():
        atomic_files.write_bytes(folder / name, text.encode())
    return [folder / name for name in texts]
