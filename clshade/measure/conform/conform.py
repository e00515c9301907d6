"""`python -m clshade conform`: whether an OpenCL device computes what it has to."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

from ...base import text_tables
from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.opencl.device import chosen_devices
from ...pipeline.opencl.probe import DeviceInfo
from ..child_process import Child, ending
from . import card
from .child import Task
from .tests_of_device import GROUPS, parts_of

LIMIT = 150.0  # seconds that a test may take, with what it compiles
SHRINKING = 60.0  # seconds that making a failure smaller may take
AT_ONCE = 2  # processes
MOST_SHOWN = 12  # failures; the card has all


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


@dataclass
class Judged:
    """What was found of a device. facts: its version and lanes, as the first process that opened it said. seconds: in all."""

    info: DeviceInfo
    results: list[Result] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def failures(self) -> list[Result]:
        return [result for result in self.results if result.problem]

    def verdict(self) -> str:
        """Return the last line."""
        if not self.failures:
            return "conforms"
        names = [f"{result.group}/{result.name}" for result in self.failures]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"does not conform: {', '.join(names[:5])}{more}"


class _Part:
    """A part of a group, in as many processes as the device takes along."""

    def __init__(self, task: Task, judged: Judged, limit: float) -> None:
        self.task, self.judged, self.limit = task, judged, limit
        self.results: dict[str, Result] = {}
        self.current = ""

    def run(self) -> list[Result]:
        while True:
            problem = self._process()
            if not problem:
                return list(self.results.values())
            name = self.current
            if not name:  # before its first test, or while a failure was made smaller
                if not self.results:
                    self.results["open"] = Result(self.task.group, "open", "the device opens", problem)
                return list(self.results.values())
            self.results[name].problem = problem
            self.task = replace(self.task, done=(*self.results,))

    def _process(self) -> str:
        """Run a process to its end; return what ended it early."""
        child, self.current, limit = Child(self.task.command()), "", self.limit
        try:
            while True:
                end = time.monotonic() + limit
                line = child.line(end)
                if not line:
                    code = child.code(end)
                    said = child.said()
                    return f"ends the process: {ending(code)}" + (f": {said}" if said else "") if code else ""
                limit = self._heard(line)
        except TimeoutError:
            return f"does not end within {limit:g} s"
        finally:
            child.close()

    def _heard(self, line: bytes) -> float:
        """Take an event; return the seconds until the next one."""
        try:
            event = json.loads(line)
            assert isinstance(event, dict)
        except (ValueError, AssertionError):  # a runtime's own output
            return self.limit
        if "device" in event:
            self.judged.facts = event["device"]
        elif "begin" in event:
            self.current = event["begin"]
            self.results[self.current] = Result(self.task.group, self.current, event["title"])
        elif "end" in event:
            vars(self.results[event.pop("end")]).update(event)
            self.current = ""
        elif "shrunk" in event:
            self.results[event["shrunk"]].problem = event["problem"]
        return SHRINKING if "shrink" in event else self.limit


def chosen_groups(names: Sequence[str]) -> list[str]:
    """Return the groups of these names, all by default. Raises InputError for an unknown one."""
    for name in names:
        if name not in GROUPS:
            raise InputError(
                f"conform: --only: expected names of {', '.join(GROUPS)}, found {name!r}{hint(name, list(GROUPS))}"
            )
    return [group for group in GROUPS if not names or group in names]


def judge(
    info: DeviceInfo, groups: Iterable[str], folder: Path, limit: float = LIMIT, stream: TextIO | None = None
) -> Judged:
    """Run the groups on a device, AT_ONCE processes at a time. stream: of a line for each part that is done."""
    start, judged, lock = time.perf_counter(), Judged(info), threading.Lock()
    tasks = [
        Task(info.index, info.name, group, part, str(folder))
        for group in groups
        for part in parts_of(group, info.has_fp64)
    ]

    def run(task: Task) -> list[Result]:
        found = _Part(task, judged, limit).run()
        with lock:
            if stream is not None:
                print(card.line(task.group, task.part, found), file=stream, flush=True)
        return found

    pool = ThreadPoolExecutor(AT_ONCE)
    try:
        for found in pool.map(run, tasks):
            judged.results += found
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    judged.seconds = time.perf_counter() - start
    return judged


def run(
    device: str | None = None,
    *,
    out: str | Path = "conform",
    only: Sequence[str] = (),
    stream: TextIO | None = None,
) -> bool:
    """Judge a device, print a line for each part and the verdict, and write the card and the scripts. Returns True if it
    conforms. Raises InputError, DeviceError and OutputError."""
    stream = stream or sys.stdout
    groups = chosen_groups(only)
    info = chosen_devices(device)[1][0]
    folder = text_tables.create_folder(out)
    print(f"{info.platform}: {info.name}, driver {info.driver}", file=stream, flush=True)
    judged = judge(info, groups, folder, stream=stream)
    for path in card.write(judged, folder):
        print(f"wrote {path}", file=stream)
    for failure in judged.failures[:MOST_SHOWN]:
        where = f" [{failure.script}]" if failure.script else ""
        print(f"{failure.group}/{failure.name}: {failure.problem}{where}", file=stream)
    print(judged.verdict(), file=stream)
    return not judged.failures
