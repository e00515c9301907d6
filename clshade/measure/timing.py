"""Frame times, measured in turns so that other load on the machine slows all alternatives down alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from ..base.arrays import Floats

T = TypeVar("T")
FEWEST = 5  # rounds, however long they take
RESAMPLES = 2000  # of the bootstrap
COVERAGE = (2.5, 97.5)  # percentiles of the interval


class Spread(NamedTuple):
    """Median and quartiles of some times."""

    low: float
    median: float
    high: float


def spread(values: Sequence[float]) -> Spread:
    return Spread(*(float(value) for value in np.percentile(values, (25, 50, 75))))


def in_turns(draws: Sequence[Callable[[int], T]], rounds: int, seconds: float) -> list[tuple[T, ...]]:
    """Call every draw in each round with the round's number, and return the results by round.

    rounds: number of rounds; fewer if they take more than `seconds` in total, but at least min(FEWEST, rounds).
    """
    start = time.perf_counter()
    found: list[tuple[T, ...]] = []
    while len(found) < rounds and (len(found) < FEWEST or time.perf_counter() - start < seconds):
        found.append(tuple(draw(len(found)) for draw in draws))
    return found


def mean_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the 95 % interval of the mean, by bootstrap as in `ratio_interval`."""
    return _interval(np.mean(_resampled(values), axis=1))


def _resampled(values: Sequence[float]) -> Floats:
    """Return RESAMPLES rows of as many values, drawn with replacement; at the same places for values of one number."""
    samples = np.array(values, np.float64)
    resamples: Floats = samples[np.random.default_rng(0).integers(0, len(samples), (RESAMPLES, len(samples)))]
    return resamples


def _interval(statistics: Floats) -> tuple[float, float]:
    low, high = np.percentile(statistics, COVERAGE)
    return float(low), float(high)


def ratio_interval(numerator: Sequence[float], denominator: Sequence[float]) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of two medians of as many rounds, by bootstrap: rounds are drawn again with
    replacement (Efron and Tibshirani, An Introduction to the Bootstrap, 1993)."""
    above, below = (np.median(_resampled(values), axis=1) for values in (numerator, denominator))
    return _interval(above / below)
