"""The sample positions of a pixel."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ..base.arrays import Integers
from .struct_layout import SAMPLE_BITS

GOLDEN = (5.0**0.5 - 1.0) / 2.0
_GRID = 1 << SAMPLE_BITS


@cache
def positions(samples: int) -> Integers:
    """Return (S, 2) int: x and y of a pixel's samples from its lower left corner, 1/256 px, nearest to the center first.

    Sample i of S lies at x = (i + 1/2)/S. 4, 9 and 16 samples, n x n, are a rotated grid: y = (j + 1 - x)/n, j = i modulo n.
    Others are the Kronecker sequence of the golden ratio phi, whose discrepancy is low for every S: y = the fractional part
    of 1/2 + (i - (S - 1)/2)/phi. Both are symmetric about the center, and rounded to the grid. Of samples equally near to
    the center the one with the smaller i is first.
    """
    i, rows = np.arange(samples), math.isqrt(samples)
    x = (i + 0.5) / samples
    y = (i % rows + 1.0 - x) / rows if samples in (4, 9, 16) else (0.5 + (i - (samples - 1) / 2.0) * GOLDEN) % 1.0
    placed = np.minimum(np.rint(np.stack([x, y], axis=1) * _GRID).astype(np.int64), _GRID - 1)
    offset = placed - _GRID // 2
    ordered: Integers = placed[np.argsort((offset * offset).sum(axis=1), kind="stable")]
    ordered.flags.writeable = False
    return ordered
