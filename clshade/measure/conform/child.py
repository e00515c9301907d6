"""Run a part of a group of tests on a device that may take the process along:
`python -m clshade.measure.conform.child JSON`.

Prints a line of JSON for each event. `conform` runs it and reads them.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...base import console
from ...base.host_memory import available
from ...errors import ClshadeError, DeviceError
from ...pipeline import programs
from ...pipeline.opencl.device import Device, open_untested
from . import faults, reproducer, shrink
from .case import Bench, Skipped, Wrong
from .tests_of_device import Check, described, tests_of

LEAST_MEMORY, MOST_MEMORY = 3 << 30, 64 << 30  # bytes
SHARE = 3  # of the free memory a process may take one part in so many: two run at a time
MOST_SHRUNK = 4  # failures of a process that are made smaller; the others are written as they are


@dataclass(frozen=True)
class Task:
    """What a process does. index, name: of the device. done: tests that it leaves out. only: a test; empty: all. folder: of
    scripts. fault: planted; empty: none."""

    index: str
    name: str
    group: str
    part: str
    folder: str
    done: tuple[str, ...] = ()
    only: str = ""
    fault: str = ""
    shrinks: bool = True

    def command(self) -> list[str]:
        return [sys.executable, "-m", "clshade.measure.conform.child", json.dumps(asdict(self))]


def _say(**event: Any) -> None:
    print(json.dumps(event), flush=True)


def script_name(task: Task, test: Check) -> str:
    return f"{task.group}_{test.name}"


def _run(test: Check, bench: Bench) -> tuple[str, Wrong | None, str]:
    """Return what is wrong, the wrong case, and why the test was skipped."""
    try:
        if test.run is not None:
            return test.run(bench), None, ""
        wrong = test.wrong(bench)
        return ("" if wrong is None else described(wrong)), wrong, ""
    except Skipped as reason:
        return "", None, str(reason)
    except DeviceError as error:
        return str(error).removeprefix(f"{bench.device.name}: "), None, ""
    except Exception as error:  # a failing test must not stop the others
        return f"{type(error).__name__}: {' '.join(str(error).split())}", None, ""


def run(task: Task, device: Device, bench: Bench) -> None:
    """Run the tests of a task, and write a script for each that fails."""
    options, failed = programs.compiler_options(device), list[tuple[Check, Wrong]]()
    tests = [
        test
        for test in tests_of(task.group, task.part, device)
        if test.name not in task.done and task.only in ("", test.name)
    ]
    _say(planned=[test.name for test in tests])
    for test in tests:
        _say(begin=test.name, title=test.title)
        start, path = time.perf_counter(), None
        where = Path(task.folder), script_name(task, test)
        if test.case is not None:  # it may take the process along
            path = reproducer.write(test.case, device, options, *where)
            _say(script=path.name)
        problem, wrong, skipped = _run(test, bench)
        if wrong is not None:
            reproducer.write(wrong, device, options, *where)
        elif path is not None and not problem:
            path.unlink()
        seconds = time.perf_counter() - start
        _say(end=test.name, problem=problem, skipped=skipped, seconds=seconds)
        if wrong is not None:
            failed.append((test, wrong))
    for test, wrong in failed[:MOST_SHRUNK] if task.shrinks else ():
        _say(shrink=test.name)
        small = shrink.smallest(bench, wrong)
        reproducer.write(small, device, options, Path(task.folder), script_name(task, test))
        _say(shrunk=test.name, problem=described(small))


def _limit_resources() -> None:
    """Let a compiler that takes more and more memory fail before the machine does, and leave no core file."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # an abort is expected
        most = int(max(LEAST_MEMORY, min(available(), MOST_MEMORY) / SHARE))
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def main(arguments: Sequence[str]) -> int:
    _limit_resources()
    fields = json.loads(arguments[0])
    task = Task(**{**fields, "done": tuple(fields["done"])})
    try:
        device = open_untested(task.index, task.name)
        _say(device={"lanes": device.lanes, "version": device.version, "driver": device.driver})
        with console.at_level(console.QUIET), faults.planted(task.fault, device) as bench:
            run(task, device, bench)
    except (ClshadeError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
