"""What tests of `bench` share: small workloads, and results made up."""

from __future__ import annotations

from clshade.measure.bench import device_peaks, results
from clshade.measure.bench.workloads import full_screen, knot, thing

SMALL = {
    "object": lambda: thing(128, level=3),
    "knot": lambda: knot(300, (192, 144)),
    "quads": lambda: full_screen(4, (48, 32)),
    "lights": lambda: thing(128, level=2, lights=8),
}


def made_up(*measured, **more):
    return results.Speed("a device", "a machine", device_peaks.Peaks(1e9, 1e10), tuple(measured), **more)
