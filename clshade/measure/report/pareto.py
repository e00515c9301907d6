"""Which variants are worth their time, and which one to use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from ...errors import InputError


class Alternative(Protocol):
    """What has a name, a time in milliseconds and an error."""

    @property
    def name(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def error(self) -> float: ...


A = TypeVar("A", bound=Alternative)


def front(alternatives: Sequence[A]) -> list[A]:
    """The Pareto front, fastest first: those than which nothing is both as fast and as right. Of equals the first."""
    found: list[A] = []
    for each in sorted(alternatives, key=lambda each: (each.cost, each.error)):
        if not found or each.error < found[-1].error:
            found.append(each)
    return found


def within_budget(alternatives: Sequence[A], budget: float) -> A:
    """The most exact within `budget` milliseconds. Raises InputError, naming the fastest, where nothing is."""
    affordable = [each for each in front(alternatives) if each.cost <= budget]
    if not affordable:
        fastest = min(alternatives, key=lambda each: each.cost)
        expected = f"a time that some variant keeps: the fastest, {fastest.name}, takes {fastest.cost:.3g} ms"
        raise InputError(f"--budget: expected {expected}, found {budget:g} ms")
    return affordable[-1]


def within_tolerance(alternatives: Sequence[A], tolerance: float, known: float = 0.0) -> A:
    """The fastest whose error is at most `tolerance`. Raises InputError, naming the most exact, where none is, and where
    the errors are not known so well: only to within `known`."""
    best = min(alternatives, key=lambda each: each.error)
    if tolerance < known:
        expected = f"at least {known:.3g}, which is what the reference is good to (the best, {best.name}, has"
        raise InputError(f"--tolerance: expected {expected} {best.error:.3g}), found {tolerance:g}")
    exact = [each for each in front(alternatives) if each.error <= tolerance]
    if not exact:
        expected = f"an error that some variant reaches: the best, {best.name}, has {best.error:.3g}"
        raise InputError(f"--tolerance: expected {expected}, found {tolerance:g}")
    return exact[0]


def chosen(alternatives: Sequence[A], budget: float | None, tolerance: float | None, known: float) -> A | None:
    """By whichever of the two is given; None where neither is. known: how well the errors are. Raises InputError as
    `within_...` do."""
    if budget is not None:
        return within_budget(alternatives, budget)
    return None if tolerance is None else within_tolerance(alternatives, tolerance, known)
