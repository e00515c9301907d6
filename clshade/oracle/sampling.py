"""Several samples per pixel: their positions, and how their colors become the pixel's."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from .transform import SAMPLE_STEPS

GOLDEN_RATIO = (1.0 + np.sqrt(5.0)) / 2.0


def places(samples: int) -> Integers:
    """Return (S, 2) int64: positions within a pixel, 1/256 px from its lower left corner, nearest to its center first.

    x = (i + 1/2)/S for i = 0, ..., S - 1; y = (i modulo n + 1 - x)/n for S = n n = 4, 9, 16, else the fraction of
    1/2 + (i - (S - 1)/2)/phi; rounded to the grid.
    """
    found, rows = [], {4: 2, 9: 3, 16: 4}.get(samples)
    for i in range(samples):
        x, y = (i + 0.5) / samples, (0.5 + (i - (samples - 1) / 2.0) / GOLDEN_RATIO) % 1.0
        if rows is not None:
            y = (i % rows + 1.0 - x) / rows
        found.append([min(int(np.rint(t * SAMPLE_STEPS)), SAMPLE_STEPS - 1) for t in (x, y)])
    center = SAMPLE_STEPS // 2
    found.sort(key=lambda place: (place[0] - center) ** 2 + (place[1] - center) ** 2)  # keeps the order of equal ones
    return np.array(found)


def first_of(owner: Integers) -> Integers:
    """Return for each sample the first one with its owner, (S, K). owner: (S, K) the owners of K pixels' samples, nearest to
    the center first."""
    return np.array([np.argmax(owner[: s + 1] == owner[s], axis=0) for s in range(len(owner))])


def mean_place(lit: Bools) -> Integers:
    """Return the mean of the places of samples, (K, 2) int64, rounded to whole 1/256 px, halves up. lit: (S, K), which
    samples of K pixels, at least one each."""
    count, total = lit.sum(axis=0)[:, None], lit.T @ places(len(lit))
    mean: Integers = (2 * total + count) // (2 * count)
    return mean


def weight(rgb: Floats, resolve: str) -> Floats:
    """Return the weights of colors (K, 3) in the mean, (K,): 1, or with `weighted` 1/(1 + luminance), luminance clamped
    to 2^96."""
    if resolve == "mean":
        return np.ones(len(rgb))
    return 1.0 / (1.0 + np.clip(rgb @ [0.2126, 0.7152, 0.0722], 0.0, 2.0**96))
