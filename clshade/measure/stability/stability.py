"""`python -m clshade stability`: stiff and extreme cases on one or all devices, with their measured errors."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from pathlib import Path

from ...base import console, text_tables
from ...base.progress_bar import Bar
from ...base.spelling import hint
from ...errors import DeviceError, InputError
from ...pipeline.opencl.device import Device, list_devices, open_device
from .. import results as files
from . import curves, results
from .cases import Bench, Case, Outcome, all_cases
from .results import Result

NO_MPMATH = "compared with float64, right to 1e-10 at n = 1e9: mpmath is not installed (pip install mpmath)"


def chosen(names: Sequence[str] = (), triangles: int = 1) -> tuple[Case, ...]:
    """Return the cases with these names or numbers; by default all. triangles: number of random triangles that they are to
    draw. Raises InputError for an unknown case, and for no triangles."""
    if triangles < 1:
        raise InputError(f"stability: --triangles: expected a whole number above 0, found {triangles}")
    cases = all_cases()
    known = [case.name for case in cases]
    for name in names:
        if not any(name in (case.name, case.number) for case in cases):
            expected = f"expected names or numbers of {', '.join(known)}"
            raise InputError(f"stability: --case: {expected}, found {name!r}{hint(name, known)}")
    return tuple(case for case in cases if not names or case.name in names or case.number in names)


def listing() -> str:
    """Return the list of all cases: number, name, what is stressed, what is expected."""
    lines = (f"{case.number:>4} {case.name:<21} {case.title}: {case.expected}" for case in all_cases())
    return "\n".join(text_tables.wrapped(line, 27) for line in lines)


def devices(name: str | None) -> list[Device]:
    """Return the device of that name, or all working devices for `all`."""
    if name != "all":
        return [open_device(name, profiling=True)]
    opened = [open_device(info.index, profiling=True) for info in list_devices() if info.works]
    if not opened:
        raise DeviceError("stability: --device all: no OpenCL device works: see `python -m clshade devices`")
    return opened


def run_case(case: Case, bench: Bench) -> Result:
    """Return the case's result; an exception is a result too."""
    start = time.perf_counter()
    outcome, problem = Outcome(), ""
    try:
        outcome = case.run(bench)
    except Exception as error:  # a failing case must not stop the others
        problem = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return Result(case, bench.device.index, outcome, time.perf_counter() - start, problem)


def run_cases(cases: Sequence[Case], benches: Sequence[Bench]) -> list[Result]:
    """Run every case on every bench."""
    outcomes = []
    with Bar(len(benches) * len(cases), "cases", clock=None, hidden=console.quiet() or None) as bar:
        for bench in benches:
            for case in cases:
                outcomes.append(run_case(case, bench))
                bar.advance(case.name)
    return outcomes


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
    paths = files.files(folder / "stability")
    if not names:
        paths += files.files(folder / "curves", *formats)
    files.check_files(paths)
    outcomes = run_cases(cases, [Bench(one, triangles=triangles) for one in opened])
    failed = [result for result in outcomes if not result.passed]
    facts = {f"device {one.index}": one.title for one in opened}
    facts["cases"] = f"{len(outcomes)} runs of {len(cases)}: {len(outcomes) - len(failed)} passed, {len(failed)} failed"
    if not importlib.util.find_spec("mpmath"):
        facts["highlights"] = NO_MPMATH
    summary = results.summarize(outcomes, facts)
    print("\n".join(summary.lines()), flush=True)
    summary.write(folder / "stability")
    for result in failed:
        paths += results.write_pictures(result, folder)
    if not names:
        curves.run(opened[0], folder / "curves", formats)
    print("\n".join(["", *files.wrote(paths)]))
    return not failed
