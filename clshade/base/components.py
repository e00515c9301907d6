"""Connected components of a graph given by its links; vectorized."""

from __future__ import annotations

import numpy as np

from .arrays import Array


def connected_components(count: int, first: Array, second: Array) -> Array:
    """Return (count,) int32: for each node the lowest one connected with it by the links first[i], second[i]."""
    labels = np.arange(count, dtype=np.int32)
    while len(first):
        one, two = labels[first], labels[second]
        apart = one != two
        if not apart.any():
            break
        first, second, one, two = first[apart], second[apart], one[apart], two[apart]
        np.minimum.at(labels, np.maximum(one, two), np.minimum(one, two))
        while True:
            further = labels[labels]
            if np.array_equal(further, labels):
                break
            labels = further
    return labels
