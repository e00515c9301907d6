"""Frame times, measured in turns so that other load on the machine slows all alternatives down alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")
FEWEST = 5  # rounds, however long they take


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
