"""Times of frames, drawn in turns so that what slows the machine down slows all of them down."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")
FEWEST = 5  # rounds, however long they take


class Spread(NamedTuple):
    """Median of some times, and between what the middle half of them lies."""

    low: float
    median: float
    high: float


def spread(values: Sequence[float]) -> Spread:
    return Spread(*(float(value) for value in np.percentile(values, (25, 50, 75))))


def in_turns(draws: Sequence[Callable[[int], T]], rounds: int, seconds: float) -> list[tuple[T, ...]]:
    """What each draw gave in each round. A draw gets the round's number.

    rounds: how many; fewer where they take more than `seconds` altogether, but at least FEWEST of them (or `rounds`,
        if these are fewer).
    """
    start = time.perf_counter()
    found: list[tuple[T, ...]] = []
    while len(found) < rounds and (len(found) < FEWEST or time.perf_counter() - start < seconds):
        found.append(tuple(draw(len(found)) for draw in draws))
    return found
