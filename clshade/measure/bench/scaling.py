"""Scaling of time and memory with triangles and with pixels: fitted power laws."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..report import power_law
from .frame_timing import FrameTiming
from .workloads import SCALING, WAYS

EXPONENT = 1.05  # the bar
LEAST_TIME, LEAST_MEMORY = 1.0, 0.15  # fractions of the fixed cost that exceed noise
FEWEST_POINTS = 3  # in a fit
MOST_BYTES = 200  # that a triangle takes in any way to draw
KINDS = ("triangles", "pixels")


@dataclass(frozen=True)
class Series:
    """Measurements of growing size. kind: what grows. way: of WAYS. fixed: measured with few of them. points: by
    increasing size."""

    way: str
    kind: str
    fixed: FrameTiming
    points: tuple[FrameTiming, ...]

    @property
    def name(self) -> str:
        return f"{self.way}-{self.kind}"

    @property
    def sizes(self) -> list[int]:
        """Number of triangles, or pixels, of each point."""
        return [
            each.triangles if self.kind == "triangles" else each.resolution[0] * each.resolution[1]
            for each in self.points
        ]

    def exponents(self) -> dict[str, float | None]:
        """Fitted exponents: of time, plain and beyond the fixed cost, and of memory beyond it; None without enough
        points."""
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
    """Return the exponent of the power law fitted in logarithms."""
    return power_law.exponent(sizes, values) if len(sizes) >= FEWEST_POINTS else None


def power_beyond(
    sizes: Sequence[float], values: Sequence[float | None], fixed: float | None, least: float
) -> float | None:
    """Return the exponent of the excess over `fixed`, from the size at which it is at least the fraction `least` of
    `fixed`: differences of nearly equal values are noise."""
    if fixed is None:
        return None
    kept: list[tuple[float, float]] = []
    for size, value in zip(reversed(sizes), reversed(values), strict=True):
        if value is None or value - fixed < least * fixed:
            break
        kept.append((size, value - fixed))
    return power(*zip(*kept, strict=True)) if kept else None


def fits(name: str, memory: float) -> bool:
    """Return whether a workload of SCALING fits into so many bytes."""
    _, kind, size = name.split("-")
    return kind == "pixels" or size == "fixed" or int(size) * MOST_BYTES <= memory


def scaling(measure: Callable[[str], FrameTiming], memory: float = math.inf) -> tuple[Series, ...]:
    """Measure all series. measure: draws the workload of a name in SCALING. memory: bytes, without the points that take
    more."""
    found = []
    for way, kind in itertools.product(WAYS, KINDS):
        name = f"{way}-{kind}"
        measure(f"{name}-fixed")  # excludes the memory used for compiling the kernels
        fixed, *points = (measure(each) for each in SCALING if each.startswith(name) and fits(each, memory))
        found.append(Series(way, kind, fixed, tuple(points)))
    return tuple(found)
