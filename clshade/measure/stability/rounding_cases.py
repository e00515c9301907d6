"""`python -m clshade stability --random-rounding RUNS`: the images of the stiff cases under random rounding."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, text_tables
from ...base.atomic_files import shown
from ...errors import InputError
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device, open_device
from ...scene.model import Scene
from ..check.check import compare, sample
from ..rounding.spread import Spread, check_options, measure
from . import rounding_tables
from .cases import Bench
from .stability import chosen, run_case

PIXELS = 1 << 15  # of an image at most; of a larger one a sample


class RoundingBench(Bench):
    """A bench that draws each image of a case under random rounding too. spreads: of the images in float32 so far."""

    def __init__(self, device: Device, folder: Path, runs: int, *, triangles: int) -> None:
        super().__init__(device, folder, triangles=triangles)
        self.runs = runs
        self.spreads: list[Spread] = []

    def draw(self, scene: Scene, **options: Any) -> Frame:
        frame = super().draw(scene, **options)
        if frame.settings.precision != "float64":
            self.spreads.append(measure(compare(frame, sample(frame, PIXELS, 0)), self.device, self.runs))
        return frame


def run(
    device: str | None,
    runs: int,
    *,
    out: str | Path = "stability",
    names: Sequence[str] = (),
    triangles: int = 50_000,
    stream: TextIO | None = None,
) -> bool:
    """Run the cases that draw images, print a row for each, and write rounding.json. Returns True if no pixel is above its
    bound. Arguments and errors as of `stability.run`, for one device; ClshadeError if an optional package is missing."""
    stream = stream or sys.stdout
    check_options(runs)
    cases = chosen(names, triangles)
    if device == "all":
        raise InputError("stability: --random-rounding: cannot go with --device all")
    opened, start = open_device(device), time.perf_counter()
    folder = text_tables.create_folder(out)
    passed, stats, quiet = True, {}, []
    print(f"{opened.title}\n{rounding_tables.case_line(rounding_tables.CASES)}", file=stream, flush=True)
    for case in cases:
        bench = RoundingBench(opened, folder, runs, triangles=triangles)
        result = run_case(case, bench)
        name = f"{case.number} {case.name}"
        if result.problem:
            print(f"{name}: {result.problem}", file=stream, flush=True)
        passed &= not result.problem
        if not bench.spreads:
            quiet += [] if result.problem else [name]
            continue
        row = rounding_tables.case_row(name, bench.spreads)
        print(rounding_tables.case_line(row), file=stream, flush=True)
        passed &= all(each.passed for each in bench.spreads)
        stats[case.name] = [each.stats() for each in bench.spreads]
    print(text_tables.wrapped(f"without an image in float32: {', '.join(quiet) or 'none'}", 2), file=stream)
    path = folder / "rounding.json"
    atomic_files.write_bytes(path, (json.dumps(stats, indent=2) + "\n").encode())
    seconds = time.perf_counter() - start
    print(f"{runs} runs of each image, {seconds:.0f} s: {'passed' if passed else 'FAILED'}", file=stream)
    print(f"wrote {shown(path)}", file=stream)
    return passed
