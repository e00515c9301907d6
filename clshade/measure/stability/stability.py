"""`python -m clshade stability`: stiff and extreme cases on one or all devices, with their measured errors."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from pathlib import Path

import numpy as np

from ...base import console, text_tables
from ...base.arrays import Array, Bytes
from ...base.progress_bar import Bar
from ...base.spelling import hint
from ...base.text_tables import digits
from ...errors import DeviceError, InputError
from ...images import png
from ...images.tonemap import tonemap
from ...pipeline.opencl.device import Device, list_devices, open_device
from .. import results
from ..results import Column, Results, Table
from . import curves
from .cases import Bench, Case, Outcome, all_cases

NO_MPMATH = "compared with float64, right to 1e-10 at n = 1e9: mpmath is not installed (pip install mpmath)"


@dataclass(frozen=True)
class Result:
    """One case on a device, by index."""

    case: Case
    device: str
    outcome: Outcome
    seconds: float


def chosen(names: Sequence[str] = (), triangles: int = 1) -> tuple[Case, ...]:
    """Return the cases with these names or numbers; by default all. triangles: number of random triangles that they are to
    draw. Raises InputError for an unknown case, and for no triangles."""
    if triangles < 1:
        raise InputError(f"stability: --triangles: expected a whole number above 0, found {triangles}")
    cases = all_cases()
    names_of_cases = [case.name for case in cases]
    for name in names:
        if not any(name in (case.name, case.number) for case in cases):
            expected = f"expected names or numbers of {', '.join(names_of_cases)}"
            raise InputError(f"stability: --case: {expected}, found {name!r}{hint(name, names_of_cases)}")
    return tuple(case for case in cases if not names or case.name in names or case.number in names)


def listing() -> str:
    """Return the list of all cases: number, name, what is stressed, what is expected."""
    lines = (f"{case.number:>4} {case.name:<21} {case.title}: {case.expected}" for case in all_cases())
    return "\n".join(text_tables.wrapped(line, 27) for line in lines)


def devices(name: str | None) -> list[Device]:
    """Return the device of that name, or all working devices for `all`."""
    if name != "all":
        return [open_device(name)]
    opened = [open_device(info.index) for info in list_devices() if info.works]
    if not opened:
        raise DeviceError("stability: --device all: no OpenCL device works: see `python -m clshade devices`")
    return opened


def run_case(case: Case, bench: Bench) -> Result:
    """Return the case's result; an exception is a result too."""
    start = time.perf_counter()
    try:
        outcome = case.run(bench)
    except Exception as error:  # a failing case must not stop the others
        outcome = Outcome(error=np.nan, detail=f"{type(error).__name__}: {' '.join(str(error).split())}")
    return Result(case, bench.device.index, outcome, time.perf_counter() - start)


def run(
    device: str | None = None,
    *,
    out: str | Path = "stability",
    names: Sequence[str] = (),
    triangles: int = 50_000,
    formats: Sequence[str] = ("png",),
) -> bool:
    """Run the cases, without names the curves too, print tables and write the files. Returns True if all cases passed.

    device: a name for `open_device`, or `all`; curves are those of the first. names: of cases. triangles: number of random
    triangles. formats: of the figure. Raises InputError, DeviceError and OutputError.
    """
    cases = chosen(names, triangles)
    opened = devices(device)
    folder = text_tables.create_folder(out)
    paths = results.files(folder / "stability")
    if not names:
        paths += results.files(folder / "curves", *formats)
    results.check_files(paths)
    found = []
    with Bar(len(opened) * len(cases), "cases", clock=None, hidden=console.quiet() or None) as bar:
        for one in opened:
            for case in cases:
                found.append(run_case(case, Bench(one, triangles=triangles)))
                bar.advance(case.name)
    summary = summarize(found, {f"device {one.index}": one.title for one in opened})
    print("\n".join(summary.lines()), flush=True)
    summary.write(folder / "stability")
    failed = [result for result in found if not result.outcome.passed]
    for result in failed:
        paths += write_pictures(result, folder)
    if not names:
        curves.run(opened[0], folder / "curves", formats)
    print("\n".join(["", *results.wrote(paths)]))
    return not failed


def _error(outcome: Outcome) -> str:
    return f"{outcome.error:.3g} of {outcome.limit:g} {outcome.unit}" if outcome.unit else "-"


COLUMNS = (
    Column("on", "device", attrgetter("device"), str),
    Column("no", "no", attrgetter("case.number"), str),
    Column("case", "case", attrgetter("case.name"), str),
    *(Column("", name, attrgetter(at)) for name, at in (("stressed", "case.title"), ("expected", "case.expected"))),
    Column("wrong", "wrong", attrgetter("outcome.wrong"), str),
    Column("error", "", attrgetter("outcome"), _error),
    *(Column("", name, attrgetter(f"outcome.{name}")) for name in ("error", "limit", "unit", "detail")),
    Column("amplif.", "amplification", attrgetter("outcome.amplification")),
    Column("seconds", "seconds", attrgetter("seconds"), partial(digits, count=2)),
    Column("verdict", "verdict", lambda result: "pass" if result.outcome.passed else "FAIL", str),
)


def summarize(found: Sequence[Result], facts: dict[str, str]) -> Results:
    """Return a table of the cases, which says why some failed."""
    reasons = [
        "; ".join(filter(None, [f"{case.name}: expected of {case.title}: {case.expected}", outcome.detail]))
        for case, outcome in ((result.case, result.outcome) for result in found)
        if not outcome.passed
    ]
    count = len({result.case.name for result in found})
    passed = len(found) - len(reasons)
    facts = facts | {"runs": f"{len(found)} of {count} cases: {passed} passed, {len(reasons)} failed"}
    if not importlib.util.find_spec("mpmath"):
        facts["highlights"] = NO_MPMATH
    return Results("Stiff and extreme cases", facts, [Table("Cases", COLUMNS, found, notes=reasons, left=3)])


# Images of failures


def write_pictures(result: Result, folder: Path) -> list[Path]:
    """Write the rendered, expected and difference image of a failing case, if it has images."""
    if result.outcome.pictures is None:
        return []
    rendered, expected = map(np.asarray, result.outcome.pictures)
    with np.errstate(invalid="ignore"):  # where both are infinite
        difference = rendered != expected if rendered.ndim == 2 else np.abs(rendered - expected.astype(np.float64))
    pictures = {"rendered": (rendered, expected), "expected": (expected, expected), "difference": (difference,) * 2}
    name = f"{result.case.name}-{result.device.replace(':', '-')}"
    paths = [folder / f"{name}-{kind}.png" for kind in pictures]
    for path, (picture, like) in zip(paths, pictures.values(), strict=True):
        png.write(path, _picture(picture, like))
    return paths


def _picture(values: Array, like: Array) -> Bytes:
    """Return an image, (M, N, 3) uint8: of ids, a color for each, 0 black; or of colors, the largest of `like` and NaN
    white."""
    if values.ndim == 2:
        mixed = (values.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
        color = np.stack([(mixed >> np.uint64(8 * k)) & np.uint64(0xFF) for k in range(3)], axis=-1) | np.uint64(0x40)
        return np.where(values[..., None] > 0, color, 0).astype(np.uint8)
    largest = float(np.abs(like[np.isfinite(like)]).max(initial=0.0)) or 1.0
    return tonemap(
        np.clip(np.nan_to_num(values.astype(np.float64) / largest, nan=1.0), 0.0, 1.0).astype(np.float32), "srgb", 0.0
    )
