"""operations.clh: each operation against its definition, in exact integers or in NumPy: the compiler's own, and the
runtime's function that it stands for. The definitions are those of `conform`."""

from __future__ import annotations

import platform
import sys
from itertools import product
from pathlib import Path

import mpmath
import numpy as np
import pyopencl as cl
import pytest
from devices import needs_float64
from kernel_stages import LANES
from processes import python

from clshade.measure.conform import operations
from clshade.measure.conform.case import Bench, same
from clshade.measure.conform.operands import HARD, factors, integers, patterns
from clshade.measure.conform.operations import Way, each, fused, nearest
from clshade.pipeline.opencl.environment import FORCED

pytestmark = pytest.mark.optimized

POCL = "Portable Computing Language"
WAYS = [Way(*way) for way in product((np.float32, np.float64), (False, True), LANES[::-1])]


def test_definitions():
    """The processor rounds conversions from integers, and square roots."""
    for kind in (np.float32, np.float64):
        v = integers(np.int64)
        assert same(each(nearest, kind, v, np.zeros_like(v)), v.astype(kind)).all()
        v = patterns(kind)[:20_000]
        v = v[np.isfinite(v) & (v > 0)]
        with mpmath.workprec(np.finfo(kind).nmant + 1):
            assert np.array_equal(np.sqrt(v), [float(mpmath.sqrt(x)) for x in v.tolist()])
    assert fused(1 + 2**-12, 1 + 2**-12, -(1 + 2**-11), np.float32) == 2**-24


def test_operands():
    """Those of fma tell it from two roundings, and from the rounding of a sum in float64."""
    for kind in (np.float32, np.float64):
        a, b, c = factors(kind)
        expected = each(fused, kind, a, b, c)
        with np.errstate(all="ignore"):
            assert np.count_nonzero(~same(a * b + c, expected)) > HARD
            wide = (a.astype(np.float64) * b + c).astype(kind)
            assert np.count_nonzero(~same(wide, expected)) > HARD / 8


@pytest.mark.sampled
@pytest.mark.parametrize("way", WAYS, ids=str)
def test_operations(device, way):
    """All operations of a way, in one program."""
    if way.real is np.float64:
        needs_float64(device)
    bench, cases = Bench(device), operations.cases(way)
    assert {"min_int", "popcount_ulong", "to_real_long", "count"} <= {case.name for case in cases}
    for case in cases:
        wrong = bench.wrong(case)
        assert wrong is None, f"{case.name}: {wrong}"


@pytest.mark.long
@pytest.mark.parametrize("target", ["nehalem", "haswell"])
def test_another_processor(device, tmp_path, target):
    """Without an instruction for fma, and with one but without AVX-512. The runtime's functions are not made for these."""
    bundled = list(Path(cl.__file__).parent.glob(".libs/libpocl*"))
    if not (bundled and device.platform == POCL and sys.platform == "linux" and platform.machine() == "x86_64"):
        pytest.skip("not PyPI's PoCL on x86-64 Linux")
    if target == "haswell" and " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip(f"this processor does not run code for {target}")
    arguments = [__file__, "-q", "-m", "", "-k", "own", "-p", "no:cacheprovider"]
    code = f"import sys, pytest; sys.exit(pytest.main({arguments}))"
    done = python(code, tmp_path, timeout=600.0, CLSHADE_TEST_PLATFORM=POCL, **{FORCED: target})
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout
