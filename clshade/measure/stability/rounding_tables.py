"""Random rounding as tables for the terminal: of one scene, and of the cases."""

from __future__ import annotations

from collections.abc import Sequence

from ...base import text_tables
from ...base.text_tables import digits
from ..rounding.spread import CAREFUL, QUANTILES, Spread
from .causes import CAUSES
from .scene_study import RoundingStudy, WorstPixel

PIXELS = ("no", "cause", "row", "column", "mesh", "kappa", "n", "found", "expected")


def problem(spread: Spread) -> str:
    """Return why the bounds failed."""
    if not spread.same:
        return "random rounding: other bits than the image's where nothing was moved"
    return f"random rounding: {int(spread.too_small.sum())} pixels above their bounds"


def facts(spread: Spread) -> list[str]:
    """Return sentences on the digits, and on the bounds that are too small or too large."""
    lines = []
    for kind, values in spread.quantiles().items():
        texts = ", ".join(f"{name} {values[name]:.2f}" for name in QUANTILES)
        lines.append(f"digits {kind}: {texts}")
    counted = int(spread.counted.sum())
    lines.append(f"largest error: {digits(100.0 * spread.worst)} % of its bound, of {counted:,} pixels")
    lines.append(f"bounds too small: {int(spread.too_small.sum())}")
    share = 100.0 * spread.too_large.sum() / max(counted, 1)
    lines.append(f"bounds more than {CAREFUL:g} times too large: {int(spread.too_large.sum()):,} ({share:.3g} %)")
    if spread.exact.any():
        lines.append(f"exact in all runs: {int(spread.exact.sum()):,}")
    lines.append(f"without moves: {'the same bits' if spread.same else 'other bits'} as the image")
    return lines


def _rows(pixels: Sequence[WorstPixel]) -> list[text_tables.Row]:
    rows: list[text_tables.Row] = []
    for number, each in enumerate(pixels, 1):
        place = str(number), CAUSES.get(each.cause, each.cause), str(each.row), str(each.column), each.mesh or "-"
        rows.append((*place, digits(each.kappa), f"{each.exponent:g}", digits(each.found, 2), digits(each.expected, 2)))
    return rows


def lines(study: RoundingStudy) -> list[str]:
    """Return the tables of one scene."""
    spread = study.spread
    found = [f"random rounding, {spread.runs} runs, {spread.seconds:.1f} s", *(f"  {line}" for line in facts(spread))]
    for title, pixels in (("bounds too small", study.too_small), ("bounds too large", study.too_large)):
        if pixels:
            found += [f"{title}, the worst:", *text_tables.as_lines(PIXELS, _rows(pixels), left=2)]
    return found


_WIDTHS = (26, 6, 11, 8, 10, 12, 7, 11, 11)
CASES = ("case", "draws", "pixels", "found", "promised", "error", "too small", "too large", "exact")


def case_line(row: Sequence[str]) -> str:
    """Return a row of CASES as a line for the terminal."""
    first, *others = row
    return first.ljust(_WIDTHS[0]) + "".join(text.rjust(width) for text, width in zip(others, _WIDTHS[1:], strict=True))


def case_row(name: str, spreads: Sequence[Spread]) -> text_tables.Row:
    """Return a row of CASES: the least digits found and promised, the largest error in percent of its bound, and counts."""
    counts = {
        kind: sum(int(getattr(each, kind).sum()) for each in spreads)
        for kind in ("counted", "too_small", "too_large", "exact")
    }
    quantiles = [each.quantiles() for each in spreads if each.counted.any()]
    least = [min((each[kind]["least"] for each in quantiles), default=None) for kind in ("found", "promised")]
    worst = max((each.worst for each in spreads), default=0.0)
    return (
        name,
        str(len(spreads)),
        f"{counts['counted']:,}",
        *("-" if value is None else f"{value:.2f}" for value in least),
        f"{digits(100.0 * worst)} %",
        str(counts["too_small"]),
        f"{counts['too_large']:,}",
        f"{counts['exact']:,}",
    )
