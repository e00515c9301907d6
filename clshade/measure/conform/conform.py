"""`python -m clshade conform`: whether an OpenCL device computes what it has to."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TextIO

from ...base import text_tables
from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.opencl.device import chosen_devices
from ...pipeline.opencl.probe import DeviceInfo
from . import card
from .child import Task
from .part import Part
from .results import Judged, Result
from .tests_of_device import GROUPS, parts_of

LIMIT = 150.0  # seconds that a test may take, with what it compiles
AT_ONCE = 2  # processes
MOST_SHOWN = 12  # failures; the card has all


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
        found = Part(task, judged, limit).run()
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
