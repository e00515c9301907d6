"""The tests of a device, in groups."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import NamedTuple

from ...pipeline.opencl.device import Device
from . import constructs, memory, operations, repeatability, scenes, structs
from .case import Bench, Case, Wrong
from .content import PROGRAMS

Row = tuple[str, str, Callable[[Bench], str]]  # name, title and function of a test
GROUPS = {
    "operations": "each against its definition",
    "constructs": "what kernels are made of",
    "structs": "sizes and places of members",
    "memory": "limits of allocations",
    "repeatability": "the same bits in every run",
    "coverage": "every triangle of a grid",
    "scenes": "golden hashes, all pairs of features",
}
OTHERS: dict[str, Iterable[Row]] = {
    "memory": memory.TESTS,
    "repeatability": repeatability.TESTS,
    "coverage": scenes.COVERAGE,
}


class Check(NamedTuple):
    """A test of a device. run: returns what is wrong, "" or None if nothing; raises Skipped. case: its kernel, if it is
    one."""

    name: str
    title: str
    run: Callable[[Bench], Wrong | str | None]
    case: Case | None = None


def _of_cases(cases: Iterable[Case], prefix: str = "") -> Iterator[Check]:
    for case in cases:
        yield Check(f"{prefix}{case.name}", case.title, partial(_wrong, case), case)


def _wrong(case: Case, bench: Bench) -> Wrong | None:
    return bench.wrong(case)


def parts_of(group: str, has_fp64: bool) -> list[str]:
    """Return the parts of a group that may run at the same time, each in a process of its own."""
    if group == "operations":
        return ["float32-own", "float32-library", *(["float64-own", "float64-library"] if has_fp64 else [])]
    return list(PROGRAMS) if group == "scenes" else [""]


def tests_of(group: str, part: str, device: Device) -> list[Check]:
    """Return the tests of a part of one of GROUPS."""
    if group == "operations":
        ways = [way for way in operations.ways(device.lanes, device.has_fp64) if str(way).startswith(part)]
        return [check for way in ways for check in _of_cases(operations.cases(way), f"{way}/")]
    if group in ("constructs", "structs"):
        cases = constructs.cases() if group == "constructs" else structs.cases(device.has_fp64)
        return list(_of_cases(cases))
    if group == "scenes":
        return [Check(*row) for row in scenes.tests(part, device.has_fp64)]
    return [Check(*row) for row in OTHERS[group]]
