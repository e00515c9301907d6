"""Definitions of operations on real numbers, in exact integers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ...base.arrays import Array


def nearest(numerator: int, places: int, kind: Any) -> float:
    """Return the number of a type that is nearest to numerator / 2^places; of two, the one whose last digit is even."""
    info, size = np.finfo(kind), abs(numerator)
    last = max(size.bit_length() - places - info.nmant - 1, info.minexp - info.nmant)  # the power of the last digit
    shift = max(last + places, 0)
    kept = (size << shift - last - places) >> shift
    rest = 2 * (size - (kept << shift)) if shift else 0
    kept += rest > 1 << shift or (rest == 1 << shift and kept % 2)
    magnitude = math.inf if kept.bit_length() + last > info.maxexp else math.ldexp(kept, last)
    return -magnitude if numerator < 0 else magnitude


def rounded(v: float, kind: Any) -> float:
    """Return the number of a type that is nearest to v."""
    if not (math.isfinite(v) and v):
        return v
    numerator, denominator = v.as_integer_ratio()
    return nearest(numerator, denominator.bit_length() - 1, kind)


def fused(a: float, b: float, c: float, kind: Any) -> float:
    """Return a * b + c, rounded once."""
    if not (math.isfinite(a) and math.isfinite(b)):
        return a * b + c
    if not math.isfinite(c):
        return c
    (p, d), (q, e), (r, f) = (v.as_integer_ratio() for v in (a, b, c))  # the denominators are powers of two
    total = p * q * f + r * d * e
    if total:
        return nearest(total, (d * e * f).bit_length() - 1, kind)
    return 0.0 if p * q else a * b + c  # of zeros: IEEE 754's sign of their sum


def each(definition: Callable[..., float], kind: Any, *operands: Array) -> Array:
    """Return a definition's results, (K,), for operands (K,) each."""
    rows = zip(*(v.tolist() for v in operands), strict=True)
    return np.array([definition(*row, kind) for row in rows]).astype(kind)
