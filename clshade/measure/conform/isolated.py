"""Parts of the tests of a device, each in a process of its own, which the device may take along: `main` runs the tests of a
Task there and prints a line of JSON for each event; `Part` starts it and reads them."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...base import console
from ...base.host_memory import available
from ...base.interrupts import at_end
from ...base.json_values import in_line
from ...errors import ClshadeError, DeviceError
from ...pipeline import programs
from ...pipeline.opencl.device import open_untested
from . import reproducer
from .case import Bench, Skipped, Wrong
from .groups import Check, tests_of

LIMIT = 150.0  # seconds that a test may take, with what it compiles
WHOLE = 600.0  # seconds that a process may take
MOST_ENDED = 3  # processes of a part that end early; then the rest is not tried
LEAST_MEMORY, MOST_MEMORY = 3 << 30, 64 << 30  # bytes
SHARE = 3  # of the free memory a process may take one part in so many: two run at a time
_running: set[subprocess.Popen[bytes]] = set()


@dataclass
class Result:
    """Result of a test. problem: what is wrong, "" if nothing. skipped: why it was not taken. script: file that shows it."""

    group: str
    name: str
    title: str = ""
    problem: str = ""
    skipped: str = ""
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


def _run(check: Check, bench: Bench) -> tuple[Wrong | str, str]:
    """Return what is wrong, and why the test was skipped."""
    try:
        return check.run(bench) or "", ""
    except Skipped as reason:
        return "", str(reason)
    except DeviceError as error:
        return str(error).removeprefix(f"{bench.device.name}: "), ""
    except Exception as error:  # a failing test must not stop the others
        return f"{type(error).__name__}: {' '.join(str(error).split())}", ""


def run(task: Task, bench: Bench) -> None:
    """Run the tests of a task, and write a script for each that fails."""
    device, folder = bench.device, Path(task.folder)
    options = programs.compiler_options(device)
    checks = [check for check in tests_of(task.group, task.part, device) if check.name not in task.done]
    facts = {"lanes": device.lanes, "version": device.version, "driver": device.driver}
    _say(planned=[check.name for check in checks], device=facts)
    for check in checks:
        where, path = f"{task.group}_{check.name}", None
        if check.case is not None:  # it may take the process along
            path = reproducer.write(check.case, device, options, folder, where)
        faulthandler.dump_traceback_later(task.limit, exit=True)
        _say(begin=check.name, title=check.title, script=path.name if path else "")
        start = time.perf_counter()
        problem, skipped = _run(check, bench)
        if isinstance(problem, Wrong):
            reproducer.write(problem, device, options, folder, where)
        elif path and not problem:
            path.unlink()
        _say(end=check.name, problem=str(problem), skipped=skipped, seconds=time.perf_counter() - start)


def _say(**event: Any) -> None:
    print(json.dumps(event), flush=True)


def _limit_resources() -> None:
    """Let a compiler that takes more and more memory fail before the machine does, and leave no core file."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # an abort is expected
        most = int(max(LEAST_MEMORY, min(available(), MOST_MEMORY) / SHARE))
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def main() -> None:
    _limit_resources()
    sys.stdout = os.fdopen(os.dup(1), "w")  # for events alone: what a runtime prints goes to standard error
    os.dup2(2, 1)
    task = Task(**json.loads(sys.argv[1]))
    faulthandler.dump_traceback_later(task.limit, exit=True)  # even if a compiler or a kernel does not return
    try:
        with console.at_level(console.QUIET):
            run(task, Bench(open_untested(task.index, task.name)))
    except (ClshadeError, RuntimeError) as error:
        sys.exit(f"error: {error}")


# Its parent


@at_end
def _end_all() -> None:
    """End what runs: a process that this one starts inherits that interrupts are blocked."""
    for process in list(_running):
        process.kill()


class Part:
    """A part of a group, in as many processes as the device takes along.

    device: what the process said of it. results: by the tests' names.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.device: dict[str, Any] = {}
        self.results: dict[str, Result] = {}
        self._planned: list[str] | None = None
        self._current = ""

    @property
    def _missing(self) -> list[str]:
        """The tests that were to be run and have not begun."""
        return [name for name in self._planned or () if name not in self.results]

    def run(self) -> list[Result]:
        group, part = self.task.group, self.task.part
        for _ in range(MOST_ENDED):
            problem = self._process()
            if problem and self._current:
                self.results[self._current].problem = problem
            elif problem:
                title = f"tests not run: {', '.join(self._missing)}" if self._missing else "the device opens"
                self.results["open"] = Result(group, "open", title, problem)
            if not (problem and self._current and self._missing):
                return list(self.results.values())
            self.task = replace(self.task, done=(*self.results,))
        reason = f"{group} {part}".rstrip() + " is given up: its processes end early"
        self.results["rest"] = Result(group, "rest", "the other tests", skipped=reason)
        return list(self.results.values())

    def _process(self) -> str:
        """Run a process to its end; return what ended it early."""
        with tempfile.TemporaryFile("w+") as events, tempfile.TemporaryFile("w+", errors="replace") as errors:
            command, nothing = self.task.command(), subprocess.DEVNULL
            process = subprocess.Popen(command, stdin=nothing, stdout=events, stderr=errors)
            _running.add(process)
            try:
                code = process.wait(WHOLE)
            except subprocess.TimeoutExpired:
                return f"does not end within {WHOLE:g} s"
            finally:
                process.kill()
                process.wait()
                _running.discard(process)
                events.seek(0)
                self._current = ""
                for line in events:
                    self._hear(json.loads(line))
            errors.seek(0)
            said = [line for line in errors.read().splitlines() if line.strip()]
        if code == 1 and any(line.startswith("Timeout (") for line in said):
            return f"does not end within {self.task.limit:g} s"
        if code or self._current or self._missing or self._planned is None:
            return f"ends the process: {': '.join(filter(None, [_ending(code), _telling(said)]))}"
        return ""

    def _hear(self, event: dict[str, Any]) -> None:
        if "planned" in event:
            self._planned, self.device = event["planned"], event["device"]
        elif "begin" in event:
            name = self._current = event["begin"]
            self.results[name] = Result(self.task.group, name, event["title"], script=event["script"])
        else:
            ended = self.results[event.pop("end")]
            vars(ended).update(event, script=ended.script if event["problem"] else "")
            self._current = ""


def _telling(lines: list[str]) -> str:
    """Return the line that tells most: the first that names an error, or the last; "" if none."""
    # A traceback's own lines are indented; from Python 3.13 on some are lines of the code.
    named = [line for line in lines if not line.startswith((" ", "Traceback")) and "error" in line.lower()]
    return in_line((named or lines[-1:])[0].strip()[:160]) if lines else ""


def _ending(code: int) -> str:
    """Return how a process ended, in two words."""
    if code >= 0:
        return f"exit code {code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"
