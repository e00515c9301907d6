"""The results of `stability` as tables for the terminal, CSV and Markdown, and images of failures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base import atomic_files, text_tables
from ...base.arrays import Array
from ...images import png
from ...images.tonemap import tonemap
from .cases import Case, Outcome

COLUMNS = (
    "no",
    "case",
    "stressed",
    "expected",
    "wrong",
    "error",
    "allowed",
    "unit",
    "amplification",
    "seconds",
    "verdict",
)


@dataclass(frozen=True)
class Result:
    """One case on one device. problem: why it could not be completed, or what else failed; empty if nothing did."""

    case: Case
    device: str
    outcome: Outcome
    seconds: float
    problem: str = ""

    @property
    def passed(self) -> bool:
        return not self.problem and self.outcome.passed


def row(result: Result) -> dict[str, str]:
    """Return the columns of a result as strings."""
    case, outcome = result.case, result.outcome
    measured = bool(outcome.unit)
    return {
        "no": case.number,
        "case": case.name,
        "stressed": case.title,
        "expected": case.expected,
        "wrong": str(outcome.wrong),
        "error": f"{outcome.error:.3g}" if measured else "",
        "allowed": f"{outcome.limit:g}" if measured else "",
        "unit": outcome.unit,
        "amplification": "" if outcome.amplification is None else f"{outcome.amplification:.3g}",
        "seconds": f"{result.seconds:.2f}",
        "verdict": "pass" if result.passed else "FAIL",
    }


def _error(cells: dict[str, str]) -> str:
    return f"{cells['error']} of {cells['allowed']} {cells['unit']}" if cells["unit"] else "-"


def line(result: Result) -> str:
    """Return one line of the table; a failing case has a second one."""
    cells = row(result)
    text = (
        f"{cells['no']:>4} {cells['case']:<21} {cells['wrong']:>6}  {_error(cells):<28}"
        f" {cells['amplification'] or '-':>8} {cells['seconds']:>7}  {cells['verdict']}"
    )
    if result.passed:
        return text
    why = f"expected of {result.case.title}: {result.case.expected}; {result.problem or result.outcome.detail}"
    return f"{text}\n{text_tables.wrapped(f'     {why}', 7)}"


HEADER = f"{'no':>4} {'case':<21} {'wrong':>6}  {'error':<28} {'amplif.':>8} {'seconds':>7}  verdict"


def as_markdown(results: Sequence[Result], notes: Sequence[str]) -> str:
    """Return a table for each device."""
    header = ("no", "case", "stressed", "expected", "wrong", "error", "amplification", "s", "verdict")
    lines = ["# Stiff and extreme cases", ""]
    for device in dict.fromkeys(result.device for result in results):
        lines += [f"## {device}", ""]
        lines += text_tables.as_markdown(header, [_shown(result) for result in results if result.device == device])
        lines.append("")
    return "\n".join([*lines, *notes, ""])


def _shown(result: Result) -> text_tables.Row:
    cells = row(result)
    stressed = f"{cells['stressed']} ({result.outcome.detail})"
    error, amplification = _error(cells), cells["amplification"] or "-"
    first = (cells["no"], cells["case"], stressed, cells["expected"], cells["wrong"])
    return (*first, error, amplification, cells["seconds"], cells["verdict"])


# Images


def _picture(values: Array, scale: float) -> Array:
    """Return an image, (M, N, 3) uint8, of colors, of ids (a color for each, 0 black), or of a mask."""
    if values.ndim == 2:
        ids = values.astype(np.uint64)
        mixed = (ids * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
        color = np.stack([(mixed >> np.uint64(8 * k)) & np.uint64(0xFF) for k in range(3)], axis=-1) | np.uint64(0x40)
        return np.where(ids[..., None] > 0, color, 0).astype(np.uint8)
    finite = np.nan_to_num(np.asarray(values, np.float64) / scale, nan=0.0, posinf=1.0, neginf=0.0)
    return tonemap(np.clip(finite, 0.0, 1.0).astype(np.float32), "srgb", 0.0)


def write_pictures(result: Result, folder: Path) -> list[Path]:
    """Write the rendered, expected and difference image of a failing case, if it has images."""
    if result.outcome.pictures is None:
        return []
    rendered, expected = (np.asarray(picture) for picture in result.outcome.pictures)
    finite = np.abs(expected[np.isfinite(expected)])
    scale = float(finite.max(initial=0.0)) or 1.0
    if rendered.ndim == 2:
        difference = np.repeat(np.where(rendered != expected, 255, 0).astype(np.uint8)[..., None], 3, axis=2)
    else:
        with np.errstate(invalid="ignore"):
            apart = np.abs(rendered.astype(np.float64) - expected)
        apart = np.where(np.isfinite(apart), apart, np.inf)
        seen = apart[np.isfinite(apart)].max(initial=0.0)
        difference = _picture(apart, float(seen) or 1.0)
    device = re.sub(r"\W+", "-", result.device.partition(":")[0]).strip("-").lower()
    paths = []
    for name, picture in (
        ("rendered", _picture(rendered, scale)),
        ("expected", _picture(expected, scale)),
        ("difference", difference),
    ):
        paths.append(folder / f"{result.case.name}-{device}-{name}.png")
        png.write(paths[-1], picture)
    return paths


def write(results: Sequence[Result], notes: Sequence[str], folder: Path) -> list[Path]:
    """Write all results as CSV and Markdown."""
    paths = [folder / "stability.csv", folder / "stability.md"]
    rows = ((each.device, *row(each).values(), each.problem or each.outcome.detail) for each in results)
    texts = text_tables.as_csv(("device", *COLUMNS, "detail"), rows), as_markdown(results, notes)
    for path, text in zip(paths, texts, strict=True):
        atomic_files.write_bytes(path, text.encode())
    return paths
