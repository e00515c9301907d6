"""`conform --planted`: whether the tests find faults that are planted; and golden hashes for the tests of scenes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from ...base import text_tables
from ...base.atomic_files import shown
from ...pipeline.opencl.device import chosen_devices, open_device
from ...pipeline.opencl.probe import DeviceInfo
from .case import Bench
from .child import Task
from .faults import FAULTS
from .part import Part
from .results import Judged, Result
from .scenes import write_golden as write_scenes

LIMIT = 20.0  # seconds that a test may take: one of the faults is a launch that does not end


def tried(info: DeviceInfo, name: str, folder: Path, *, planted: bool = True) -> Result:
    """Return the result of the test that should find a fault, with it, or without it."""
    fault = FAULTS[name]
    given = info.index, info.name, fault.group, fault.part, str(folder)
    task = Task(*given, only=fault.test, fault=name if planted else "", shrinks=False)
    return next(iter(Part(task, Judged(info), LIMIT).run()))


def run(
    device: str | None = None,
    *,
    out: str | Path = "conform",
    names: Sequence[str] = tuple(FAULTS),
    stream: TextIO | None = None,
) -> bool:
    """Plant one fault after the other, and run the test that should find it, without it too; print what was found. Returns
    True if every fault is found, and none where none is planted."""
    stream = stream or sys.stdout
    info, folder = chosen_devices(device)[1][0], text_tables.create_folder(out)
    found, alone = 0, dict[tuple[str, str], Result]()
    for name in names:
        with_it, key = tried(info, name, folder), (FAULTS[name].group, FAULTS[name].test)
        without = alone[key] = alone.get(key) or tried(info, name, folder, planted=False)
        found += bool(with_it.problem)
        said = f"{FAULTS[name].group}/{FAULTS[name].test}: {with_it.problem or 'NOT FOUND'}"
        print(f"{name}: {FAULTS[name].what}; {said}", file=stream, flush=True)
        if without.problem:
            print(f"{name}: also without the fault: {without.problem}", file=stream, flush=True)
    right = sum(not result.problem for result in alone.values())
    print(f"{found} of {len(names)} faults found; without a fault {right} of {len(alone)} tests pass", file=stream)
    return found == len(names) and right == len(alone)


def write_golden(device: str | None, path: str, stream: TextIO | None = None) -> None:
    """Write the golden hashes of the scenes, as the device draws them. Raises DeviceError if any is wrong."""
    count = write_scenes(Bench(open_device(device)), Path(path))
    print(f"{count} scenes agree with the oracle: wrote {shown(Path(path))}", file=stream or sys.stdout)
