"""Helpers of the tests of `bench`: small workloads, and invented results."""

from __future__ import annotations

from clshade.measure.bench import device_peaks, results, scaling, starting
from clshade.measure.bench.frame_timing import FrameTiming
from clshade.measure.bench.peers import agreement
from clshade.measure.bench.peers.agreement import TOLERANCE
from clshade.measure.bench.workloads import Limit, Workload, full_screen, knot, thing
from clshade.measure.timing import Spread

SMALL = {
    "object": lambda: thing(128, level=3),
    "knot": lambda: knot(300, (192, 144)),
    "quads": lambda: full_screen(4, (48, 32)),
    "lights": lambda: thing(128, level=2, lights=8),
}


def made_up(*measured, **more):
    return results.Speed("a device", "a machine", device_peaks.Peaks(1e9, 1e10, 5e8, 1e9), tuple(measured), **more)


def drawn_with(triangles=100, ms=2.0, side=10, peak=None):
    return FrameTiming(
        (side, side), triangles, side**2, 5, Spread(0.9 * ms, ms, 1.1 * ms), {"host": ms}, 10**6, 10**7, peak
    )


def compared(peer, ours, theirs, same=True):
    found = agreement.Agreement(0.5, 1e-5 if same else 0.5, TOLERANCE, 1.0)
    return results.Compared(
        peer, f"{peer} 1", Spread(ours, ours, ours), Spread(theirs, theirs, theirs), 5, found, 3, (2.0, 9.0)
    )


def small_speed():
    workload = Workload("w", "", lambda: None, ratios={"llvmpipe": 5.0}, limits=(Limit("ms", "ms a frame", 1.0),))
    result = results.Result(workload, drawn_with(), (compared("llvmpipe", 2.0, 12.0), compared("numpy", 2.0, 30.0)))
    started = starting.Started(Spread(0.4, 0.5, 0.6), Spread(3.0, 4.0, 5.0), 5)
    points = tuple(drawn_with(n, 1.0 + n, peak=100.0 + n) for n in (10, 100, 1000))
    return made_up(
        result, started=started, series=(scaling.Series("phong", "triangles", drawn_with(1, 1.0, peak=100.0), points),)
    )
