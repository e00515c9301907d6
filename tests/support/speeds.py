"""Helpers of the tests of `bench`: small workloads, and invented results."""

from __future__ import annotations

from clshade.measure.bench import device_peaks, tables
from clshade.measure.bench.agreement import TOLERANCE, Agreement
from clshade.measure.bench.frame_timing import Compared, FrameTiming
from clshade.measure.bench.workloads import Workload, full_screen, knot, thing
from clshade.measure.results import Results
from clshade.measure.timing import Spread

SMALL = {
    "object": lambda: thing(128, level=3),
    "knot": lambda: knot(300, (192, 144)),
    "quads": lambda: full_screen(4, (48, 32)),
    "lights": lambda: thing(128, level=2, lights=8),
}
WORKLOADS = tuple(Workload(name, f"small {name}", make) for name, make in SMALL.items())


def timed(name="w", median=2.0, same=True, **changes):
    agreement = Agreement(0.5, 1e-5 if same else 0.5, TOLERANCE, 1.0)
    fields = {
        "resolution": (10, 10),
        "triangles": 100,
        "covered": 100,
        "frames": 5,
        "ms": Spread(0.9 * median, median, 1.1 * median),
        "stages": {"host": 0.5 * median, "phong": 0.5 * median},
        "held": {"scene": 900_000, "image": 100_000, "owners": 1 << 20},
        "flops": 10**7,
        "compared": Compared("llvmpipe 1", median, 6 * median, 5, (2.0, 9.0), agreement),
    }
    return FrameTiming(name, **{**fields, **changes})


def results_of(*several, errors=None) -> Results:
    """Return the results on a device that fills 5e8 bytes and computes 1e10 flops per second."""
    return tables.results("a device", device_peaks.Peaks(flops=1e10, fill=5e8), several, errors or {})
