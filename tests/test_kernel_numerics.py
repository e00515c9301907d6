"""numerics.clh, function by function, against float64; what operations.clh is compared with."""

import mpmath
import numpy as np
import pytest
from kernel_stages import Probe, bits, float32, split

from clshade.measure.conform.case import same
from clshade.measure.conform.operands import integers, patterns
from clshade.measure.conform.operations import each, fused, nearest

pytestmark = pytest.mark.optimized

HALF_ULP = 2.0**-24  # largest relative rounding error of one operation
LOWEST = 100  # powers below 2^-100 are 0

TEXT = """
#include "numerics.clh"

#define OF_ONE(name)             \\
    reals name(reals x)          \\
    {                            \\
        reals y;                 \\
        name##_each(&y, &x, 1);  \\
        return y;                \\
    }
OF_ONE(reciprocal_sqrt)
OF_ONE(log2_one_minus)
OF_ONE(exp2_negative)

reals power_one_minus(reals t, reals n)
{
    reals power;
    powers_one_minus(&power, &t, &n, 1);
    return power;
}

#define FIRST int i = get_global_id(0) * LANES
#define IN(name) LOAD_LANES(name + i)
#define KERNEL1(name, call) \\
    kernel void name(global const float *x, global float *out) { FIRST; STORE_LANES(call(IN(x)), out + i); }

KERNEL1(inverse_root, reciprocal_sqrt)
KERNEL1(log2_less, log2_one_minus)
KERNEL1(exp2_below, exp2_negative)
KERNEL1(root, sqrt)
#define RECIPROCAL(x) (1.0f / (x))
KERNEL1(reciprocal, RECIPROCAL)

kernel void power(global const float *t, global const float *n, global float *out)
{
    FIRST;
    STORE_LANES(power_one_minus(IN(t), IN(n)), out + i);
}

kernel void unit(global const float *x, global const float *y, global const float *z, global float *out)
{
    FIRST;
    reals3 v = {IN(x), IN(y), IN(z)};
    v = normalize_or_zero(v);
    float lane[3][LANES];
    STORE_LANES(v.x, lane[0]);
    STORE_LANES(v.y, lane[1]);
    STORE_LANES(v.z, lane[2]);
    for (int k = 0; k < LANES; ++k)
        vstore3((float3)(lane[0][k], lane[1][k], lane[2][k]), i + k, out);
}

#define PAIRS(name, call)                                                                                    \\
    kernel void name(global const float *ah, global const float *al, global const float *bh,                 \\
                     global const float *bl, global float *out)                                              \\
    {                                                                                                        \\
        FIRST;                                                                                               \\
        double_single a = {IN(ah), IN(al)}, b = {IN(bh), IN(bl)}, c = call(a, b);                                    \\
        float high[LANES], low[LANES];                                                                       \\
        STORE_LANES(c.high, high);                                                                           \\
        STORE_LANES(c.low, low);                                                                             \\
        for (int k = 0; k < LANES; ++k)                                                                      \\
            vstore2((float2)(high[k], low[k]), i + k, out);                                                  \\
    }

PAIRS(sum, pair_sum)
PAIRS(product, pair_product)
PAIRS(quotient, pair_quotient)
"""


@pytest.fixture(scope="module")
def probe(device):
    return Probe(device, TEXT, POWER=1)


