"""Parts of the tests of a device, each in a process of its own, which the device may take along: `main` runs the tests of a
Task there and prints lines of JSON; `run_part` starts it and reads them."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...base import console
from ...base.host_memory import available
from ...base.interrupts import at_end
from ...base.json_values import in_line
from ...pipeline.opencl.device import open_untested
from . import reproducer
from .case import Bench, Case, divides, flushes
from .groups import tests_of

LIMIT = 150.0  # seconds that a test may take, with what it compiles
UNFINISHED = "has not ended"  # the problem of a test that runs
MOST_ENDED = 3  # processes of a part that end early; then the rest is not tried
LEAST_MEMORY, MOST_MEMORY = 3 << 30, 64 << 30  # bytes
SHARE = 3  # of the free memory a process may take one part in so many: two run at a time
_running: set[subprocess.Popen[bytes]] = set()
_ended = threading.Event()  # this process is ending, and starts no other


@dataclass
class Result:
    """Result of a test. problem: what is wrong, "" if nothing. script: file that shows it."""

    group: str
    name: str
    title: str = ""
    problem: str = ""
    seconds: float = 0.0
    script: str = ""


@dataclass(frozen=True)
class Task:
    """What a process does. index, name: of the device. folder: of scripts. done: tests that it leaves out. limit: seconds
    for one."""

    index: str
    name: str
    group: str
    part: str
    folder: str
    done: Sequence[str] = ()
    limit: float = LIMIT

    def command(self) -> list[str]:
        code = f"import sys; sys.path[:] = {sys.path!r}; from clshade.measure.conform import isolated; isolated.main()"
        return [sys.executable, "-c", code, json.dumps(asdict(self))]


# The process


def run(task: Task, bench: Bench) -> None:
    """Run the tests of a task, write a script for each case that fails, and print each result as its test begins and ends,
    then facts of the device."""
    device, folder = bench.device, Path(task.folder)
    left = [test for test in tests_of(task.group, task.part, device) if test[0] not in task.done]
    _say({"left": len(left)})
    for name, title, test in left:
        case = test if isinstance(test, Case) else None
        result, where = Result(task.group, name, title, UNFINISHED), f"{task.group}_{name}"
        if case:  # it may take the process along
            result.script = reproducer.write(case, 0, device, folder, where)
        faulthandler.dump_traceback_later(task.limit, exit=True)
        _say(vars(result))
        start, row = time.perf_counter(), 0
        try:
            result.problem, row = (bench.wrong(test) or ("", 0)) if isinstance(test, Case) else (test(bench), 0)
        except Exception as error:  # a failing test must not stop the others
            result.problem = f"{type(error).__name__}: {' '.join(str(error).split())}"
        if case and result.problem:
            reproducer.write(case, row, device, folder, where)
        elif case:
            (folder / result.script).unlink()
            result.script = ""
        result.seconds = time.perf_counter() - start
        _say(vars(result))
    claims = {"correctly rounded division": divides(device), "denormals": not flushes(device)}
    _say({"version": device.version, "lanes": device.lanes, **claims})


def _say(line: dict[str, Any]) -> None:
    print(json.dumps(line), flush=True)


def main() -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # an abort is expected
        # A compiler that takes more and more memory fails before the machine does.
        memory = int(max(LEAST_MEMORY, min(available(), MOST_MEMORY) / SHARE))
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    sys.stdout = os.fdopen(os.dup(1), "w")  # for events alone: what a runtime prints goes to standard error
    os.dup2(2, 1)
    task = Task(**json.loads(sys.argv[1]))
    faulthandler.dump_traceback_later(task.limit, exit=True)  # even if a compiler or a kernel does not return
    with console.at_level(console.QUIET):
        run(task, Bench(open_untested(task.index, task.name)))


# Its parent


@at_end
def _end_all() -> None:
    """End what runs: a process that this one starts inherits that interrupts are blocked."""
    _ended.set()
    for process in list(_running):
        process.kill()


def run_part(task: Task) -> tuple[list[Result], dict[str, Any]]:
    """Run a part of a group, in as many processes as the device takes along. Returns results, and facts of the device."""
    results, facts, left = dict[str, Result](), dict[str, Any](), 1
    for _ in range(MOST_ENDED):
        before = len(results)
        lines, problem = _process(replace(task, done=(*task.done, *results)))
        for line in lines:
            if "lanes" in line:
                facts = line
            elif "left" in line:
                left = line["left"]
            else:
                results[line["name"]] = Result(**line)
        current = next((result for result in results.values() if result.problem == UNFINISHED), None)
        if not current:
            break
        current.problem = problem
        left -= len(results) - before
        if not left:
            return [*results.values()], facts
    else:
        problem = "not tried: processes end early"
    rest = Result(task.group, "rest", "the rest of the part", problem)
    return [*results.values(), *([rest] if problem else [])], facts


def _process(task: Task) -> tuple[list[dict[str, Any]], str]:
    """Run a process to its end; return what it printed, and what ended it early."""
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+", errors="replace") as errors:
        process = subprocess.Popen(task.command(), stdin=subprocess.DEVNULL, stdout=output, stderr=errors)
        _running.add(process)
        if _ended.is_set():
            process.kill()
        code = process.wait()
        _running.discard(process)
        output.seek(0)
        lines = []
        for line in output:
            with contextlib.suppress(ValueError):  # cut short, by a full disk
                lines.append(json.loads(line))
        errors.seek(0)
        said = [line for line in errors.read().splitlines() if line.strip()]
    if code == 0 and lines and "lanes" in lines[-1]:
        return lines, ""
    if code == 1 and any(line.startswith("Timeout (") for line in said):
        return lines, f"does not end within {task.limit:g} s"
    names = {member.value: member.name for member in signal.Signals}
    ending = f"exit code {code}" if code >= 0 else names.get(-code, f"signal {-code}")
    return lines, f"ends the process: {': '.join(filter(None, [ending, _telling(said)]))}"


def _telling(lines: list[str]) -> str:
    """Return the line that tells most: the first that names an error, or the last; "" if none."""
    # A traceback's own lines are indented; from Python 3.13 on some are lines of the code.
    errors = [line for line in lines if not line.startswith((" ", "Traceback")) and "error" in line.lower()]
    return in_line((errors or lines[-1:])[0].strip()[:160]) if lines else ""
