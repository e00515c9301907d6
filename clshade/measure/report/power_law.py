"""Power laws fitted in logarithms, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

# Student's t for 95 % by the number of points less two, up to ten; the normal distribution's beyond.
STUDENT = (12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228)
NORMAL = 1.96


class Power(NamedTuple):
    """An exponent with its 95 % interval."""

    exponent: float
    low: float
    high: float


def fitted(x: Sequence[float], y: Sequence[float]) -> Power:
    """Return y as a power of x: the exponent by least squares of the logarithms, with the interval that the scatter about
    the line gives, for three points or more."""
    u, v = np.log(x), np.log(y)
    slope, offset = np.polyfit(u, v, 1)
    free = len(u) - 2
    variance = np.square(v - (slope * u + offset)).sum() / free / np.square(u - u.mean()).sum()
    half = (STUDENT[free - 1] if free <= len(STUDENT) else NORMAL) * float(np.sqrt(variance))
    return Power(float(slope), float(slope) - half, float(slope) + half)
