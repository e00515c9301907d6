"""How far the pixels of a scene spread when operations round to a random neighbor, beside the bounds of `check`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.json_values import plain
from ...errors import DeviceError, InputError
from ...pipeline import programs
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ..check.check import Comparison
from .rewrite import check_packages, random_rounding

LEAST_RUNS = 2
LEAST_ERROR = 2.0**-48  # of the light budget: smaller ones may be the oracle's own, and count as none
CAREFUL = 100.0  # a bound so many times the largest error found is too careful
MOST_DIGITS = 10.0  # more count as so many: dark pixels have more, relative to the light budget
MOVED = ("phong.cl", "pbr.cl", "gouraud.cl")  # the kernel files, of which one is in each program that is rewritten
QUANTILES = {"least": 0.0, "p1": 0.01, "median": 0.5, "p99": 0.99}


@dataclass(frozen=True, eq=False)
class Spread:
    """The spread of K compared pixels over some runs, all relative to the light budget B, (K,).

    spread: standard deviation of the channel where it is largest. found: the largest error against the oracle in any run,
    infinite where a pixel was wrong. expected: the most that is allowed of it. counted: pixels that show a surface and
    were not excepted for a tie in any run. same: whether the rewritten program draws the image's bits if nothing moves.
    seconds: of the runs, and of making and compiling their program.
    """

    runs: int
    spread: Floats
    found: Floats
    expected: Floats
    counted: Bools
    same: bool
    seconds: float

    @property
    def too_small(self) -> Bools:
        """Where an error exceeds its bound, or a pixel was wrong, also of the background."""
        result: Bools = (self.counted & ~(self.found <= self.expected)) | np.isinf(self.found)
        return result

    @property
    def too_large(self) -> Bools:
        """Where the bound is more than CAREFUL times the largest error, and there is one."""
        result: Bools = self.counted & (self.found > LEAST_ERROR) & (self.expected > CAREFUL * self.found)
        return result

    @property
    def exact(self) -> Bools:
        """Where no run had an error."""
        result: Bools = self.counted & (self.found <= LEAST_ERROR)
        return result

    @property
    def passed(self) -> bool:
        return self.same and not self.too_small.any()

    @property
    def ratio(self) -> Floats:
        """(K,) the largest error in parts of its bound; 0 where not counted."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.counted & (self.found > 0.0), self.found / self.expected, 0.0)

    @property
    def worst(self) -> float:
        """The largest `ratio`."""
        return float(self.ratio.max(initial=0.0))

    def quantiles(self) -> dict[str, dict[str, float]]:
        """Return quantiles of the digits found and promised at the counted pixels, by the names of QUANTILES; empty without
        any."""
        if not self.counted.any():
            return {}
        kinds = {"found": digits(self.spread), "promised": digits(self.expected)}
        return {
            kind: {name: float(np.quantile(values[self.counted], at)) for name, at in QUANTILES.items()}
            for kind, values in kinds.items()
        }

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        counts = {name: int(getattr(self, name).sum()) for name in ("counted", "too_small", "too_large", "exact")}
        found = {"runs": self.runs, **counts, "same": self.same, "worst": self.worst}
        result: dict[str, Any] = plain({**found, "digits": self.quantiles(), "seconds": self.seconds})
        return result


def digits(relative: Floats) -> Floats:
    """Return the decimal digits that errors relative to the light budget leave, from 0 to MOST_DIGITS."""
    with np.errstate(divide="ignore"):
        result: Floats = np.clip(-np.log10(relative), 0.0, MOST_DIGITS)
    return result


def check_options(runs: int, precision: str = "float32") -> None:
    """Raise InputError for too few runs or float64, and ClshadeError if an optional package is missing."""
    if runs < LEAST_RUNS:
        raise InputError(f"stability: --random-rounding: expected a number of runs from {LEAST_RUNS} on, found {runs}")
    if precision == "float64":
        raise InputError("stability: --random-rounding: expected precision float32 or fast, found float64")
    check_packages()


def measure(found: Comparison, device: Device, runs: int) -> Spread:
    """Draw the frame of a comparison again in `runs` runs with random rounding, and compare each with the oracle. One thread
    at a time: the programs hold the number of the run.

    Raises InputError for fewer than two runs or precision float64, DeviceError for a device without float64, and
    ClshadeError if an optional package is missing.
    """
    frame, start = found.frame, time.perf_counter()
    check_options(runs, frame.settings.precision)
    if not device.has_fp64:
        raise DeviceError(f"{device.name}: expected a device with float64 for --random-rounding, found one without")
    settings = replace(frame.settings, layers=("Z", "id"))
    totals = _Totals(found)
    with (
        programs.rewriting(_rewrite) as changed,
        Renderer(frame.scene, settings=settings, device=device, lanes=1) as renderer,
    ):
        same = bool(np.array_equal(renderer.render().rgba, frame.rgba, equal_nan=True))
        try:
            for run in range(1, runs + 1):
                _seed(changed, (run,))
                again = Comparison(renderer.render(), found.oracle, found.rows, found.columns)
                totals.add(again)
        finally:
            _seed(changed, ())
    return Spread(
        runs, totals.spread(), totals.found, found.expected, totals.counted, same, time.perf_counter() - start
    )


def _seed(changed: Sequence[programs.Program], offset: tuple[int, ...]) -> None:
    for program in changed:
        program.offset = offset


def _rewrite(source: str, options: Sequence[str]) -> str | None:
    """Return the rewritten source of a program that makes colors, None for another one."""
    colors = any(f'#line 1 "{name}"' in source for name in MOVED)
    return random_rounding(source, tuple(options)) if colors else None


class _Totals:
    """Sums over runs. found, counted: as of Spread."""

    def __init__(self, first: Comparison) -> None:
        self._budget = first.oracle.budget
        self._runs = 0
        self._mean = np.zeros_like(self._budget)
        self._squares = np.zeros_like(self._budget)
        self.found = np.zeros(len(first.rows))
        self.counted: Bools = first.oracle.alpha > 0.0

    def add(self, run: Comparison) -> None:
        """Add a run's colors by Welford's recurrence, and its errors."""
        colors = np.nan_to_num(run.frame.rgb[run.rows, run.columns].astype(np.float64))
        self._runs += 1
        away = colors - self._mean
        self._mean += away / self._runs
        self._squares += away * (colors - self._mean)
        self.found = np.maximum(self.found, run.found)
        self.counted = self.counted & ~run.ties

    def spread(self) -> Floats:
        """Return the standard deviation of the channel where it is largest, relative to B, (K,)."""
        deviation = np.sqrt(self._squares / (self._runs - 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            result: Floats = np.where(deviation > 0.0, deviation / self._budget, 0.0).max(axis=-1)
        return result
