"""The depth sort on the host."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from ..base.arrays import Array, UInt32s
from .struct_layout import KEY_INDEX_BITS

_INDEX = np.uint32((1 << KEY_INDEX_BITS) - 1)


def opaque_first(order: Array, transparent: Array) -> Array:
    """Return an order of triangles with the transparent ones, bool, after the others; both keep theirs."""
    return np.concatenate([order[~transparent], order[transparent]])


def front_to_back(keys: Array, exact: Callable[[Array], tuple[Array, Array]] | None = None) -> UInt32s:
    """Return the indices of triangles, nearest first; of equal depths the later face first.

    keys: (T,) uint64 of setup.cl, sorted in place: the depth's top 40 bits over the complement of the index.
    exact: returns the float64 depths and the faces of the triangles given by index; used where the 40 bits are equal.
        None: triangles with equal 40 bits may come in any order.
    Returns (T,) uint32.
    """
    keys.sort()
    low_words = keys.view(np.uint32)[0 if sys.byteorder == "little" else 1 :: 2]
    order: UInt32s = ~low_words & _INDEX
    if exact is None or len(keys) < 2:
        return order
    depth_bits = keys >> np.uint64(KEY_INDEX_BITS)
    same = depth_bits[1:] == depth_bits[:-1]
    if same.any():
        tied = np.zeros(len(keys), bool)
        tied[1:] |= same
        tied[:-1] |= same
        rows = np.flatnonzero(tied)
        depth, face = exact(order[rows])
        order[rows] = order[rows][np.lexsort((-face, depth, depth_bits[rows]))]
    return order
