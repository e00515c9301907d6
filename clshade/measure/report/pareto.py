"""The Pareto front of variants by time and error, as far as measuring can tell them apart, and the choice of one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ...errors import InputError

NEARLY = 1.1  # ratio of times that another measurement might find equal


class Alternative(Protocol):
    """Anything with a name, a time in milliseconds, the quartiles of the times it is the median of, and an error."""

    @property
    def name(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def quartiles(self) -> tuple[float, float]: ...
    @property
    def error(self) -> float: ...


A = TypeVar("A", bound=Alternative)


def tied_in_time(a: Alternative, b: Alternative) -> bool:
    """Return whether one's median lies within the other's interquartile range."""
    return any(one.quartiles[0] <= other.cost <= one.quartiles[1] for one, other in ((a, b), (b, a)))


def tied(a: Alternative, b: Alternative, known: float) -> bool:
    """Return whether measuring cannot tell the two apart. known: uncertainty of the errors, that of the reference."""
    return tied_in_time(a, b) and abs(a.error - b.error) <= known


def dominates(a: Alternative, b: Alternative, known: float) -> bool:
    """Return whether `a` is better than `b` by more than the uncertainty in time or error, and no worse in the other."""
    faster = a.cost < b.cost and not tied_in_time(a, b)
    slower = a.cost > b.cost and not tied_in_time(a, b)
    closer, farther = a.error < b.error - known, a.error > b.error + known
    return (faster and not farther) or (closer and not slower)


def front(alternatives: Sequence[A], known: float = 0.0) -> list[A]:
    """Return the Pareto front, fastest first: the alternatives that no other of the front dominates. known: uncertainty of
    the errors.

    Ties are not transitive: one that is dominated only by others off the front is on it.
    """
    kept: list[A] = []
    left = list(alternatives)
    while left:
        best = [each for each in left if not any(dominates(other, each, known) for other in left)] or left
        kept += best
        left = [each for each in left if each not in best and not any(dominates(one, each, known) for one in best)]
    return sorted(kept, key=lambda each: (each.cost, each.error))


def ties(best: Sequence[A], known: float) -> list[list[A]]:
    """Return the groups of a front's members that cannot be told apart, each with another of its group."""
    groups: list[list[A]] = []
    for each in best:
        near = [group for group in groups if any(tied(each, other, known) for other in group)]
        apart = [group for group in groups if not any(group is one for one in near)]
        groups = [*apart, [*itertools.chain.from_iterable(near), each]]
    return [group for group in groups if len(group) > 1]


@dataclass(frozen=True)
class Choice(Generic[A]):
    """The alternative to use. doubt: why another measurement might choose differently; "" if nothing suggests it."""

    used: A
    doubt: str


def fits(alternative: Alternative, budget: float) -> bool:
    """Return whether `within_budget` counts it as within."""
    return alternative.quartiles[0] <= NEARLY * budget


def most_accurate(alternatives: Sequence[A], known: float) -> A:
    """Return the first of those whose errors are the least, as far as they are known: the choice then does not change with
    the times."""
    least = min(each.error for each in alternatives)
    return next(each for each in alternatives if each.error <= least + known)


def most_accurate_of_fastest(alternatives: Sequence[A], known: float) -> A:
    """Return the most accurate of those that are nearly as fast as the fastest in a quarter of their frames."""
    least = min(each.quartiles[0] for each in alternatives)
    return most_accurate([each for each in alternatives if each.quartiles[0] <= NEARLY * least], known)


def within_budget(alternatives: Sequence[A], budget: float, known: float = 0.0) -> Choice[A]:
    """Choose the most accurate within `budget` milliseconds. One that nearly keeps it in a quarter of its frames counts as
    within; other load on the machine changes their time least. known: uncertainty of the errors.

    Raises InputError, naming the fastest, if there is none.
    """
    affordable = [each for each in alternatives if fits(each, budget)]
    if not affordable:
        fastest = min(alternatives, key=lambda each: each.cost)
        raise InputError(
            f"--budget: {budget:g} ms is too short: the fastest variant, {fastest.name}, takes {fastest.cost:.3g} ms"
        )
    used = most_accurate(affordable, known)
    low, high = used.quartiles
    if high > budget:
        return Choice(used, f"{used.name} takes {low:.3g} to {high:.3g} ms in half of its frames, about the budget")
    missed = [each for each in alternatives if each.error < used.error - known and fits(each, NEARLY * budget)]
    if missed:
        closest = min(missed, key=lambda each: each.error)
        return Choice(
            used, f"{closest.name}, which is more accurate, takes {closest.cost:.3g} ms, just above the budget"
        )
    return Choice(used, "")


def within_tolerance(alternatives: Sequence[A], tolerance: float, known: float = 0.0) -> Choice[A]:
    """Choose the fastest whose error is at most `tolerance`, or above it by at most `known`, the uncertainty of the errors;
    of several that are nearly as fast in a quarter of their frames, the most accurate.

    Raises InputError, naming the most accurate, if there is none, and if `tolerance` is below `known`.
    """
    best = min(alternatives, key=lambda each: each.error)
    if tolerance < known:
        raise InputError(
            f"--tolerance: {tolerance:g} is below what errors are known to, {known:.3g} (the best variant, {best.name}, has "
            f"{best.error:.3g})"
        )
    exact = [each for each in alternatives if each.error <= tolerance + known]
    if not exact:
        raise InputError(
            f"--tolerance: no variant has {tolerance:g} or less: the best, {best.name}, has {best.error:.3g}"
        )
    used = most_accurate_of_fastest(exact, known)
    if abs(used.error - tolerance) <= known:
        return Choice(used, f"the error of {used.name} is known to {known:.2g}, and is that near the tolerance")
    others = [each for each in exact if each.cost < used.cost or (each is not used and tied_in_time(each, used))]
    if others:
        return Choice(used, f"{min(others, key=lambda each: each.cost).name} takes about as long as {used.name}")
    return Choice(used, "")


def chosen(alternatives: Sequence[A], budget: float | None, tolerance: float | None, known: float) -> Choice[A] | None:
    """Choose by the budget or the tolerance, whichever is given; return None if neither is.

    known: uncertainty of the errors. Raises InputError as `within_budget` and `within_tolerance` do.
    """
    if budget is not None:
        return within_budget(alternatives, budget, known)
    return None if tolerance is None else within_tolerance(alternatives, tolerance, known)
