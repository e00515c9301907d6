"""The host's depth sort against NumPy's lexsort in full precision."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clshade.pipeline.buffers import index_bits
from clshade.pipeline.draw import front_to_back

# Values that 40 bits of a float64 distinguish, and others: 1, an ulp on both sides, and 2^-28 above.
NEAR_ONE = (1.0, np.nextafter(1.0, 0.0), np.nextafter(1.0, 2.0), 1.0 + 2.0**-40, 1.0 + 2.0**-28)
DEPTHS = (*NEAR_ONE, -1.0, -1.0 - 2.0**-40, 0.0, -0.0, 5e-324, -5e-324, 1e-300, 1e300, 2.0, 1e6, 1e6 + 2.0**-30)


def keys_of(depth: np.ndarray, bits: int = 24, first: int = 0) -> np.ndarray:
    """Compute keys one by one as documented in draw.py: the highest bits of the float in sortable order, index
    complemented."""
    keys = []
    for index, value in enumerate(depth, first):
        (raw,) = np.array([value + 0.0]).view(np.uint64).tolist()
        ordered = raw + (1 << 63) if raw < 1 << 63 else (1 << 64) - 1 - raw
        low = 1 << bits
        keys.append(ordered // low * low + (low - 1 - index))
    return np.array(keys, np.uint64).reshape(-1)


def sort(depth: np.ndarray, face: np.ndarray, seed: int = 0) -> np.ndarray:
    """Return the order of shuffled keys: `setup` appends them in any order."""
    keys = np.random.default_rng(seed).permutation(keys_of(depth))
    return front_to_back(keys, lambda index: (depth[index], face[index]))


@settings(max_examples=200)
@given(st.lists(st.sampled_from(DEPTHS), max_size=40), st.integers(0, 99))
def test_nearest_first_then_the_later_face(values, seed):
    depth = np.array(values, np.float64)
    face = np.arange(len(depth))
    assert sort(depth, face, seed).tolist() == np.lexsort((-face, depth)).tolist()


@settings(max_examples=100)
@given(st.lists(st.tuples(st.sampled_from(NEAR_ONE), st.integers(0, 5)), max_size=30))
def test_pieces_are_ordered_by_their_face(rows):
    """A clipped face's pieces have their own indices; for equal depths the face decides, not the index."""
    depth = np.array([row[0] for row in rows])
    face = np.array([row[1] for row in rows], np.int64)
    order = sort(depth, face)
    expected = np.lexsort((-face, depth))
    assert depth[order].tolist() == depth[expected].tolist()
    assert face[order].tolist() == face[expected].tolist()


def test_many_depths_within_a_run_and_apart():
    rng = np.random.default_rng(1)
    depth = np.concatenate([rng.uniform(1, 2, 3000), 1.5 + rng.integers(0, 99, 3000) * 2.0**-52, np.full(500, 1.25)])
    depth = rng.permutation(depth)
    face = np.arange(len(depth))
    assert np.array_equal(sort(depth, face), np.lexsort((-face, depth)))


def test_exact_depths_are_asked_for_only_where_keys_are_equal():
    depth = np.array([3.0, 1.0, np.nextafter(1.0, 0.0), 2.0, 1.0 - 2.0**-52])
    requests = []

    def exact(index):
        requests.extend(index.tolist())
        return depth[index], index.astype(np.int64)

    # Just below 1 the exponent differs: 1.0 itself is alone in its run.
    assert front_to_back(keys_of(depth), exact).tolist() == [4, 2, 1, 3, 0]
    assert sorted(requests) == [2, 4]


@pytest.mark.parametrize("exact", [None, "given"])
def test_few(exact):
    for values in ([], [1.0], [-0.0, 0.0]):
        depth = np.array(values)
        order = front_to_back(keys_of(depth), exact and (lambda i: (depth[i], i.astype(np.int64))))  # noqa: B023
        assert order.dtype == np.uint32
        assert order.tolist() == list(range(len(values)))[::-1]


def test_without_exact_depths_runs_are_in_order_of_40_bits():
    rng = np.random.default_rng(2)
    depth = rng.uniform(-4, 4, 2000)
    keys = keys_of(depth)
    order = front_to_back(keys.copy())
    assert sorted(order.tolist()) == list(range(2000))
    assert (np.diff((keys[order] >> np.uint64(24)).astype(np.int64)) >= 0).all()


def test_bits_of_the_index():
    """24, as many as ever were, and one more from 2^24 triangles on."""
    assert [index_bits(n) for n in (0, 1, 2**24, 2**24 + 1, 2**25, 2**25 + 1, 2**29)] == [24, 24, 24, 25, 25, 26, 29]


@settings(max_examples=100)
@given(
    st.lists(st.sampled_from(DEPTHS), min_size=1, max_size=40),
    st.sampled_from([2**24 - 20, 2**24, 2**25 - 1, 2**28, 2**29 - 40]),
    st.integers(0, 99),
)
def test_indices_beyond_24_bits(values, first, seed):
    """Fewer bits are left for depths, so that more of them are compared exactly."""
    depth, bits = np.array(values, np.float64), index_bits(first + len(values))
    keys = np.random.default_rng(seed).permutation(keys_of(depth, bits, first))
    order = front_to_back(keys, lambda index: (depth[index - first], index.astype(np.int64)), bits)
    assert order.dtype == np.uint32
    assert (order - first).tolist() == np.lexsort((-np.arange(len(depth)), depth)).tolist()


def test_without_negative_zero_the_later_face_wins_and_with_it_too():
    for values in ([0.0, -0.0, 0.0], [-0.0, 0.0, -0.0]):
        assert sort(np.array(values), np.arange(3)).tolist() == [2, 1, 0]
