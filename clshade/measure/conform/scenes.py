"""Frames as tests: golden hashes of generated scenes, and every triangle of a grid."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...base.atomic_files import write_bytes
from ...errors import DeviceError
from ..check import check
from ..digest import digest
from ..stability.cases import bench as cases_bench
from ..stability.cases import coverage
from .case import Bench, Skipped, divides, flushes
from .content import GoldenScene, choices, golden_scene, options

GOLDEN = Path(__file__).with_name("golden.json")


def golden(has_fp64: bool) -> list[tuple[GoldenScene, str]]:
    """Return the scenes, as a device with or without float64 can draw them, and the digest that each frame has to have."""
    found = []
    for number, row in enumerate(json.loads(GOLDEN.read_text())):
        each = golden_scene(number, row["choice"])
        if has_fp64 or not each.needs_float64:
            found.append((each, row["digest"]))
        else:
            found.append((each.without_float64(), row["float32"]))
    return found


def _compare(each: GoldenScene, expected: str, bench: Bench) -> str:
    """Return how a frame differs from the golden one, and whether it is right all the same."""
    frame = bench.draw(each.scene, **options(each))
    if digest(frame) == expected:
        return ""
    wrong = check.problem(frame)
    if not wrong and (flushes(bench.device) or not divides(bench.device)):
        raise Skipped("bits may differ where denormals or divisions do: such frames agree with the oracle")
    if not wrong:
        return f"other bits, within the bounds of the oracle ({each.described})"
    return f"{wrong} ({each.described})"


def tests(program: str, has_fp64: bool) -> list[tuple[str, str, Callable[[Bench], str]]]:
    """Return names, titles and functions of the scenes of a program, for a device with or without float64."""
    return [
        (each.name, program, partial(_compare, each, expected))
        for each, expected in golden(has_fp64)
        if each.choice["program"] == program
    ]


def _right(bench: Bench, each: GoldenScene) -> str:
    """Return the digest of a frame that agrees with the oracle. Raises DeviceError if it does not."""
    frame = bench.draw(each.scene, **options(each))
    wrong = check.problem(frame)
    if wrong:
        raise DeviceError(f"{bench.device.name}: {each.name}: expected a frame within its bounds, found {wrong}")
    return digest(frame)


def write_golden(bench: Bench, path: Path) -> int:
    """Draw all scenes, compare each with the oracle, and write choices and digests; return the number of scenes.

    Raises DeviceError, and writes nothing, if any frame exceeds its bounds.
    """
    rows = []
    for number, row in enumerate(choices()):
        each = golden_scene(number, row)
        digests = {"digest": _right(bench, each)}
        if each.needs_float64:
            digests["float32"] = _right(bench, each.without_float64())
        rows.append({**digests, "choice": row})
    lines = ",\n".join(json.dumps(row) for row in rows)
    write_bytes(path, f"[\n{lines}\n]\n".encode())
    return len(rows)


# Coverage


class _CaseBench(cases_bench.Bench):
    """The bench of `stability`'s cases, which draws as ours does."""

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench.device, triangles=2000)
        self._bench = bench

    def draw(self, scene: Any, **chosen: Any) -> Any:
        return self._bench.draw(scene, layers=cases_bench.LAYERS, **chosen)


COVERAGE = ("half-pixel-grid", "edges-on-centers", "slivers")


def _cover(name: str, bench: Bench) -> str:
    case = next(case for case in coverage.CASES if case.name == name)
    outcome = case.run(_CaseBench(bench))
    return "" if outcome.passed else f"{outcome.wrong} pixels are wrong: {outcome.detail}"


def coverage_tests() -> list[tuple[str, str, Callable[[Bench], str]]]:
    """Return names, titles and functions of cases of `stability` that are compared with exact integers."""
    return [
        (case.name.replace("-", "_"), f"{case.title}: {case.expected}", partial(_cover, case.name))
        for case in coverage.CASES
        if case.name in COVERAGE
    ]
