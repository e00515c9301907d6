"""The Pareto front of variants by time and error, and the choice of one for a budget or a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from ...errors import InputError
from ..timing import Spread

NEARLY = 1.1  # ratio of times that another measurement might find equal


class Alternative(Protocol):
    """A name, the median of some times in milliseconds and their quartiles, and an error."""

    @property
    def name(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def frame_ms(self) -> Spread: ...
    @property
    def error(self) -> float: ...


A = TypeVar("A", bound=Alternative)


def front(alternatives: Sequence[A], uncertainty: float = 0.0) -> list[A]:
    """Return the Pareto front, fastest first: the alternatives that are more accurate than all faster ones. uncertainty:
    of the errors; smaller differences do not count."""
    best: list[A] = []
    for alternative in sorted(alternatives, key=lambda alternative: (alternative.cost, alternative.error)):
        if not best or alternative.error < best[-1].error - uncertainty:
            best.append(alternative)
    return best


def most_accurate(alternatives: Sequence[A], uncertainty: float) -> A:
    """Return the first of those whose errors are the least, as far as they are known: the choice then does not change with
    the times."""
    smallest = min(alternative.error for alternative in alternatives)
    return next(alternative for alternative in alternatives if alternative.error <= smallest + uncertainty)


def most_accurate_of_fastest(alternatives: Sequence[A], uncertainty: float) -> A:
    """Return the most accurate of those that are nearly as fast as the fastest in a quarter of their frames."""
    fastest = min(alternative.frame_ms.low for alternative in alternatives)
    return most_accurate(
        [alternative for alternative in alternatives if alternative.frame_ms.low <= NEARLY * fastest], uncertainty
    )


def within_budget(alternatives: Sequence[A], budget: float, uncertainty: float = 0.0) -> A:
    """Return the most accurate within `budget` milliseconds. One that nearly keeps it in a quarter of its frames counts as
    within; other load on the machine changes their time least. uncertainty: of the errors.

    Raises InputError, naming the fastest, if there is none.
    """
    affordable = [alternative for alternative in alternatives if alternative.frame_ms.low <= NEARLY * budget]
    if not affordable:
        fastest = min(alternatives, key=lambda each: each.cost)
        raise InputError(
            f"--budget: {budget:g} ms is too short: the fastest variant, {fastest.name}, takes {fastest.cost:.3g} ms"
        )
    return most_accurate(affordable, uncertainty)


def within_tolerance(alternatives: Sequence[A], tolerance: float, uncertainty: float = 0.0) -> A:
    """Return the fastest whose error is at most `tolerance`, or above it by at most `uncertainty`; of several that are
    nearly as fast in a quarter of their frames, the most accurate.

    Raises InputError, naming the most accurate, if there is none, and if `tolerance` is below `uncertainty`.
    """
    best = min(alternatives, key=lambda alternative: alternative.error)
    if tolerance < uncertainty:
        raise InputError(
            f"--tolerance: {tolerance:g} is below what errors are known to, {uncertainty:.3g} (the best variant, "
            f"{best.name}, has {best.error:.3g})"
        )
    exact = [alternative for alternative in alternatives if alternative.error <= tolerance + uncertainty]
    if not exact:
        raise InputError(
            f"--tolerance: no variant has {tolerance:g} or less: the best, {best.name}, has {best.error:.3g}"
        )
    return most_accurate_of_fastest(exact, uncertainty)
