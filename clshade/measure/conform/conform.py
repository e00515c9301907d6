"""`python -m clshade conform`: whether an OpenCL device computes what it has to."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ...base import text_tables
from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.opencl.device import chosen_devices
from ...pipeline.opencl.probe import DeviceInfo
from ..results import Column, Results, Table, wrote
from .groups import GROUPS, parts_of
from .isolated import Part, Result, Task

AT_ONCE = 2  # processes
MOST_SHOWN = 12  # failures; the card has all


@dataclass
class Judged:
    """What was found of a device. facts: its version and lanes, as a process that opened it said. seconds: in all."""

    info: DeviceInfo
    results: list[Result] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def failures(self) -> list[Result]:
        return [result for result in self.results if result.problem]

    def verdict(self) -> str:
        if not self.failures:
            return "conforms"
        names = [f"{result.group}/{result.name}" for result in self.failures]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        return f"does not conform: {', '.join(names[:5])}{more}"


class Group(NamedTuple):
    """A row of the card."""

    name: str
    results: list[Result]

    def count(self, name: str) -> int:
        return sum(bool(getattr(result, name)) for result in self.results)


COLUMNS = (
    Column("group", "group", lambda group: group.name, lambda name: f"{name}: {GROUPS[name]}"),
    Column("tests", "tests", lambda group: len(group.results), str),
    Column("skipped", "skipped", lambda group: group.count("skipped"), str),
    Column("failed", "failed", lambda group: group.count("problem"), str),
    Column("seconds", "seconds", lambda group: sum(result.seconds for result in group.results)),
)


def card(judged: Judged, most: int | None = None) -> Results:
    """Return the card of a device. most: failures that it names."""
    info, failures = judged.info, judged.failures
    rows = [Group(name, [result for result in judged.results if result.group == name]) for name in GROUPS]
    notes = [_failure(result) for result in failures[:most]]
    if failures[len(notes) :]:
        notes.append(f"{len(failures) - len(notes)} more failures")
    if failures and not any(result.group in ("operations", "constructs", "structs") for result in failures):
        notes.append("No operation and no construct that was tested explains it.")
    notes += sorted({f"Skipped: {result.skipped}." for result in judged.results if result.skipped})
    facts = {
        "driver": info.driver,
        "platform": info.platform_version,
        **judged.facts,
        "seconds": round(judged.seconds, 1),
        "verdict": judged.verdict(),
    }
    table = Table("Groups", COLUMNS, [row for row in rows if row.results], notes=notes)
    tests = [vars(result) for result in judged.results]
    return Results(f"{info.platform}: {info.name}", facts, [table], {"device": asdict(info), "tests": tests})


def _failure(result: Result) -> str:
    where = f" [{result.script}]" if result.script else ""
    return f"{result.group}/{result.name} ({result.title}): {result.problem}{where}"


def chosen_groups(names: Sequence[str]) -> list[str]:
    """Return the groups of these names, all by default. Raises InputError for an unknown one."""
    for name in names:
        if name not in GROUPS:
            raise InputError(
                f"conform: --only: expected names of {', '.join(GROUPS)}, found {name!r}{hint(name, list(GROUPS))}"
            )
    return [group for group in GROUPS if not names or group in names]


def judge(info: DeviceInfo, groups: Sequence[str], folder: Path, done: Callable[[str], None] = print) -> Judged:
    """Run the groups on a device, AT_ONCE processes at a time. done: takes a line for each part."""
    start, judged = time.perf_counter(), Judged(info)

    def run(task: Task) -> list[Result]:
        part = Part(task)
        results = part.run()
        judged.facts |= part.device
        group = Group(task.group, results)
        counts = f"{len(results)} tests, {group.count('problem')} failed, {group.count('skipped')} skipped"
        done(f"{f'{task.group} {task.part}'.rstrip()}: {counts}, {sum(result.seconds for result in results):.1f} s")
        return results

    parts = [(group, part) for group in groups for part in parts_of(group, info.has_fp64)]
    pool = ThreadPoolExecutor(AT_ONCE)
    try:
        for results in pool.map(run, [Task(info.index, info.name, *part, str(folder)) for part in parts]):
            judged.results += results
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    judged.seconds = time.perf_counter() - start
    return judged


def run(device: str | None = None, *, out: str | Path = "conform", only: Sequence[str] = ()) -> bool:
    """Judge a device, print a line for each part, the card and the verdict, and write the card and the scripts. Returns
    True if it conforms. Raises InputError, DeviceError and OutputError."""
    groups = chosen_groups(only)
    info = chosen_devices(device)[1][0]
    folder = text_tables.create_folder(out)
    print(f"{info.platform}: {info.name}, driver {info.driver}", flush=True)
    judged = judge(info, groups, folder, lambda line: print(line, flush=True))
    paths = card(judged).write(folder / "conform")
    for line in (*card(judged, MOST_SHOWN).tables[0].lines(), *wrote(paths), judged.verdict()):
        print(line)
    return not judged.failures
