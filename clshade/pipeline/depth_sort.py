"""The depth sort on the host."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from ..base.arrays import Array, UInt32s

_LEAST_INDEX_BITS = 24


def index_bits(count: int) -> int:
    """Return how many low bits of sort keys hold the index of a triangle, of so many."""
    return max((count - 1).bit_length(), _LEAST_INDEX_BITS)


def front_to_back(
    keys: Array, exact: Callable[[Array], tuple[Array, Array]] | None = None, bits: int = _LEAST_INDEX_BITS
) -> UInt32s:
    """Return the indices of triangles, nearest first; of equal depths the later face first.

    keys: (T,) uint64 of setup.cl, sorted in place: the depth's top bits over the complement of the index.
    exact: returns the float64 depths and the faces of the triangles given by index; used where the top bits are equal.
        None: triangles with equal top bits may come in any order.
    bits: of the index, at most 32.
    Returns (T,) uint32.
    """
    keys.sort()
    low_words = keys.view(np.uint32)[0 if sys.byteorder == "little" else 1 :: 2]
    order: UInt32s = ~low_words & np.uint32((1 << bits) - 1)
    if exact is None or len(keys) < 2:
        return order
    depth_bits = keys >> np.uint64(bits)
    same = depth_bits[1:] == depth_bits[:-1]
    if same.any():
        tied = np.zeros(len(keys), bool)
        tied[1:] |= same
        tied[:-1] |= same
        rows = np.flatnonzero(tied)
        depth, face = exact(order[rows])
        order[rows] = order[rows][np.lexsort((-face, depth, depth_bits[rows]))]
    return order
