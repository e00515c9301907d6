"""The functions of one number that kernels are made of, for every float32 of their domains, or a share of them."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_stages import NUMERICS_OF_ONE_BLOCK, bits, float32, mask

from clshade.pipeline.buffers import Buffer
from clshade.pipeline.programs import build

pytestmark = pytest.mark.optimized

CHUNK = 1 << 22  # numbers at a time
STEP = 17  # between the chunks that are tried: with 1 all of them take six minutes
TEXT = (
    NUMERICS_OF_ONE_BLOCK
    + """
#define RECIPROCAL(x) (1.0f / (x))
#define KERNEL(name, call)                                                     \\
    kernel void name(uint first, global float *out)                            \\
    {                                                                          \\
        uint at = get_global_id(0) * LANES;                                    \\
        reals x = AS_REALS((ints)((int)(first + at)) + LANE_INDEX);            \\
        STORE_LANES(call(x), out + at);                                        \\
    }
KERNEL(inverse_root, reciprocal_sqrt)
KERNEL(log2_less, log2_one_minus)
KERNEL(exp2_below, exp2_negative)
KERNEL(root, sqrt)
KERNEL(reciprocal, RECIPROCAL)
"""
)
FUNCTIONS = {  # the domain, both ends included and of one sign, and the exact function
    "inverse_root": (2.0**-100, 2.0**126, lambda x: 1.0 / np.sqrt(x)),
    "log2_less": (2.0**-126, 1.0 - 2.0**-24, lambda t: np.log1p(-t) / np.log(2.0)),
    "exp2_below": (-(2.0**-126), -100.0, np.exp2),
    "root": (2.0**-126, float(np.finfo(np.float32).max), np.sqrt),
    "reciprocal": (2.0**-126, 2.0**126, lambda x: 1.0 / x),
}
# Largest errors: see kernels/numerics.clh and test_kernel_numerics.py.
ULP = {"inverse_root": 2.0, "log2_less": 6.0, "exp2_below": 1.6, "root": 0.5, "reciprocal": 0.5}


@pytest.mark.long
@pytest.mark.parametrize("name", ULP)
def test_every_float32(device, name):
    first, last, exact = FUNCTIONS[name]
    program = build(device, mask(), TEXT)
    out = Buffer.empty(device, (CHUNK,), np.float32)
    low, high = sorted(bits(float32([first, last])).tolist())
    largest = 0.0
    for start in [*range(low, high, STEP * CHUNK), high - CHUNK // 2]:
        program[name](device.queue, (CHUNK // program.lanes,), None, np.uint32(start), out.memory)
        x = np.arange(start, min(start + CHUNK, high + 1), dtype=np.uint32).view(np.float32)
        expected = exact(x.astype(np.float64))
        error = np.abs(out.to_host()[: len(x)] - expected) / np.spacing(np.abs(expected).astype(np.float32))
        largest = np.maximum(largest, error.max())  # NaN stays
    assert 0.25 < largest <= ULP[name]
