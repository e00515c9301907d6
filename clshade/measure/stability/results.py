"""The results of `stability`'s cases as a table, and images of failures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path

import numpy as np

from ...base.arrays import Array, Bytes
from ...base.text_tables import digits
from ...images import png
from ...images.tonemap import tonemap
from ..results import Column, Results, Table
from .cases import Case, Outcome


@dataclass(frozen=True)
class Result:
    """One case on a device, by index. problem: why it could not be completed; empty if nothing stopped it."""

    case: Case
    device: str
    outcome: Outcome
    seconds: float
    problem: str = ""

    @property
    def passed(self) -> bool:
        return not self.problem and self.outcome.passed

    @property
    def verdict(self) -> str:
        return "pass" if self.passed else "FAIL"

    @property
    def why(self) -> str:
        case = self.case
        return f"{case.name}: expected of {case.title}: {case.expected}; {self.problem or self.outcome.detail}"


def _error(outcome: Outcome) -> str:
    return f"{outcome.error:.3g} of {outcome.limit:g} {outcome.unit}" if outcome.unit else "-"


COLUMNS = (
    Column("no", "no", attrgetter("case.number"), str),
    Column("case", "case", attrgetter("case.name"), str),
    *(Column("", name, attrgetter(at)) for name, at in (("stressed", "case.title"), ("expected", "case.expected"))),
    Column("wrong", "wrong", attrgetter("outcome.wrong"), str),
    Column("error", "", attrgetter("outcome"), _error),
    *(Column("", name, attrgetter(f"outcome.{name}")) for name in ("error", "limit", "unit")),
    Column("amplif.", "amplification", attrgetter("outcome.amplification")),
    Column("seconds", "seconds", attrgetter("seconds"), partial(digits, count=2)),
    Column("verdict", "verdict", attrgetter("verdict"), str),
    Column("", "detail", lambda result: result.problem or result.outcome.detail),
)


def summarize(results: Sequence[Result], facts: dict[str, str]) -> Results:
    """Return a table of the cases, which says why some failed, and on which device if there are several."""
    several = len({result.device for result in results}) > 1
    columns = Column("on" if several else "", "device", attrgetter("device"), str), *COLUMNS
    reasons = [result.why for result in results if not result.passed]
    return Results(
        "Stiff and extreme cases", facts, [Table("Cases", columns, results, notes=reasons, left=2 + several)]
    )


# Images


def _picture(values: Array, scale: float = 1.0) -> Bytes:
    """Return an image, (M, N, 3) uint8, of colors, or of ids: a color for each, 0 black."""
    if values.ndim == 2:
        mixed = (values.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
        color = np.stack([(mixed >> np.uint64(8 * k)) & np.uint64(0xFF) for k in range(3)], axis=-1) | np.uint64(0x40)
        return np.where(values[..., None] > 0, color, 0).astype(np.uint8)
    finite = np.nan_to_num(values / scale, nan=0.0, posinf=1.0, neginf=0.0)
    return tonemap(np.clip(finite, 0.0, 1.0).astype(np.float32), "srgb", 0.0)


def _largest(values: Array) -> float:
    """Return the largest finite magnitude, 1 if there is none above 0."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0


def write_pictures(result: Result, folder: Path) -> list[Path]:
    """Write the rendered, expected and difference image of a failing case, if it has images."""
    if result.outcome.pictures is None:
        return []
    rendered, expected = (np.asarray(picture, np.float64) for picture in result.outcome.pictures)
    with np.errstate(invalid="ignore"):
        apart = np.abs(rendered - expected)
    if apart.ndim == 2:
        apart = np.repeat(apart[..., None] > 0.0, 3, axis=2).astype(np.float64)
    apart[np.isnan(apart)] = np.inf
    scale = _largest(expected)
    pictures = {
        "rendered": _picture(rendered, scale),
        "expected": _picture(expected, scale),
        "difference": _picture(apart, _largest(apart)),
    }
    name = f"{result.case.name}-{result.device.replace(':', '-')}"
    paths = [folder / f"{name}-{kind}.png" for kind in pictures]
    for path, picture in zip(paths, pictures.values(), strict=True):
        png.write(path, picture)
    return paths
