"""random_rounding.clh, function by function, against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from kernel_stages import Probe, float32

from clshade.pipeline.opencl.device import Device

TEXT = """
#include "random_rounding.clh"

#define KERNEL1(name, type, call)                                                                   \\
    kernel void name(global const type *a, global const uint *run, global float *out)              \\
    {                                                                                               \\
        int i = get_global_id(0);                                                                   \\
        out[i] = call(run[i], 7u, a[i]);                                                            \\
    }
#define KERNEL2(name, call)                                                                         \\
    kernel void name(global const float *a, global const float *b, global const uint *run, global float *out) \\
    {                                                                                               \\
        int i = get_global_id(0);                                                                   \\
        out[i] = call(run[i], 7u, a[i], b[i]);                                                      \\
    }

KERNEL1(root, float, random_root)
KERNEL1(of_int, int, random_real)
KERNEL1(of_long, long, random_real)
KERNEL1(of_double, double, random_real)
KERNEL2(sum, random_sum)
KERNEL2(difference, random_difference)
KERNEL2(product, random_product)
KERNEL2(quotient, random_quotient)

kernel void fused(global const float *a, global const float *b, global const float *c, global const uint *run,
                  global float *out)
{
    int i = get_global_id(0);
    out[i] = random_fma(run[i], 7u, a[i], b[i], c[i]);
}

kernel void scalars(global const float *a, global const float *b, global const uint *run, global float *out)
{
    int i = get_global_id(0);
    out[i] = random_fma(run[i], 7u, a[i], b[i], random_sum(run[i], 8u, a[i], random_quotient(run[i], 9u, a[i], b[i])));
}

