"""Helpers of the tests of `bench`: small workloads, and invented results."""

from __future__ import annotations

from clshade.measure.bench import device_peaks, tables
from clshade.measure.bench.agreement import TOLERANCE, Agreement
from clshade.measure.bench.frame_timing import FrameTiming
from clshade.measure.bench.starting import Start
from clshade.measure.bench.tables import Compared, Timed
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
STARTS = [Start("warm", Spread(0.4, 0.5, 0.6), 5), Start("empty", Spread(3.0, 4.0, 5.0), 5)]


def timed(name="w", ms=2.0, same=True, **changes):
    fields = {
        "resolution": (10, 10),
        "triangles": 100,
        "covered": 100,
        "frames": 5,
        "frame_ms": Spread(0.9 * ms, ms, 1.1 * ms),
        "stages": {"host": 0.5 * ms, "phong": 0.5 * ms},
        "held": {"scene": 900_000, "image": 100_000, "owners": 1 << 20},
        "flops": 10**7,
    }
    agreement = Agreement(0.5, 1e-5 if same else 0.5, TOLERANCE, 1.0)
    compared = Compared("llvmpipe 1", Spread(ms, ms, ms), Spread(6 * ms, 6 * ms, 6 * ms), 5, (2.0, 9.0), agreement)
    return Timed(name, FrameTiming(**{**fields, **changes}), compared)


def results_of(*several, starts=(), errors=None) -> Results:
    """Return the results on a device that copies 1e9 bytes, fills 5e8 and computes 1e10 flops per second."""
    return tables.results("a device", device_peaks.Peaks(1e9, 1e10, 5e8), several, starts, errors or {})
