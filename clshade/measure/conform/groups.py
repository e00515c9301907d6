"""The tests of a device, in groups; those of memory and repeatability."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from ...base.host_memory import available
from ...errors import DeviceError
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ..digest import digest
from . import constructs, operations, scenes, structs
from .bare_kernel import edge_bytes
from .case import Bench, Case, Check, divides
from .content import PROGRAMS
from .operands import rng

GROUPS = {
    "operations": "each against its definition",
    "constructs": "what kernels are made of",
    "structs": "sizes and places of members",
    "memory": "limits of allocations",
    "repeatability": "the same bits in every run",
    "coverage": "every triangle of a grid",
    "scenes": "golden hashes, all pairs of features",
}
SHARE, MOST = 4, 64 << 30  # a buffer takes one part in SHARE of the free memory, of which at most MOST bytes count
WRITTEN = (5, 7)  # into a buffer's first and last byte
RUNS = 100
MIXED = """
kernel void mixed(global const float *a, global float *out)
{
    int i = get_global_id(0);
    float sum = 0.0f;
    for (int k = 0; k < 64; ++k)
        sum = sum / 1.5f + a[(i + k * k) % 1024] * sum - sqrt(fabs(sum - a[k]));
    out[i] = sum;
}
"""


def parts_of(group: str, has_fp64: bool) -> list[str]:
    """Return the parts of a group that may run at the same time, each in a process of its own."""
    if group == "operations":
        return ["float32-own", "float32-library", *(["float64-own", "float64-library"] if has_fp64 else [])]
    return list(PROGRAMS) if group == "scenes" else [""]


def tests_of(group: str, part: str, device: Device) -> list[Check]:
    """Return the tests of a part of one of GROUPS."""
    if group == "operations":
        real, functions = part.split("-")
        lanes = dict.fromkeys((device.lanes, 1))
        ways = [operations.Way(getattr(np, real), functions == "library", count) for count in lanes]
        tests = [(way, case) for way in ways for case in operations.cases(way)]
        left_out = () if divides(device) else operations.DIVIDING
        return [Check(f"{way}/{case.name}", case.title, case) for way, case in tests if case.name not in left_out]
    if group in ("constructs", "structs"):
        cases = constructs.cases() if group == "constructs" else structs.cases(device.has_fp64)
        return [Check(case.name, case.title, case) for case in cases]
    if group == "scenes":
        return scenes.tests(part, device.has_fp64)
    return {"memory": MEMORY, "repeatability": REPEATABILITY, "coverage": scenes.COVERAGE}[group]


def sizes(bench: Bench) -> str:
    """Sizes about powers of two, where those in 32 bits overflow, and the largest that no device may refuse."""
    device = bench.device
    limit = min(device.max_allocation, int(min(device.memory, available(), MOST)) // SHARE)
    powers = [(1 << power) + more for power in (16, 20, 24, 28, 31, 32) for more in (-1, 0, 1)]
    for size in (*(size for size in powers if size <= limit), limit):
        bytes_per_edge = edge_bytes(device, size)
        if bytes_per_edge != WRITTEN:
            return f"{size} bytes: expected {WRITTEN} at the ends, found {bytes_per_edge}"
    return ""


def beyond(bench: Bench) -> str:
    size = 4 * max(bench.device.memory, bench.device.max_allocation, 1 << 40)
    try:
        edge_bytes(bench.device, size)
    except DeviceError:
        return ""
    return f"{size} bytes: expected an error, found a buffer"


def builds(bench: Bench) -> str:
    """A kernel that is built again for each run, as a text that no cache knows."""
    numbers, salt = rng(30).uniform(0.0, 0.5, 1024).astype(np.float32), np.random.default_rng().integers(1 << 60)
    cases = (Case("mixed", "", f"{MIXED}// {salt} {run}\n", (numbers,), np.zeros_like) for run in range(RUNS))
    return _first_other(bench.run(case, numbers).tobytes() for case in cases)


def frames(resolution: tuple[int, int], bench: Bench) -> str:
    options: dict[str, Any] = {"resolution": resolution, "shader": "nolight", "layers": ("Z", "id")}
    with Renderer(builtin("teapot"), device=bench.device, **options) as renderer:
        return _first_other(digest(renderer.render()) for _ in range(RUNS))


def _first_other(outputs: Iterable[object]) -> str:
    """Return which run gives other bits than the first, "" if none does."""
    first, *others = outputs
    run = next((run for run, result in enumerate(others, 2) if result != first), 0)
    return f"run {run} of {RUNS} gives other bits than the first" if run else ""


MEMORY = [
    Check("sizes_of_buffers", "first and last bytes of buffers up to the largest", sizes),
    Check("beyond_the_limit", "a buffer of four times the memory is refused", beyond),
]
REPEATABILITY = [
    Check("builds", f"{RUNS} builds of a kernel", builds),
    Check("small_frames", f"{RUNS} frames of 61 x 47 pixels", partial(frames, (61, 47))),
    Check("large_frames", f"{RUNS} frames of 800 x 600 pixels", partial(frames, (800, 600))),
]
