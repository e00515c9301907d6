"""Power laws fitted in logarithms, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

# Student's t for 95 % by the number of points less two, up to ten; the normal distribution's beyond.
STUDENT = (12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228)
NORMAL = 1.96
UNRESOLVED = 4.0  # width of an interval


class Power(NamedTuple):
    """An exponent with its 95 % interval."""

    exponent: float
    low: float
    high: float

    def __str__(self) -> str:
        exponent, low, high = (f"{round(value, 2) + 0.0:.2f}" for value in self)
        return f"{exponent} ({low} to {high})"

    @property
    def resolved(self) -> bool:
        """Whether the interval is narrow enough to say something."""
        return self.high - self.low < UNRESOLVED

    def contains(self, exponent: float) -> bool:
        return self.low <= exponent <= self.high


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the exponent of y as a power of x, by least squares of the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def fitted(x: Sequence[float], y: Sequence[float]) -> Power:
    """Return the exponent with the interval that the scatter about the line gives, for three points or more."""
    u, v = np.log(x), np.log(y)
    slope, offset = np.polyfit(u, v, 1)
    free = len(u) - 2
    if free < 1:
        raise ValueError(f"fitted: expected three points or more, found {len(u)}")
    variance = np.square(v - (slope * u + offset)).sum() / free / np.square(u - u.mean()).sum()
    half = (STUDENT[free - 1] if free <= len(STUDENT) else NORMAL) * float(np.sqrt(variance))
    return Power(float(slope), float(slope) - half, float(slope) + half)


class Law(NamedTuple):
    """An exponent that theory gives, of what, and why a fit may lie above or below it; "" if nothing suggests it."""

    exponent: float
    of: str
    above: str = ""
    below: str = ""


def expected(found: Power, law: Law) -> str:
    """Return the exponent expected; if the one found differs, that it does, and why that may be."""
    said = f"expected {law.exponent:g}, that of {law.of}"
    if found.contains(law.exponent):
        return said
    above = found.exponent > law.exponent
    if law.exponent == 0.0:
        how = "grows" if above else "falls"
    elif law.exponent < 0.0:
        how = "falls slower" if above else "falls faster"
    else:
        how = "grows faster" if above else "grows slower"
    why = law.above if above else law.below
    return f"{said}; it {how}{f': {why}' if why else ''}"
