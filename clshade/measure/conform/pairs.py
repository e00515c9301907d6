"""Random numbers that are the same on every machine, and choices that cover all pairs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ...base.arrays import Array

TRIED = 40  # rows of which the one that covers most is taken
Choice = dict[str, Any]


class Draws:
    """Random numbers from PCG64's raw words, which no release of NumPy may change, by exact arithmetic alone."""

    def __init__(self, seed: int) -> None:
        self._words = np.random.PCG64(seed)

    def below(self, end: int, *shape: int) -> Array:
        """Return int64 from 0 to end - 1."""
        words = np.asarray(self._words.random_raw(int(np.prod(shape, dtype=int))), np.uint64)
        found: Array = ((words >> np.uint64(32)) * np.uint64(end) >> np.uint64(32)).astype(np.int64).reshape(shape)
        return found

    def one(self, end: int) -> int:
        return int(self.below(end, 1)[0])

    def parts(self, low: float, high: float, *shape: int, of: int = 4096) -> Array:
        """Return float64 from low to high, exact multiples of 1/of."""
        first, last = round(low * of), round(high * of)
        return (self.below(last - first + 1, *shape) + first) / float(of)


def covering(
    factors: Mapping[str, Sequence[Any]], allowed: Callable[[Choice], bool], least: int, seed: int = 1
) -> list[Choice]:
    """Return choices of a level of each factor that cover every two levels that any allowed choice has together; further
    ones up to `least`, which cover as many triples as they can. Each is the best of some random ones."""
    draws, found = Draws(seed), list[Choice]()
    pairs, triples = set[Any](), set[Any]()
    misses = 0
    while misses < 50 or len(found) < least:
        rows = [row for row in (_row(factors, draws) for _ in range(TRIED)) if allowed(row)]
        size = 2 if misses < 50 else 3
        seen = pairs if size == 2 else triples
        best = max(rows, key=lambda row: len(_sets(row, size) - seen))
        if size == 2 and not _sets(best, 2) - pairs:
            misses += 1
            continue
        found.append(best)
        pairs |= _sets(best, 2)
        triples |= _sets(best, 3)
    return found


def _row(factors: Mapping[str, Sequence[Any]], draws: Draws) -> Choice:
    return {name: levels[draws.one(len(levels))] for name, levels in factors.items()}


def _sets(row: Choice, size: int) -> set[Any]:
    return {tuple((name, row[name]) for name in names) for names in combinations(row, size)}
