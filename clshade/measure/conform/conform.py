"""`python -m clshade conform`: whether an OpenCL device computes what it has to."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...base import text_tables
from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.opencl.device import chosen_devices
from ...pipeline.opencl.probe import DeviceInfo
from ..results import Column, Results, Table, check_files, files, wrote
from .groups import GROUPS, parts_of
from .isolated import Result, Task, run_part

AT_ONCE = 2  # processes


def failed(results: Sequence[Result]) -> int:
    return sum(bool(result.problem) for result in results)


COLUMNS = (
    Column("group", "group", lambda results: results[0].group, lambda name: f"{name}: {GROUPS[name]}"),
    Column("tests", "tests", len, str),
    Column("failed", "failed", failed, str),
    Column("seconds", "seconds", lambda results: sum(result.seconds for result in results)),
)


def card(info: DeviceInfo, results: Sequence[Result], facts: dict[str, Any]) -> Results:
    """Return the card of a device. facts: its lanes and version, and what it claims, as a process that opened it said."""
    groups = [[result for result in results if result.group == name] for name in GROUPS]
    notes = []
    for result in results:
        if result.problem:
            where = f" [{result.script}]" if result.script else ""
            notes.append(f"{result.group}/{result.name} ({result.title}): {result.problem}{where}")
    verdict = f"does not conform: {len(notes)} of {len(results)} tests failed" if notes else "conforms"
    facts = {"driver": info.driver, "platform": info.platform_version, **facts, "verdict": verdict}
    table = Table("Groups", COLUMNS, [group for group in groups if group], notes=notes)
    tests = [vars(result) for result in results]
    return Results(f"{info.platform}: {info.name}", facts, [table], {"device": asdict(info), "tests": tests})


def chosen_groups(names: Sequence[str]) -> list[str]:
    """Return the groups of these names, all by default. Raises InputError for an unknown one."""
    for name in names:
        if name not in GROUPS:
            raise InputError(
                f"conform: --only: expected names of {', '.join(GROUPS)}, found {name!r}{hint(name, list(GROUPS))}"
            )
    return [group for group in GROUPS if not names or group in names]


def judge(info: DeviceInfo, groups: Sequence[str], folder: Path) -> Results:
    """Run the groups on a device, AT_ONCE processes at a time, print a line for each part, and return the card."""
    start, results, facts = time.perf_counter(), list[Result](), dict[str, Any]()

    def run(task: Task) -> list[Result]:
        results, device = run_part(task)
        facts.update(device)
        seconds = sum(result.seconds for result in results)
        counts = f"{len(results)} tests, {failed(results)} failed, {seconds:.1f} s"
        print(f"{f'{task.group} {task.part}'.rstrip()}: {counts}", flush=True)
        return results

    parts = [(group, part) for group in groups for part in parts_of(group, info.has_fp64)]
    pool = ThreadPoolExecutor(AT_ONCE)
    try:
        for found in pool.map(run, [Task(info.index, info.name, *part, str(folder)) for part in parts]):
            results += found
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return card(info, results, {**facts, "seconds": round(time.perf_counter() - start, 1)})


def run(device: str | None = None, *, out: str | Path = "conform", only: Sequence[str] = ()) -> bool:
    """Judge a device, print and write the card, and the scripts of failures. Returns True if it conforms. Raises
    InputError, DeviceError and OutputError."""
    groups = chosen_groups(only)
    info = chosen_devices(device)[0]
    folder = text_tables.create_folder(out)
    check_files(files(folder / "conform"))
    print(f"{info.platform}: {info.name}, driver {info.driver}", flush=True)
    results = judge(info, groups, folder)
    verdict = results.facts["verdict"]
    for line in (*results.tables[0].lines(), *wrote(results.write(folder / "conform")), verdict):
        print(line)
    return bool(verdict == "conforms")
