"""How time and memory grow with triangles and with pixels: fitted powers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..report.tessellation import loglog_slope
from .frame_timing import FrameTiming
from .workloads import SCALING

EXPONENT = 1.05  # the bar
LEAST_TIME, LEAST_MEMORY = 1.0, 0.15  # of the fixed cost, that is more than noise
FEWEST_POINTS = 3  # of a fit
NAMES = ("triangles", "pixels")


@dataclass(frozen=True)
class Series:
    """name: what grows. fixed: drawn with few of them. points: by growing size, see `sizes`."""

    name: str
    fixed: FrameTiming
    points: tuple[FrameTiming, ...]

    @property
    def sizes(self) -> list[int]:
        """Triangles, or pixels, of each point."""
        return [
            each.triangles if self.name == "triangles" else each.resolution[0] * each.resolution[1]
            for each in self.points
        ]

    def exponents(self) -> dict[str, float | None]:
        """Of time, plain and beyond the fixed cost, and of memory beyond it; None without enough points."""
        times = [each.ms for each in self.points]
        memory = [each.peak_mib for each in self.points]
        return {
            "time": power(self.sizes, times),
            "time beyond the fixed cost": power_beyond(self.sizes, times, self.fixed.ms, LEAST_TIME),
            "memory beyond the fixed cost": power_beyond(self.sizes, memory, self.fixed.peak_mib, LEAST_MEMORY),
        }

    def stats(self) -> dict[str, Any]:
        return {
            "grows": self.name,
            "sizes": self.sizes,
            "ms": [each.ms for each in self.points],
            "peak_mib": [each.peak_mib for each in self.points],
            "fixed_ms": self.fixed.ms,
            "fixed_peak_mib": self.fixed.peak_mib,
            "exponents": self.exponents(),
        }


def power(sizes: Sequence[float], values: Sequence[float]) -> float | None:
    """Exponent of the power law through the points that is best in logarithms."""
    return loglog_slope(sizes, values) if len(sizes) >= FEWEST_POINTS else None


def power_beyond(
    sizes: Sequence[float], values: Sequence[float | None], fixed: float | None, least: float
) -> float | None:
    """The same of what the values are above `fixed`, from the size on from which that is at least `least` of it: the
    difference of nearly equal values is noise."""
    if fixed is None:
        return None
    kept: list[tuple[float, float]] = []
    for size, value in zip(reversed(sizes), reversed(values), strict=True):
        if value is None or value - fixed < least * fixed:
            break
        kept.append((size, value - fixed))
    return power(*zip(*kept, strict=True)) if kept else None


def scaling(measure: Callable[[str], FrameTiming]) -> tuple[Series, ...]:
    """measure: draws the workload of a name in SCALING."""
    found = []
    for name in NAMES:
        measure(f"{name}-fixed")  # what compiling the kernels takes of memory is not the scene's
        fixed, *points = (measure(each) for each in SCALING if each.startswith(name))
        found.append(Series(name, fixed, tuple(points)))
    return tuple(found)
