"""The tests of a device, in groups; each group runs in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...pipeline.opencl.device import Device
from . import constructs, memory, operations, repeatability, scenes, structs
from .case import Bench, Case, Wrong
from .content import PROGRAMS

GROUPS = {
    "operations": "each operation against its definition",
    "constructs": "what kernels are made of",
    "structs": "sizes and places of members",
    "memory": "limits of allocations",
    "repeatability": "the same bits in every run and build",
    "coverage": "every triangle of a grid",
    "scenes": "golden hashes of scenes that cover all pairs of features",
}


@dataclass(frozen=True)
class Check:
    """A test of a device.

    run: returns what is wrong, "" if nothing; raises Skipped. case: its kernel, if it is one, that `source` holds beside
    others.
    """

    name: str
    title: str
    run: Callable[[Bench], str] | None = None
    case: Case | None = None
    source: str = ""

    def wrong(self, bench: Bench) -> Wrong | None:
        return bench.wrong(self.case, self.source) if self.case is not None else None


def _of_cases(cases: list[Case], prefix: str = "", source: str = "") -> Iterator[Check]:
    for case in cases:
        yield Check(f"{prefix}{case.name}", case.title, case=case, source=source)


def _operations(device: Device, part: str) -> Iterator[Check]:
    for way in operations.ways(device.lanes, device.has_fp64):
        if str(way).startswith(part):
            cases = operations.cases(way)
            yield from _of_cases(cases, f"{way}/", operations.program(cases))


def parts_of(group: str, has_fp64: bool) -> list[str]:
    """Return the parts of a group that may run at the same time, each in a process of its own."""
    if group == "operations":
        return ["float32-own", "float32-library", *(["float64-own", "float64-library"] if has_fp64 else [])]
    return list(PROGRAMS) if group == "scenes" else [""]


def tests_of(group: str, part: str, device: Device) -> list[Check]:
    """Return the tests of a part of one of GROUPS."""
    if group == "operations":
        return list(_operations(device, part))
    if group == "constructs":
        return list(_of_cases(constructs.all_cases(device.has_fp64)))
    if group == "structs":
        return list(_of_cases(structs.cases(device.has_fp64)))
    if group == "scenes":
        return [Check(*row) for row in scenes.tests(part, device.has_fp64)]
    rows = {"memory": memory.tests, "repeatability": repeatability.tests, "coverage": scenes.coverage_tests}[group]()
    return [Check(*row) for row in rows]


def described(wrong: Wrong) -> str:
    """Return in a line what is wrong with the first wrong row."""
    row = int(wrong.rows.argmax())
    given = ", ".join(_shown(v[row]) for v in wrong.case.inputs)
    column = wrong.case.columns[wrong.column] + ": " if wrong.case.columns else ""
    pair = [
        v[row].reshape(-1)[wrong.column if wrong.case.columns else slice(None)] for v in (wrong.expected, wrong.found)
    ]
    count = int(wrong.rows.sum())
    return f"{column}{count} of {len(wrong.rows)} rows; of {given}: expected {_shown(pair[0])}, found {_shown(pair[1])}"


def _shown(v: object) -> str:
    flat = np.asarray(v).reshape(-1)
    words = [float(x).hex() if flat.dtype.kind == "f" else str(x) for x in flat[:4]]
    return words[0] if len(flat) == 1 else f"({', '.join(words)}{', ...' if len(flat) > 4 else ''})"