def random(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def relative(actual: np.ndarray, expected: np.ndarray) -> float:
    """Return the largest relative error."""
    return float(np.abs(actual.astype(np.float64) / expected - 1.0).max())


def spacing(value: np.ndarray) -> np.ndarray:
    return np.spacing(np.abs(value).astype(np.float32)).astype(np.float64)


# Functions of one number: the domain, both ends included and of one sign; the exact function; the largest error.
FUNCTIONS = {
    # The third-order step leaves 5/16 e^3 of e = 2 * 1.76e-3: 0.2 of 2^-24. Its correction contains half of the rounding of
    # x*y*y, and the sum is rounded once more, 1/2 ulp of at most 2 * 2^-24: together below 2 * 2^-24, and an ulp is at least
    # 2^-24 of the value. Measured over all mantissas: 1.17 ulp.
    "inverse_root": (2.0**-100, 2.0**126, lambda x: 1.0 / np.sqrt(x), lambda x, y: 2.0 * spacing(y)),
    # Roundings of f*p and of the sum, and the polynomial's 0.44 of 2^-24: below 3 of 2^-24 where the exponent is 0 (t up to
    # 1 - sqrt(1/2)) or 1-t exact (from 1/2 on). Between those, 1-t is rounded by up to 2^-25 of at least 1/2, which moves
    # the logarithm by 2^-24/ln 2 where it is at least 1/2: another 2.9.
    "log2_less": (
        2.0**-126,
        1.0 - HALF_ULP,
        lambda t: np.log1p(-t) / np.log(2.0),
        lambda t, y: np.where((t > 0.2928) & (t < 0.5), 6.0, 3.0) * HALF_ULP * np.abs(y),
    ),
    # The polynomial's 0.03 of 2^-24, one rounding of its value (half an ulp: up to 2^-24) and half of the one before.
    "exp2_below": (-(2.0**-126), -float(LOWEST), np.exp2, lambda x, y: 1.6 * HALF_ULP * y),
    "root": (2.0**-126, float(np.finfo(np.float32).max), np.sqrt, lambda x, y: 0.5 * spacing(y)),
    "reciprocal": (2.0**-126, 2.0**126, lambda x: 1.0 / x, lambda x, y: 0.5 * spacing(y)),
}
STRIDE = 1499  # between the numbers that are tried


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_one_number(probe, name):
    first, last, exact, bound = FUNCTIONS[name]
    low, high = sorted(bits(float32([first, last])).tolist())
    x = np.append(np.arange(low, high, STRIDE, np.uint32), np.uint32(high)).view(np.float32)
    expected = exact(x.astype(np.float64))
    error = np.abs(probe(name, x) - expected)
    assert (error <= bound(x.astype(np.float64), expected)).all()
    assert (error / spacing(expected)).max() > 0.25  # correct rounding everywhere would contradict the comments


def test_exact_values(probe):
    """n = 0 gives 1 everywhere, n = 1 exactly 1 - t, t = 0 exactly 1. Results below the range are 0, never denormal."""
    assert probe("log2_less", float32([0.0])).tolist() == [0.0]
    assert probe("exp2_below", float32([0.0, -0.0, -1.0, -LOWEST])).tolist() == [1.0, 1.0, 0.5, 2.0**-LOWEST]
    assert not bits(probe("exp2_below", float32([-LOWEST - 1e-5, -126, -127.5, -149, -1e9, -3e38, -np.inf]))).any()
    t, n = np.meshgrid(float32([1e-7, 0.01, 0.5, 0.9999, 1 - HALF_ULP]), float32([0, 1, 20, 1e3, 1e9]))
    powers = probe("power", t.reshape(-1), n.reshape(-1))
    assert ((powers == 0.0) | ((powers >= 2.0**-LOWEST) & np.isfinite(powers))).all()
    t = float32(random().uniform(0.0, 1.0, 5000))
    assert (probe("power", t, np.zeros_like(t)) == 1.0).all()
    assert np.array_equal(probe("power", t, np.ones_like(t)), float32(1.0) - t)
    n = float32([0, 0.5, 1, 20, 1e3, 1e9])
    assert (probe("power", np.zeros_like(n), n) == 1.0).all()


# Directions


def test_normalize_or_zero(probe):
    """The squared length: three roundings of sums of positive terms, 3/2 of 2^-24 in the root; reciprocal_sqrt:
    2 ulp, 4 of 2^-24; the product: one; 6.5 of 2^-24 in each component."""
    v = float32(random().normal(size=(20_000, 3)) * np.exp2(random(seed=2).integers(-45, 60, (20_000, 1))))
    normalized = probe("unit", *np.ascontiguousarray(v.T), width=3)
    wide = v.astype(np.float64)
    assert relative(normalized, wide / np.sqrt((wide * wide).sum(axis=1, keepdims=True))) <= 6.5 * HALF_ULP


def test_vectors_too_short_become_zero(probe):
    """Squared lengths below 2^-100 count as zero, also if they underflow; the first above has a direction."""
    v = float32([[0, 0, 0], [-0.0, 0, -0.0], [0, 2.0**-50.1, 0], [2.0**-75, 2.0**-75, 0], [1e-38, 0, 0], [1e-45, 0, 0]])
    assert not probe("unit", *np.ascontiguousarray(v.T), width=3).any()
    assert probe("unit", *np.ascontiguousarray(float32([[0, -(2.0**-50), 0]]).T), width=3).tolist() == [[0, -1, 0]]


@pytest.mark.parametrize("n", [0.0, 1.0, 20.0, 1e3, 1e5, 1e9])
def test_power_inside_the_lobe(probe, n):
    """The power's condition number in t is n*t/(1-t) <= 1.3 inside the lobe (x^n >= 1/e), so the error does not grow
    with n: |y| = n*|log2(1-t)| <= 1.45 has the logarithm's 3 of 2^-24 and one rounding, times ln 2 in the result, plus
    exp2's 1.6: below 6 of 2^-24. 16*sqrt(n) are allowed (clshade/measure/README.md, "Bounds, and where they come from")."""
    lobe = 1.0 if n < 4.0 else -np.expm1(-1.0 / n)
    lobe = 0.2928 if n < 4.0 else lobe  # where the logarithm is accurate
    t = float32(lobe * np.concatenate([random().uniform(0.0, 1.0, 20_000), np.exp2(-random().uniform(0, 60, 5_000))]))
    expected = np.exp(n * np.log1p(-t.astype(np.float64)))
    assert relative(probe("power", t, np.full_like(t, n)), expected) <= min(6.0, 16.0 * np.sqrt(n)) * HALF_ULP


def test_power_beyond_the_lobe_is_small_and_close(probe):
    """There the error of the result is |y| ln 2 times the logarithm's, 6 of 2^-24, plus the rounding of y."""
    t = float32(random().uniform(0.0, 1.0, 50_000))
    for n in (0.5, 20.0, 1e3, 1e9):
        y = n * np.log1p(-t.astype(np.float64))
        expected = np.exp(y)
        powers = probe("power", t, np.full_like(t, n))
        kept = expected > 1.001 * 2.0**-LOWEST
        assert (np.abs(powers[kept] / expected[kept] - 1.0) <= (7.0 * np.abs(y[kept]) + 3.0) * HALF_ULP).all()
        assert (powers[~kept] <= 1.002 * 2.0**-LOWEST).all()


# Double-single


@pytest.fixture(scope="module")
def operands():
    """Return double-single values of both signs over forty orders of magnitude, as four float32 arrays and as float64
    sums."""
    values = random().normal(size=(2, 50_000)) * np.exp2(random(seed=7).integers(-40, 40, (2, 50_000)))
    a, b = split(values[0]), split(values[1])
    return (*a, *b), [high.astype(np.float64) + low for high, low in (a, b)]


@pytest.mark.parametrize(("name", "bound"), [("sum", 3), ("product", 6), ("quotient", 11)])
def test_pairs_keep_48_bits(probe, operands, name, bound):
    """A low part is at most 2^-24 of the high one (1 unit), and rounding an amount of k units errs by k * 2^-48.

    Sum, relative to the magnitudes, as it may cancel: 1 unit of low parts, then 2 with the high parts' error: 3.
    Product: 2 units, then 3, and the product of the low parts, 1: 6. Quotient: the remainder of a, at most 3 units, of
    which the fma rounds 2, the sum 3, the division 3, and 3 for the divisor's low part: 11.
    """
    arrays, (a, b) = operands
    pairs = probe(name, *arrays, width=2).astype(np.float64)
    expected = {"sum": a + b, "product": a * b, "quotient": a / b}[name]
    scale = np.abs(a) + np.abs(b) if name == "sum" else np.abs(expected)
    assert (np.abs(pairs.sum(axis=1) - expected) / scale).max() <= bound * 2.0**-48
    # The low part is the remainder of the high one; a quotient's is up to 3/2 ulp.
    if name == "quotient":
        assert (np.abs(pairs[:, 1]) <= 1.5 * 2.0**-23 * np.abs(pairs[:, 0])).all()
    else:
        assert np.array_equal(pairs[:, 0], float32(pairs.sum(axis=1)))
    assert (np.abs(pairs[:, 0] - expected) / scale).max() > 2.0**-26  # the low part is needed


def test_pair_sum_of_canceling_high_parts(probe):
    """If the high parts cancel, the result is exactly the difference of the low parts."""
    a, b = (float32([1.0, 3.0]), float32([2.0**-30, -(2.0**-27)])), (float32([-1.0, -3.0]), float32([2.0**-31, 0.0]))
    assert probe("sum", *a, *b, width=2).sum(axis=1).tolist() == [2.0**-30 + 2.0**-31, -(2.0**-27)]


def test_definitions_of_operations():
    """Those of `conform`, which checks operations.clh by them: the processor rounds conversions from integers, and square
    roots."""
    for kind in (np.float32, np.float64):
        v = integers(np.int64)
        assert same(each(nearest, kind, v, np.zeros_like(v)), v.astype(kind)).all()
        v = patterns(kind)[:20_000]
        v = v[np.isfinite(v) & (v > 0)]
        with mpmath.workprec(np.finfo(kind).nmant + 1):
            assert np.array_equal(np.sqrt(v), [float(mpmath.sqrt(x)) for x in v.tolist()])
    assert fused(1 + 2**-12, 1 + 2**-12, -(1 + 2**-11), np.float32) == 2**-24
