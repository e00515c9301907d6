"""How time and memory grow with triangles and with pixels: fitted powers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .drawing import Drawn
from .tessellation import loglog_slope
from .workloads import SCALING

EXPONENT = 1.05  # the bar
FEWEST_POINTS = 3  # of a fit
NAMES = ("triangles", "pixels")


@dataclass(frozen=True)
class Series:
    """name: what grows. fixed: drawn without any of it. points: by growing size, see `sizes`."""

    name: str
    fixed: Drawn
    points: tuple[Drawn, ...]

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
            "time beyond the fixed cost": power_beyond(self.sizes, times, self.fixed.ms),
            "memory beyond the fixed cost": power_beyond(self.sizes, memory, self.fixed.peak_mib),
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


def power_beyond(sizes: Sequence[float], values: Sequence[float | None], fixed: float | None) -> float | None:
    """The same of what the values are above `fixed`, of the points where that is at least as much again: a difference of
    nearly equal times is noise. Smaller sizes would only make the plain power smaller."""
    if fixed is None or None in values:
        return None
    kept = [(size, value - fixed) for size, value in zip(sizes, values, strict=True) if value and value >= 2.0 * fixed]
    return power(*zip(*kept, strict=True)) if len(kept) >= FEWEST_POINTS else None


def scaling(measure: Callable[[str], Drawn]) -> tuple[Series, ...]:
    """measure: draws the workload of a name in SCALING."""
    found = []
    for name in NAMES:
        fixed, *points = (measure(each) for each in SCALING if each.startswith(name))
        found.append(Series(name, fixed, tuple(points)))
    return tuple(found)
