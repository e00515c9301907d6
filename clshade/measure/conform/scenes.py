"""Frames as tests: golden hashes of generated scenes, and every triangle of a grid."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ...base.atomic_files import shown, write_bytes
from ...errors import DeviceError
from ...pipeline.opencl.device import open_device
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
        scene = golden_scene(number, row["choice"])
        reduced = scene.needs_float64 and not has_fp64
        found.append((scene.without_float64(), row["float32"]) if reduced else (scene, row["digest"]))
    return found


def _compare(scene: GoldenScene, expected: str, bench: Bench) -> str:
    """Return how a frame differs from the golden one, and whether it is right all the same."""
    frame = bench.draw(scene.scene, **options(scene))
    if digest(frame) == expected:
        return ""
    problem = check.problem(frame)
    if not problem and (flushes(bench.device) or not divides(bench.device)):
        raise Skipped("bits may differ where denormals or divisions do: such frames agree with the oracle")
    return f"{problem or 'other bits, within the bounds of the oracle'} ({scene.described})"


def tests(program: str, has_fp64: bool) -> list[tuple[str, str, Callable[[Bench], str]]]:
    """Return names, titles and functions of the scenes of a program, for a device with or without float64."""
    return [
        (scene.name, program, partial(_compare, scene, expected))
        for scene, expected in golden(has_fp64)
        if scene.choice["program"] == program
    ]


def _right(bench: Bench, scene: GoldenScene) -> str:
    """Return the digest of a frame that agrees with the oracle. Raises DeviceError if it does not."""
    frame = bench.draw(scene.scene, **options(scene))
    problem = check.problem(frame)
    if problem:
        raise DeviceError(f"{bench.device.name}: {scene.name}: expected a frame within its bounds, found {problem}")
    return digest(frame)


def write_golden(device: str | None, path: str) -> None:
    """Draw all scenes on a device, compare each with the oracle, and write choices and digests: `conform --write-golden`.

    Raises DeviceError, and writes nothing, if any frame exceeds its bounds.
    """
    bench, rows = Bench(open_device(device)), []
    for number, row in enumerate(choices()):
        scene = golden_scene(number, row)
        drawn = {"digest": scene, **({"float32": scene.without_float64()} if scene.needs_float64 else {})}
        rows.append({**{name: _right(bench, scene) for name, scene in drawn.items()}, "choice": row})
    lines = ",\n".join(json.dumps(row) for row in rows)
    write_bytes(Path(path), f"[\n{lines}\n]\n".encode())
    print(f"{len(rows)} scenes agree with the oracle: wrote {shown(Path(path))}")


# Coverage


def _cover(case: cases_bench.Case, bench: Bench) -> str:
    outcome = case.run(cases_bench.Bench(bench.device, triangles=2000))
    return "" if outcome.passed else f"{outcome.wrong} pixels are wrong: {outcome.detail}"


COVERAGE = [
    (case.name.replace("-", "_"), f"{case.title}: {case.expected}", partial(_cover, case))
    for case in coverage.CASES
    if case.name in ("half-pixel-grid", "edges-on-centers", "slivers")
]
