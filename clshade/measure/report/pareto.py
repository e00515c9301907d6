"""The Pareto front of variants by time and error, and the choice of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from ...errors import InputError


class Alternative(Protocol):
    """Anything with a name, a time in milliseconds and an error."""

    @property
    def name(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def error(self) -> float: ...


A = TypeVar("A", bound=Alternative)


def front(alternatives: Sequence[A]) -> list[A]:
    """Return the Pareto front, fastest first: the alternatives that no other dominates. Of equal ones, keep the
    first."""
    found: list[A] = []
    for each in sorted(alternatives, key=lambda each: (each.cost, each.error)):
        if not found or each.error < found[-1].error:
            found.append(each)
    return found


def within_budget(alternatives: Sequence[A], budget: float) -> A:
    """Return the most accurate within `budget` milliseconds. Raises InputError, naming the fastest, if there is
    none."""
    affordable = [each for each in front(alternatives) if each.cost <= budget]
    if not affordable:
        fastest = min(alternatives, key=lambda each: each.cost)
        expected = f"a time that some variant keeps: the fastest, {fastest.name}, takes {fastest.cost:.3g} ms"
        raise InputError(f"--budget: expected {expected}, found {budget:g} ms")
    return affordable[-1]


def within_tolerance(alternatives: Sequence[A], tolerance: float, known: float = 0.0) -> A:
    """Return the fastest whose error is at most `tolerance`.

    Raises InputError, naming the most accurate, if there is none, and if `tolerance` is below `known`, the uncertainty
    of the errors.
    """
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
    """Choose by the budget or the tolerance, whichever is given; return None if neither is.

    known: uncertainty of the errors. Raises InputError as `within_budget` and `within_tolerance` do.
    """
    if budget is not None:
        return within_budget(alternatives, budget)
    return None if tolerance is None else within_tolerance(alternatives, tolerance, known)
