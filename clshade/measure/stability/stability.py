"""`python -m clshade stability`: stiff and extreme cases on one or all devices, with their measured errors."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from ...base import text_tables
from ...base.atomic_files import shown
from ...base.spelling import hint
from ...errors import DeviceError, InputError
from ...pipeline.opencl.device import Device, list_devices, open_device
from . import curves, results
from .cases import Bench, Case, Outcome, all_cases
from .results import Result

NO_MPMATH = (
    "mpmath is not installed (pip install mpmath, or clshade's extra `test`): "
    "highlights are compared with float64, which is right to 1e-10 at n = 1e9."
)


def chosen(names: Sequence[str] = (), triangles: int = 1) -> tuple[Case, ...]:
    """Return the cases with these names or numbers; by default all. triangles: number of random triangles that they are to
    draw. Raises InputError for an unknown case, and for no triangles."""
    if triangles < 1:
        raise InputError(f"stability: --triangles: expected a whole number above 0, found {triangles}")
    cases = all_cases()
    for name in names:
        if not any(name in (case.name, case.number) for case in cases):
            known = [case.name for case in cases]
            near = hint(name, known)
            raise InputError(
                f"stability: --case: expected names or numbers of {', '.join(known)}, found {name!r}{near}"
            )
    return tuple(case for case in cases if not names or case.name in names or case.number in names)


def listing() -> str:
    """Return the list of all cases: number, name, what is stressed, what is expected."""
    lines = (f"{case.number:>4} {case.name:<21} {case.title}: {case.expected}" for case in all_cases())
    return "\n".join(text_tables.wrapped(line, 27) for line in lines)


def devices(name: str | None) -> list[Device]:
    """Return the device of that name, or all working devices for `all`."""
    if name != "all":
        return [open_device(name, profiling=True)]
    found = [open_device(info.index, profiling=True) for info in list_devices() if info.works]
    if not found:
        raise DeviceError("stability: --device all: no OpenCL device works: see `python -m clshade devices`")
    return found


def run_case(case: Case, bench: Bench) -> Result:
    """Return the case's result; an exception is a result too."""
    start = time.perf_counter()
    outcome, problem = Outcome(), ""
    try:
        outcome = case.run(bench)
    except Exception as error:  # a failing case must not stop the others
        problem = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return Result(case, bench.device.title, outcome, time.perf_counter() - start, problem)


def compared(result: Result, earlier: Sequence[Result]) -> Result:
    """Return the result, failed if an earlier device gave other bits."""
    for other in earlier:
        prints = other.outcome.fingerprint, result.outcome.fingerprint
        if other.case.name == result.case.name and all(prints) and prints[0] != prints[1]:
            return replace(result, problem=f"other bits than {other.device}")
    return result


def run(
    device: str | None = None,
    *,
    out: str | Path = "stability",
    names: Sequence[str] = (),
    triangles: int = 50_000,
    stream: TextIO | None = None,
) -> bool:
    """Run the cases, print the table as they finish, and write the files. Returns True if all passed.

    device: a name for `open_device`, or `all`. names: cases; by default all, and then the figure too.
    triangles: number of random triangles. Raises InputError, DeviceError and OutputError.
    """
    stream = stream or sys.stdout
    cases = chosen(names, triangles)
    opened = devices(device)
    folder = text_tables.create_folder(out)
    notes = [] if importlib.util.find_spec("mpmath") else [NO_MPMATH]
    found: list[Result] = []
    written: list[Path] = []
    for each in opened:
        print(f"{each.title}\n{results.HEADER}", file=stream, flush=True)
        bench = Bench(each, folder, triangles=triangles)
        for case in cases:
            result = compared(run_case(case, bench), found)
            found.append(result)
            print(results.line(result), file=stream, flush=True)
            if not result.passed:
                written += results.write_pictures(result, folder)
    failed = sum(not result.passed for result in found)
    seconds = sum(result.seconds for result in found)
    notes.append(
        f"{len(found)} runs of {len(cases)} cases in {seconds:.1f} s: {len(found) - failed} passed, {failed} failed."
    )
    written += results.write(found, notes, folder)
    if not names:
        written.append(folder / "stability.png")
        curves.plot(curves.measure(Bench(opened[0], folder)), written[-1], opened[0].title)
    print("\n".join([*notes, *(f"wrote {shown(path)}" for path in written)]), file=stream)
    return failed == 0
