"""Frames as tests: golden hashes of generated scenes, and every triangle of a grid.

golden.json holds the choices of each scene, which cover all pairs of levels (test_conform.py names pairs without a row),
and the digest of its frame. For a new choice, add a level of it to each row, and rows until all pairs are covered;
`conform --write-golden` draws them.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

from ...base.atomic_files import shown, write_bytes
from ...errors import DeviceError
from ...pipeline.features import OPTIONAL
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer
from ..check import check
from ..digest import digest
from ..stability.cases import bench as cases_bench
from ..stability.cases import coverage
from .case import Bench, Check, divides, flushes
from .content import GoldenScene, golden_scene

GOLDEN = Path(__file__).with_name("golden.json")


def golden(has_fp64: bool) -> list[tuple[GoldenScene, str]]:
    """Return the scenes, as a device with or without float64 can draw them, and the digest that each frame has to have."""
    digests = []
    for number, row in enumerate(json.loads(GOLDEN.read_text())):
        scene = golden_scene(number, row["choice"])
        reduced = scene.needs_float64 and not has_fp64
        digests.append((scene.without_float64(), row["float32"]) if reduced else (scene, row["digest"]))
    return digests


def tests(program: str, has_fp64: bool) -> list[Check]:
    """Return the tests of a program's scenes, for a device with or without float64."""
    scenes = [(scene, digest) for scene, digest in golden(has_fp64) if scene.choice["program"] == program]
    return [Check(scene.name, program, partial(_compare, scene, digest)) for scene, digest in scenes]


def draw(scene: GoldenScene, device: Device) -> Frame:
    with Renderer(scene.scene, device=device, settings=scene.settings, forced=OPTIONAL) as renderer:
        return renderer.render()


def _compare(scene: GoldenScene, expected: str, bench: Bench) -> str:
    """Return how a frame differs from the golden one, and whether it is right all the same. Where denormals or divisions may
    differ it has to agree with the oracle."""
    frame = draw(scene, bench.device)
    if digest(frame) == expected:
        return ""
    problem = check.problem(frame)
    if not problem and (flushes(bench.device) or not divides(bench.device)):
        return ""
    described = ", ".join(f"{name} {level}" for name, level in scene.choice.items())
    return f"{problem or 'other bits, within the bounds of the oracle'} ({described})"


def write_golden(device: str | None, path: str) -> None:
    """Draw all scenes on a device, compare each with the oracle, and write choices and digests: `conform --write-golden`.

    Raises DeviceError, and writes nothing, if any frame exceeds its bounds.
    """
    opened, rows = open_device(device), json.loads(GOLDEN.read_text())
    for number, row in enumerate(rows):
        scene = golden_scene(number, row["choice"])
        for name, variant in (("digest", scene), ("float32", scene.without_float64()))[: 1 + scene.needs_float64]:
            frame = draw(variant, opened)
            problem = check.problem(frame)
            if problem:
                raise DeviceError(f"{opened.name}: {scene.name}: expected a frame within its bounds, found {problem}")
            row[name] = digest(frame)
    lines = ",\n".join(json.dumps(row) for row in rows)
    write_bytes(Path(path), f"[\n{lines}\n]\n".encode())
    print(f"{len(rows)} scenes agree with the oracle: wrote {shown(Path(path))}")


def _cover(case: cases_bench.Case, bench: Bench) -> str:
    outcome = case.run(cases_bench.Bench(bench.device, triangles=2000))
    return "" if outcome.passed else f"{outcome.wrong} pixels are wrong"


COVERAGE = [
    Check(case.name.replace("-", "_"), f"{case.title}: {case.expected}", partial(_cover, case))
    for case in coverage.CASES
    if case.name in ("half-pixel-grid", "edges-on-centers", "slivers")
]
