"""lanes.clh and rows.clh: operations across lanes, in AVX-512's instructions and in plain OpenCL C, against NumPy."""

import numpy as np
import pytest
from kernel_stages import LANES, Probe, bits

pytestmark = [pytest.mark.optimized, pytest.mark.long]

TEXT = """
#include "rows.clh"

kernel void across(global const int *values, global const int *masks, global int *out)
{
    int i = get_global_id(0) * LANES;
    ints v = TO_INTS(LOAD_LANES(values + i)), mask = TO_INTS(LOAD_LANES(masks + i)) != 0;
    int any = any_lane(mask), count = lanes_count(mask), one = any ? lane_of(v, mask) : 0;
#if LANES == 16
    uint set = mask_bits(mask);
#else
    uint set = 0;  // there is none
#endif
    for (int lane = 0; lane < LANES; ++lane)
        vstore4((int4)(any != 0, count, one, (int)set), i + lane, out);
}

kernel void picked(global const float *row, global const int *columns, global float *out)
{
    int i = get_global_id(0) * LANES;
    real values[LANES];
    int numbers[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        values[lane] = row[i + lane];
        numbers[lane] = as_int(row[i + lane]);
    }
    fixeds column = LOAD_LANES(columns + i) & (LANES - 1);
    real each[LANES];
    int whole[LANES];
    STORE_LANES(pick_reals(values, column), each);
    STORE_LANES(pick_ints(numbers, column), whole);
    for (int lane = 0; lane < LANES; ++lane) {
        out[2 * (i + lane)] = each[lane];
        out[2 * (i + lane) + 1] = as_float(whole[lane]);
    }
}
"""
RNG = np.random.default_rng(8)
COUNT = 64 * 16


@pytest.fixture(params=[(lanes, portable) for lanes in LANES[::-1] for portable in (False, True)], ids=str)
def ways(device, request):
    lanes, portable = request.param
    return lanes, Probe(device, ("#define PORTABLE_LANES\n" if portable else "") + TEXT, lanes=lanes)


def test_masks(ways):
    """Whether any lane of a mask is set, how many are, and a value in one of them."""
    lanes, probe = ways
    values = RNG.integers(-(2**31), 2**31, COUNT, dtype=np.int64).astype(np.int32)
    masks = (RNG.random(COUNT) < np.repeat(RNG.choice([0.0, 0.1, 0.6, 1.0], COUNT // 16), 16)).astype(np.int32)
    any_lane, count, one, set_bits = probe("across", values, masks, width=4, dtype=np.int32).T
    blocks = masks.reshape(-1, lanes)
    assert {0, lanes} <= set(blocks.sum(axis=1))
    assert np.array_equal(any_lane.reshape(-1, lanes)[:, 0], blocks.any(axis=1))
    assert np.array_equal(count.reshape(-1, lanes)[:, 0], blocks.sum(axis=1))
    expected = (blocks != 0) @ (1 << np.arange(lanes)) if lanes == 16 else np.zeros(len(blocks))
    assert np.array_equal(set_bits.reshape(-1, lanes)[:, 0], expected)
    for row, mask, picked in zip(values.reshape(-1, lanes), blocks, one.reshape(-1, lanes)[:, 0], strict=True):
        assert picked in row[mask != 0] if mask.any() else picked == 0


def test_columns_of_a_row(ways):
    """Any bits, those of NaNs and of negative numbers too."""
    lanes, probe = ways
    row = RNG.integers(0, 2**32, COUNT, dtype=np.uint64).astype(np.uint32).view(np.float32)
    columns = RNG.integers(0, 1000, COUNT, dtype=np.int64).astype(np.int32)
    expected = np.take_along_axis(bits(row).reshape(-1, lanes), columns.reshape(-1, lanes) % lanes, axis=1).reshape(-1)
    picked = bits(probe("picked", row, columns, width=2)).T
    assert np.array_equal(picked[0], expected)
    assert np.array_equal(picked[1], expected)
