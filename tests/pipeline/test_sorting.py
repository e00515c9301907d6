"""The host's depth sort against NumPy's lexsort in full precision."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from clshade.pipeline.buffers import index_bits
from clshade.pipeline.draw import front_to_back

# Values that 40 bits of a float64 distinguish, and others: 1, an ulp on both sides, and 2^-28 above.
NEAR_ONE = (1.0, np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0), 1.0 + 2.0**-40, 1.0 + 2.0**-28)
DEPTHS = (*NEAR_ONE, -1.0, -1.0 - 2.0**-40, 0.0, -0.0, 5e-324, -5e-324, 1e-300, 1e300, 2.0, 1e6, 1e6 + 2.0**-30)


def keys_of(depth: np.ndarray, bits: int = 24, first: int = 0) -> np.ndarray:
    """Compute keys one by one as documented in draw.py: the highest bits of the float in sortable order, and the index."""
    keys = []
    for index, value in enumerate(depth, first):
        (raw,) = np.array([value + 0.0]).view(np.uint64).tolist()
        ordered = raw + (1 << 63) if raw < 1 << 63 else (1 << 64) - 1 - raw
        low = 1 << bits
        keys.append(ordered // low * low + (low - 1 - index))
    return np.array(keys, np.uint64).reshape(-1)


@settings(max_examples=200)
@given(
    st.lists(st.sampled_from(DEPTHS), max_size=40),
    st.sampled_from([0, 2**24 - 20, 2**24, 2**25 - 1, 2**28, 2**29 - 40]),
    st.integers(0, 99),
)
def test_nearest_first_then_the_later_face(values, first, seed):
    """`setup` appends keys in any order. Beyond 24 bits of indices fewer are left for depths, of which more are compared."""
    depth, bits = np.array(values, np.float64), index_bits(first + len(values))
    keys = np.random.default_rng(seed).permutation(keys_of(depth, bits, first))
    order = front_to_back(keys, lambda index: (depth[index - first], index.astype(np.int64)), bits)
    assert order.dtype == np.uint32
    assert (order - first).tolist() == np.lexsort((-np.arange(len(depth)), depth)).tolist()


@settings(max_examples=100)
@given(st.lists(st.tuples(st.sampled_from(NEAR_ONE), st.integers(0, 5)), max_size=30))
def test_pieces_are_ordered_by_their_face(rows):
    """A clipped face's pieces have their own indices; for equal depths the face decides, not the index."""
    depth, face = np.array([row[0] for row in rows]), np.array([row[1] for row in rows], np.int64)
    order = front_to_back(keys_of(depth)[::-1].copy(), lambda index: (depth[index], face[index]))
    expected = np.lexsort((-face, depth))
    assert depth[order].tolist() == depth[expected].tolist()
    assert face[order].tolist() == face[expected].tolist()