kernel void vectors(global const float4 *a, global const float4 *b, global const uint *run, global float4 *out)
{
    int i = get_global_id(0);
    out[i] = random_fma(run[i], 7u, a[i], b[i], random_sum(run[i], 8u, a[i], random_quotient(run[i], 9u, a[i], b[i])));
}
"""

EXACT = {
    "sum": lambda a, b: a + b,
    "difference": lambda a, b: a - b,
    "product": lambda a, b: a * b,
    "quotient": lambda a, b: a / b,
    "fused": lambda a, b, c: a * b + c,
}
COUNT = 500


@pytest.fixture(scope="module")
def probe(device: Device) -> Probe:
    if not device.has_fp64:
        pytest.skip("needs float64")
    return Probe(device, TEXT, lanes=1)


def operands(count: int) -> list[np.ndarray]:
    """Return numbers of which many have few digits, so that some results are exact."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(count):
        mantissas = rng.uniform(1.0, 2.0, COUNT)
        mantissas[: COUNT // 4] = rng.integers(1, 9, COUNT // 4)
        found.append(float32(mantissas * np.exp2(rng.integers(-12, 12, COUNT)) * rng.choice([-1.0, 1.0], COUNT)))
    return found


def runs(first: int = 1, count: int = COUNT) -> np.ndarray:
    return np.arange(first, first + count, dtype=np.uint32)


def is_neighbor(found: np.float32, exact: Fraction) -> bool:
    """Whether a number is the exact one, or else one of the two around it."""
    if Fraction(float(np.float32(float(exact)))) == exact:
        return Fraction(float(found)) == exact
    below, above = np.nextafter(found, np.float32(-np.inf)), np.nextafter(found, np.float32(np.inf))
    return Fraction(float(below)) < exact < Fraction(float(above))


@pytest.mark.parametrize("name", EXACT)
def test_results_are_the_exact_one_or_a_neighbor(probe, name):
    given = operands(3 if name == "fused" else 2)
    exact = [EXACT[name](*(Fraction(float(v)) for v in values)) for values in zip(*given, strict=True)]
    nearest = probe(name, *given, np.zeros(COUNT, np.uint32))
    assert nearest.tolist() == [float(np.float32(e.numerator / e.denominator)) for e in exact]
    found = probe(name, *given, runs())
    assert all(is_neighbor(f, e) for f, e in zip(found, exact, strict=True))
    moved = found != nearest
    kept = np.array([Fraction(float(n)) == e for n, e in zip(nearest, exact, strict=True)])
    assert kept.sum() >= 10  # of results that are exact
    assert not (moved & kept).any()
    assert 0.1 < moved[~kept].mean() < 0.4  # 1/4 if errors are evenly spread


def test_roots_are_neighbors(probe):
    x = np.abs(operands(1)[0])
    nearest, found = probe("root", x, np.zeros(COUNT, np.uint32)), probe("root", x, runs())
    np.testing.assert_array_equal(nearest, np.sqrt(x))
    for root, value in zip(found, x, strict=True):
        below, above = np.nextafter(root, np.float32(0.0)), np.nextafter(root, np.float32(np.inf))
        assert Fraction(float(below)) ** 2 < Fraction(float(value)) < Fraction(float(above)) ** 2
    exact = nearest.astype(np.float64) ** 2 == x
    assert exact.any()
    assert not (found != nearest)[exact].any()
    assert (found != nearest).any()


@pytest.mark.parametrize(("name", "kind"), [("of_int", np.int32), ("of_long", np.int64), ("of_double", np.float64)])
def test_conversions_are_neighbors(probe, name, kind):
    values = (np.random.default_rng(4).uniform(-1.0, 1.0, COUNT) * 2.0**30).astype(kind)
    values[:20] = np.arange(20)
    found = probe(name, values, runs())
    assert all(is_neighbor(f, Fraction(v.item())) for f, v in zip(found, values, strict=True))
    assert (found != values.astype(np.float32)).any()


@pytest.mark.parametrize("name", EXACT)
def test_the_mean_is_the_exact_result(probe, name):
    """By Chebyshev a mean of n runs is within 6 standard deviations, each at most half of the gap, with probability 35/36;
    the runs are the same every time."""
    values = 1.1, 7.7, 0.7
    count = 20_000
    given = [np.full(count, v, np.float32) for v in values[: 3 if name == "fused" else 2]]
    found = probe(name, *given, runs(count=count)).astype(np.float64)
    low, high = found.min(), found.max()
    assert high == np.nextafter(np.float32(low), np.float32(np.inf))  # both neighbors, no others
    exact = float(EXACT[name](*(Fraction(float(v[0])) for v in given)))
    assert abs(found.mean() - exact) <= 6.0 * 0.5 * (high - low) / np.sqrt(count)
    assert abs(exact - 0.5 * (low + high)) > 6.0 * 0.5 * (high - low) / np.sqrt(count)  # equal chances would be seen


def test_runs_and_operands_decide_and_nothing_else(probe):
    a, b = operands(2)
    first = probe("product", a, b, runs())
    np.testing.assert_array_equal(first, probe("product", a, b, runs()))
    assert (first != probe("product", a, b, runs(first=COUNT + 1))).any()
    run = np.full(64, 5, np.uint32)
    near = np.float32(1.1) + np.arange(64, dtype=np.float32) * np.float32(2.0**-20)
    by = np.full(64, 7.7, np.float32)
    moves = probe("product", near, by, run) != near * by
    assert 0 < moves.sum() < 64  # the operands differ, not the run


def test_what_cannot_move_stays(probe):
    """Infinity, NaN, signed zeros, what is too small for its error to be a normal number, overflow, exact results."""
    a = float32([np.inf, np.nan, 0.0, -0.0, 2.0**-120, 1e38, 3.0])
    b = float32([0.1, 0.1, 0.1, 0.1, 0.1, 1e3, 0.5])
    with np.errstate(over="ignore"):
        expected = a * b
    for run in range(20):
        found = probe("product", a, b, np.full(len(a), run, np.uint32))
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(np.signbit(found[2:4]), [False, True])


def test_what_has_too_small_a_remainder_stays(probe):
    """The result is large enough, the operand is not."""
    a = float32(np.random.default_rng(5).uniform(1.0, 2.0, 64) * 2.0**-110)
    b = np.full(64, 1.7 * 2.0**-30, np.float32)
    np.testing.assert_array_equal(probe("root", a, runs(count=64)), np.sqrt(a))
    np.testing.assert_array_equal(probe("quotient", a, b, runs(count=64)), a / b)
    many = probe("root", a * np.float32(2.0**20), runs(count=64)) != np.sqrt(a * np.float32(2.0**20))
    assert many.any()


def test_the_largest_number_does_not_become_infinite(probe):
    most = np.finfo(np.float32).max
    a, b = np.full(64, most, np.float32), np.full(64, np.float32(1e30))  # the sum is most, and a little
    assert (probe("sum", a, b, runs(count=64)) == most).all()


def test_vectors_are_their_components(probe):
    a, b = (each[: COUNT // 4 * 4].reshape(-1, 4) for each in operands(2))
    run = runs(count=len(a))
    found = probe("vectors", a, b, run, width=4)
    flat = a.reshape(-1), b.reshape(-1)
    each = np.repeat(run, 4)
    parts = probe("scalars", *flat, each)
    np.testing.assert_array_equal(found.reshape(-1), parts)
    assert (found != probe("vectors", a, b, np.zeros(len(a), np.uint32), width=4)).any(axis=0).all()
