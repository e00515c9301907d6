"""The same bits in every run and build."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...scene.builtin.scenes import builtin
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


def _case() -> Case:
    return Case("mixed", "", _TEXT, (rng(30).uniform(0.0, 0.5, 1024).astype(np.float32),), lambda a: np.zeros_like(a))


def builds(bench: Bench) -> str:
    """A kernel that is built again for each run, as a text that no cache knows."""
    salt = int(np.random.default_rng().integers(1 << 60))
    first = b""
    for run in range(RUNS):
        found = bench.run(_case(), f"{_case().source}// {salt} {run}\n").tobytes()
        if run and found != first:
            return f"build {run + 1} of {RUNS} gives other bits than the first"
        first = first or found
    return ""


def launches(bench: Bench) -> str:
    """A kernel that is built once and launched again and again."""
    case = _case()
    first = bench.run(case).tobytes()
    for run in range(1, RUNS):
        if bench.run(case).tobytes() != first:
            return f"run {run + 1} of {RUNS} gives other bits than the first"
    return ""


def _frames(name: str, resolution: tuple[int, int]) -> Callable[[Bench], str]:
    def run(bench: Bench) -> str:
        prints = bench.draw_again(builtin(name), RUNS, resolution=resolution, shader="nolight", layers=("Z", "id"))
        other = next((k for k, each in enumerate(prints) if each != prints[0]), 0)
        return f"frame {other + 1} of {RUNS} has other bits than the first: {prints[other]}" if other else ""

    return run


def tests() -> list[tuple[str, str, Callable[[Bench], str]]]:
    """Return names, titles and functions."""
    return [
        ("launches", f"{RUNS} launches of a kernel", launches),
        ("builds", f"{RUNS} builds of a kernel", builds),
        ("small_frames", f"{RUNS} frames of 61 x 47 pixels", _frames("teapot", (61, 47))),
        ("large_frames", f"{RUNS} frames of 800 x 600 pixels", _frames("teapot", (800, 600))),
    ]
