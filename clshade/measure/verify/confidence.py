"""A random sample, and what it says about all: exact binomial bounds."""

from __future__ import annotations

import math

import numpy as np

from ...base.arrays import Array, Floats

CONFIDENCE = 0.99


def sampled(of: int, count: int, seed: int) -> Array:
    """Return the ascending indices, in reading order, of `count` random pixels, of all if there are no more."""
    return np.sort(np.random.default_rng(seed).choice(of, min(count, of), replace=False))


def upper_bound(wrong: int, looked_at: int, of: int) -> float:
    """Return the share of `of` things that is wrong at most, with CONFIDENCE, if `wrong` of `looked_at` random ones are.

    The one-sided bound of C. Clopper and E. Pearson, The use of confidence or fiducial limits illustrated in the case of
    the binomial (Biometrika 26(4), 1934): the share of which no more than `wrong` are met with probability
    1 - CONFIDENCE. Drawn without replacement, as here, such a sample is met even less often. The share itself if all were
    looked at; 1 if none was.
    """
    if looked_at == of:
        return wrong / of
    if wrong == looked_at:
        return 1.0
    k = np.arange(1.0, wrong + 1.0)
    ways = np.append(0.0, np.cumsum(np.log((looked_at + 1.0 - k) / k)))
    low, high = wrong / looked_at, 1.0
    for _ in range(128):  # halvings, until both are neighbors among floats
        middle = (low + high) / 2.0
        low, high = (middle, high) if _at_most(ways, looked_at, middle) > 1.0 - CONFIDENCE else (low, middle)
    return high


def _at_most(ways: Floats, looked_at: int, share: float) -> float:
    """Return the probability that fewer than K are wrong, each with the probability `share`. ways: (K,), logarithms of the
    binomial coefficients."""
    k = np.arange(len(ways))
    return float(np.exp(ways + k * math.log(share) + (looked_at - k) * math.log1p(-share)).sum())


def rounded_up(share: float) -> str:
    """Return a share in percent with two digits, rounded up, such as `0.1 %`."""
    if share <= 0.0:
        return "0 %"
    step = 10.0 ** (math.floor(math.log10(100.0 * share)) - 1)
    return f"{math.ceil(100.0 * share / step - 1e-9) * step:.3g} %"
