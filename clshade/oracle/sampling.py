"""Several samples per pixel: their positions, and how their colors become the pixel's."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats, Integers
from .transform import SUBPIXELS

GOLDEN_RATIO = (1.0 + np.sqrt(5.0)) / 2.0


def places(samples: int) -> Integers:
    """Return (S, 2) int64: positions within a pixel, 1/256 px from its lower left corner, nearest to its center first.

    x = (i + 1/2)/S and y = fraction of 1/2 + (i - (S - 1)/2)/phi for i = 0, ..., S - 1, rounded to the grid.
    """
    found = []
    for i in range(samples):
        x, y = (i + 0.5) / samples, (0.5 + (i - (samples - 1) / 2.0) / GOLDEN_RATIO) % 1.0
        found.append([min(int(np.rint(t * SUBPIXELS)), SUBPIXELS - 1) for t in (x, y)])
    center = SUBPIXELS // 2
    found.sort(key=lambda place: (place[0] - center) ** 2 + (place[1] - center) ** 2)  # keeps the order of equal ones
    return np.array(found)


def lit_at(owner: Integers, every: bool) -> Integers:
    """Return the sample at which each sample's owner is lit, (S, K): the first one it owns, or S, for the center, if it owns
    them all; with `every` the sample itself.

    owner: (S, K) the owners of K pixels' samples, nearest to the center first.
    """
    index = np.arange(len(owner))[:, None] + np.zeros_like(owner)
    if every:
        return index
    first = np.array([np.argmax(owner[: s + 1] == owner[s], axis=0) for s in range(len(owner))])
    return np.where((owner == owner[0]).all(axis=0), len(owner), first)


def weight(rgb: Floats, resolve: str) -> Floats:
    """Return the weights of colors (K, 3) in the mean, (K,): 1, or with `weighted` 1/(1 + luminance), luminance clamped
    to 2^96."""
    if resolve == "mean":
        return np.ones(len(rgb))
    return 1.0 / (1.0 + np.clip(rgb @ [0.2126, 0.7152, 0.0722], 0.0, 2.0**96))
