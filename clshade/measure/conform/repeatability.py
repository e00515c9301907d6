"""The same bits in every run and build."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ..digest import digest
from .case import Bench, Case
from .operands import rng

RUNS = 100
_TEXT = """
kernel void mixed(global const float *a, global float *out)
{
    int i = get_global_id(0);
    float sum = 0.0f;
    for (int k = 0; k < 64; ++k)
        sum = sum / 1.5f + a[(i + k * k) % 1024] * sum - sqrt(fabs(sum - a[k]));
    out[i] = sum;
}
"""


def builds(bench: Bench) -> Iterator[bytes]:
    """A kernel that is built again for each run, as a text that no cache knows."""
    numbers, salt = rng(30).uniform(0.0, 0.5, 1024).astype(np.float32), np.random.default_rng().integers(1 << 60)
    for run in range(RUNS):
        case = Case("mixed", "", f"{_TEXT}// {salt} {run}\n", (numbers,), np.zeros_like)
        yield bench.run(case, numbers).tobytes()


def frames(resolution: tuple[int, int], bench: Bench) -> Iterator[str]:
    options: dict[str, Any] = {"resolution": resolution, "shader": "nolight", "layers": ("Z", "id")}
    with Renderer(builtin("teapot"), device=bench.device, **options) as renderer:
        for _ in range(RUNS):
            yield digest(renderer.render())


def _first_other(repeat: Callable[[Bench], Iterator[object]], bench: Bench) -> str:
    """Return which run of `repeat` gives other bits than the first, "" if none does."""
    first, *others = repeat(bench)
    run = next((run for run, found in enumerate(others, 2) if found != first), 0)
    return f"run {run} of {RUNS} gives other bits than the first" if run else ""


TESTS = (
    ("builds", f"{RUNS} builds of a kernel", partial(_first_other, builds)),
    ("small_frames", f"{RUNS} frames of 61 x 47 pixels", partial(_first_other, partial(frames, (61, 47)))),
    ("large_frames", f"{RUNS} frames of 800 x 600 pixels", partial(_first_other, partial(frames, (800, 600)))),
)
