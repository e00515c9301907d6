"""operations.clh: each operation against its definition, in exact integers or in NumPy: the compiler's own, and the
runtime's function that it stands for."""

from __future__ import annotations

import math
import os
import platform
import sys
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pyopencl as cl
import pytest
from devices import needs_float64
from kernel_stages import LANES, Array, Probe
from processes import python

from clshade.pipeline.opencl.pocl_target import FORCED

TEXT = """
#include "lanes.clh"

#define FIRST int i = get_global_id(0) * LANES
#define EACH for (int lane = 0; lane < LANES; ++lane)
// Lanes from memory, and into column k of n: number by number, without what is tested and without the runtime's functions.
#define BOTH(type, vector, n)                                                                                \\
    union {                                                                                                  \\
        vector all;                                                                                          \\
        type each[n];                                                                                        \\
    }
#define GET(type, v, p)                                                                                      \\
    BOTH(type, LANES_OF(type), LANES) v;                                                                     \\
    EACH v.each[lane] = (p)[i + lane];
#define PUT(type, k, n, v)                                                                                   \\
    {                                                                                                        \\
        BOTH(type, LANES_OF(type), LANES) column = {v};                                                      \\
        EACH out[n * (i + lane) + k] = column.each[lane];                                                    \\
    }
#define THREE(name, type)                                                                                    \\
    kernel void name(global const type *a, global const type *b, global const type *c, global type *out)
#define OPERANDS(type) FIRST; GET(type, x, a) GET(type, y, b) GET(type, z, c)

// Vectors besides those of lanes, as kernels declare them.
#if DOUBLE
#define OTHERS(n, longs_) FUSED_DOUBLE(JOIN(double, n)) VECTORS(double, n)
#else
#define OTHERS(n, longs_) FUSED(JOIN(float, n), __builtin_convertvector, JOIN(double, n), longs_) VECTORS(float, n)
#endif
#if LANES != 8
OTHERS(8, long8)
VECTORS(INTEGER, 8)
#endif
#if LANES != 16
OTHERS(16, long16)
VECTORS(INTEGER, 16)
#endif
#if DOUBLE && LANES != 4
VECTORS(long, 4)
#endif

kernel void kind(global const int *x, global int *out)
{
    out[0] = HAS_OWN_OPERATIONS;
#ifdef __FMA__
    out[1] = 1;
#endif
}

#define ROWS(n, column)                                                                                      \\
    for (int k = i; i % 16 == 0 && k < i + 16; k += n) {                                                     \\
        BOTH(REAL, JOIN(REAL, n), n) u, v, w;                                                                \\
        for (int j = 0; j < n; ++j) {                                                                        \\
            u.each[j] = a[k + j];                                                                            \\
            v.each[j] = b[k + j];                                                                            \\
            w.each[j] = c[k + j];                                                                            \\
        }                                                                                                    \\
        u.all = fma(u.all, v.all, w.all);                                                                    \\
        for (int j = 0; j < n; ++j)                                                                          \\
            out[4 * (k + j) + column] = u.each[j];                                                           \\
    }
THREE(products, REAL)
{
    OPERANDS(REAL)
    PUT(REAL, 0, 4, fma(x.all, y.all, z.all))
    ROWS(4, 1)
    ROWS(8, 2)
    ROWS(16, 3)
}

kernel void of_one(global const REAL *a, global REAL *out)
{
    FIRST;
    GET(REAL, x, a)
    PUT(REAL, 0, 5, fabs(x.all))
    PUT(REAL, 1, 5, floor(x.all))
    PUT(REAL, 2, 5, ceil(x.all))
    PUT(REAL, 3, 5, rint(x.all))
    PUT(REAL, 4, 5, sqrt(x.all))
}

THREE(of_some, REAL)
{
    OPERANDS(REAL)
    PUT(REAL, 0, 3, fmin(x.all, y.all))
    PUT(REAL, 1, 3, fmax(x.all, y.all))
    PUT(REAL, 2, 3, clamp(x.all, y.all, z.all))
}

#define OF_INTEGERS(type)                                                                                    \\
    THREE(of_##type, type)                                                                                   \\
    {                                                                                                        \\
        OPERANDS(type)                                                                                       \\
        PUT(type, 0, 4, min(x.all, y.all))                                                                   \\
        PUT(type, 1, 4, max(x.all, y.all))                                                                   \\
        PUT(type, 2, 4, clamp(x.all, y.all, z.all))                                                          \\
        PUT(u##type, 3, 4, JOIN(as_, LANES_OF(u##type))(abs(x.all)))                                         \\
    }
OF_INTEGERS(int)
OF_INTEGERS(long)

kernel void of_bits(global const ulong *x, global const ulong *y, global ulong *out)
{
    FIRST;
    EACH {
        global ulong *row = out + 5 * (i + lane);
        row[0] = (ulong)popcount(x[i + lane]);
        row[1] = (ulong)popcount((uint)x[i + lane]);
        row[2] = mul_hi(x[i + lane], y[i + lane]);
        row[3] = (ulong)LOWEST_BIT(x[i + lane]);
        row[4] = (ulong)LOWEST_BIT((uint)y[i + lane]);
    }
}

kernel void reals_of(global const int *a, global const long *b, global const REAL *c, global REAL *out)
{
    FIRST;
    GET(int, x, a)
    GET(uint, u, a)
    GET(long, y, b)
    GET(REAL, z, c)
    PUT(REAL, 0, 6, TO_REALS(x.all))
    PUT(REAL, 1, 6, TO_REALS(u.all))
    PUT(REAL, 2, 6, TO_REALS(y.all))
    PUT(float, 3, 6, TO_LANES(x.all, float))
    PUT(float, 4, 6, TO_LANES(z.all, float))
    PUT(REAL, 5, 6, TO_REALS(TO_LANES(z.all, float)))
}

kernel void integers_of(global const int *a, global const long *b, global const REAL *c, global const REAL *d,
                        global long *out)
{
    FIRST;
    GET(int, x, a)
    GET(long, y, b)
    GET(REAL, z, c)
    GET(REAL, w, d)
    PUT(long, 0, 6, TO_LONGS(x.all))
    PUT(uint, 1, 6, TO_LANES(x.all, uint))
    PUT(int, 2, 6, TO_FIXEDS(y.all))
    PUT(INTEGER, 3, 6, TO_INTS(y.all))
    PUT(int, 4, 6, TO_FIXEDS(z.all))
    PUT(INTEGER, 5, 6, TO_INTS(w.all))
}

// From global through private to global memory, at addresses that suit a number only.
#define MOVE(type, n)                                                                                        \\
    kernel void move_##type##n(global const int *places, global const type *from, global type *out)    \\
    {                                                                                                        \\
        FIRST;                                                                                               \\
        EACH {                                                                                               \\
            int place = places[i + lane], shift = place % 4;                                                 \\
            type own[n + 4];                                                                                 \\
            JOIN(store, n)(JOIN(load, n)(from + place), own + shift);                                        \\
            JOIN(store, n)(JOIN(load, n)(own + shift), out + (n + 4) * (i + lane) + shift);                  \\
        }                                                                                                    \\
    }
MOVE(REAL, 4)
MOVE(REAL, 8)
MOVE(REAL, 16)
MOVE(INTEGER, 4)
MOVE(INTEGER, 8)
MOVE(INTEGER, 16)

// Each item adds its number to a counter, counts itself and sets its bit: columns 0 to 2 are what was there before, the last
// one has both counters and then the bits.
kernel void count(global const int *x, global int *out)
{
    FIRST;
    EACH {
        int item = i + lane;
        global uint *bits = (global uint *)out + 4 * (2 + item / 32) + 3;
        out[4 * item] = atomic_add(out + 3, x[item]);
        out[4 * item + 1] = atomic_inc(out + 7);
        out[4 * item + 2] = (int)atomic_or(bits, 1u << item % 32);
    }
}
"""
POCL, NEHALEM = "Portable Computing Language", "nehalem"  # LLVM's name of a processor without fma
COUNT, HARD = 100_000, 16_000  # operands of all kinds, and of each kind that is hard to round
RNG = np.random.default_rng(31)


@pytest.fixture(
    params=list(product((np.float32, np.float64), (False, True), LANES[::-1])),
    ids=lambda way: f"{way[0].__name__}-{'library' if way[1] else 'own'}-{way[2]}",
)
def way(device, request):
    """Return the type of real numbers, whether the runtime's functions are chosen, the number of lanes, and the probe."""
    real, library, lanes = request.param
    if real is np.float64:
        needs_float64(device)
    text = "#define LIBRARY_OPERATIONS\n" * library + TEXT
    return real, library, lanes, Probe(device, text, lanes=lanes, DOUBLE=real is np.float64)


# Definitions in integers


def nearest(numerator: int, places: int, kind: Any) -> float:
    """Return the number of a type that is nearest to numerator / 2^places; of two, the one whose last digit is even."""
    info, size = np.finfo(kind), abs(numerator)
    last = max(size.bit_length() - places - info.nmant - 1, info.minexp - info.nmant)  # the power of the last digit
    shift = max(last + places, 0)
    kept = (size << shift - last - places) >> shift
    rest = 2 * (size - (kept << shift)) if shift else 0
    kept += rest > 1 << shift or (rest == 1 << shift and kept % 2)
    magnitude = math.inf if kept.bit_length() + last > info.maxexp else math.ldexp(kept, last)
    return -magnitude if numerator < 0 else magnitude


def rounded(v: float, kind: Any) -> float:
    if not (math.isfinite(v) and v):
        return v
    numerator, denominator = v.as_integer_ratio()
    return nearest(numerator, denominator.bit_length() - 1, kind)


def fused(a: float, b: float, c: float, kind: Any) -> float:
    """Return a * b + c, rounded once."""
    if not (math.isfinite(a) and math.isfinite(b)):
        return a * b + c
    if not math.isfinite(c):
        return c
    (p, d), (q, e), (r, f) = (v.as_integer_ratio() for v in (a, b, c))  # the denominators are powers of two
    total = p * q * f + r * d * e
    if total:
        return nearest(total, (d * e * f).bit_length() - 1, kind)
    return 0.0 if p * q else a * b + c  # of zeros: IEEE 754's sign of their sum


def each(definition: Callable[..., float], kind: Any, *operands: Array) -> Array:
    rows = zip(*(v.tolist() for v in operands), strict=True)
    return np.array([definition(*row, kind) for row in rows]).astype(kind)


def test_definition_of_rounding():
    """The processor rounds conversions from float64, and from integers, to float32."""
    with np.errstate(all="ignore"):
        a, b, c = (v.astype(np.float64) for v in ties(np.float32))
        v = np.concatenate([a * b + c, patterns(np.float64)[:20_000], patterns(np.float32)[:20_000]])
        assert same(each(rounded, np.float32, v), v.astype(np.float32)).all()
    assert same(each(rounded, np.float64, v), v).all()
    v = integers(64)
    for kind in (np.float32, np.float64):
        assert same(each(nearest, kind, v, np.zeros_like(v)), v.astype(kind)).all()
    assert fused(1 + 2**-12, 1 + 2**-12, -(1 + 2**-11), np.float32) == 2**-24


# Operands


def spread(low: float, high: float, kind: Any) -> Array:
    """Return numbers of both signs with exponents from `low` to `high`."""
    exponents = RNG.integers(int(low), int(high) + 1, HARD)
    return (np.ldexp(RNG.uniform(1.0, 2.0, HARD), exponents) * RNG.choice([-1.0, 1.0], HARD)).astype(kind)


@cache
def patterns(kind: Any) -> Array:
    """Return bits of all kinds: signs, exponents and mantissas of a sample, all combinations; and random ones."""
    info = np.finfo(kind)
    bias = info.maxexp - 1
    exponents = [0, 1, 2, 60, bias - 1, bias, bias + 1, bias + info.nmant, 2 * bias - 1, 2 * bias, 2 * bias + 1]
    exponents = np.array([*exponents, *RNG.integers(0, 2 * bias, 8)], np.uint64) << np.uint64(info.nmant)
    mantissas = [0, 1, 1 << (info.nmant - 1), (1 << info.nmant) - 1, *RNG.integers(0, 1 << info.nmant, 8)]
    signs = np.array([0, 1 << (info.bits - 1)], np.uint64)
    grid = sum(np.meshgrid(signs, exponents, np.array(mantissas, np.uint64))).reshape(-1)
    more = RNG.choice(grid, COUNT // 2), RNG.integers(0, 1 << info.bits, COUNT // 2, np.uint64)
    return RNG.permutation(np.concatenate([grid, *more])).astype(f"u{info.bits // 8}").view(kind)


@cache
def ties(kind: Any) -> tuple[Array, Array, Array]:
    """Return a, b, c: a * b is half of c's last digit, or less by so little, x^2 in (1 + x) (1 - x), that sums in a type of
    twice as many digits are rounded to the tie. An eighth has a denormal c, and another one the largest number."""
    info = np.finfo(kind)
    digits, least, most = info.nmant + 1, info.minexp - info.nmant, info.maxexp - info.nmant - 1
    x = np.ldexp(RNG.choice([0.0, 1.0, 1.0, 1.0], HARD), -RNG.integers(digits // 2, digits, HARD))
    last, mantissas = RNG.integers(least, most + 1, HARD), RNG.integers(1 << info.nmant, 1 << digits, HARD)
    last[: HARD // 8], last[-HARD // 8 :] = least, most
    mantissas[: HARD // 8] >>= RNG.integers(1, digits, HARD // 8)
    mantissas[-HARD // 8 :] = (1 << digits) - 1
    half, signs = (last - 1) // 2, RNG.choice([-1.0, 1.0], (2, HARD))
    a, b = np.ldexp(1.0 + x, half), np.ldexp(1.0 - x, last - 1 - half) * signs[0]
    return a.astype(kind), b.astype(kind), (np.ldexp(mantissas.astype(np.float64), last) * signs[1]).astype(kind)


@cache
def factors(kind: Any) -> tuple[tuple[Array, ...], Array]:
    """Return a, b and c, and a * b + c rounded once: of all kinds, ties, and sums that cancel, are denormal or overflow."""
    info = np.finfo(kind)
    least, most = info.minexp - info.nmant, info.maxexp
    free = tuple(RNG.permutation(patterns(kind)) for _ in range(3))
    a, b = spread(-most / 4, most / 4, kind), spread(-most / 4, most / 4, kind)
    near = a, b, a * b * spread(-2 * info.nmant, 2 * info.nmant, kind)
    cancel = a, b, np.nextafter(-a * b, RNG.choice([-1.0, 0.0, 1.0], HARD).astype(kind) * a * b)
    tiny = *(spread(least / 2 - 9, info.minexp / 2 + 1, kind) for _ in "ab"), spread(least, info.minexp + 2, kind)
    huge = *(spread(most / 2 - 2, most / 2, kind) for _ in "ab"), spread(most - 4, most - 1, kind)
    operands = tuple(map(np.concatenate, zip(free, ties(kind), near, cancel, tiny, huge, strict=True)))
    return operands, each(fused, kind, *operands)


@cache
def integers(bits: int, signed: bool = True) -> Array:
    """Return integers of so many bits: the outermost ones, ties of float32 and those beside them, and any of each length."""
    unsigned = [(1 << bits) - 1, 1 << (bits - 1), (1 << (bits - 1)) - 1, (1 << bits // 2) - 1, *range(8)]
    for k in range(bits - 25):
        tie = (1 << 24 | int(RNG.integers(1 << 24))) << k + 1 | 1 << k
        unsigned += [tie, tie - 1, tie + 1]
    unsigned = np.array([*unsigned, *(-v % (1 << bits) for v in unsigned)], np.uint64)
    free = RNG.integers(0, 1 << bits, (2, COUNT // 2), np.uint64)
    shifts = RNG.integers(0, bits, COUNT // 2, np.uint64)
    values = np.concatenate([unsigned, free[0] >> shifts, free[1] >> shifts << shifts])
    return RNG.permutation(values).astype(f"u{bits // 8}").view(f"{'i' if signed else 'u'}{bits // 8}")


# Comparison


def same(found: Array, expected: Array) -> Array:
    """Return where the bits are equal, or both are NaN."""
    whole = f"u{expected.dtype.itemsize}"
    return (found.view(whole) == expected.view(whole)) | (np.isnan(found) & np.isnan(expected))


def without_denormals(v: Array) -> Array:
    return np.where(np.abs(v) < np.finfo(v.dtype).tiny, np.copysign(v.dtype.type(0), v), v)


def check(device: Any, found: Array, definition: Callable[..., Array], *operands: Array) -> None:
    """Compare with the definition. A device without denormals may take them as 0, and return 0."""
    with np.errstate(all="ignore"):
        expected = definition(*operands)
        right = same(found, expected)
        if found.dtype == np.float32 and not device.device.single_fp_config & cl.device_fp_config.DENORM:
            for taken in (expected, definition(*map(without_denormals, operands))):
                right |= same(found, taken) | same(found, without_denormals(taken))
    assert right.all(), [[float(v[i]).hex() for v in (*operands, found, expected)] for i in np.flatnonzero(~right)[:3]]


def columns(found: Array) -> Array:
    return np.ascontiguousarray(found.T)


# Tests


@pytest.mark.sampled
def test_what_is_tested(device, way):
    """PoCL compiles for x86-64 by clang; elsewhere both ways are the runtime's functions."""
    _, library, _, probe = way
    own, has_fma = probe("kind", np.zeros(2, np.int32), dtype=np.int32)
    assert not (own and library)
    if device.platform == POCL and platform.machine() == "x86_64":
        assert own == (not library)
        assert not (has_fma and os.environ.get(FORCED) == NEHALEM)


@pytest.mark.sampled
def test_fused(device, way):
    """a * b + c rounded once, which the operands tell from a sum of twice as many digits and from two roundings."""
    real, _, _, probe = way
    operands, expected = factors(real)
    assert len(expected) > COUNT
    with np.errstate(all="ignore"):
        a, b, c = operands
        assert np.count_nonzero(~same(a * b + c, expected)) > HARD
        if real is np.float32:
            wide = [v.astype(np.float64) for v in operands]
            assert np.count_nonzero(~same((wide[0] * wide[1] + wide[2]).astype(real), expected)) > HARD / 8
    for found in columns(probe("products", *operands, width=4, dtype=real)):
        check(device, found, lambda *v: expected if v[0] is a else each(fused, real, *v), *operands)
    x = np.array([1 + 2.0**-12, 1 + 2.0**-12, -(1 + 2.0**-11)], np.float32).astype(real)
    assert (probe("products", x[:1], x[1:2], x[2:], width=4, dtype=real) == 2.0**-24).all()


@pytest.mark.long
def test_fused_without_an_instruction(device, tmp_path):
    """A processor that has no fma: the sum of float64 is rounded to odd, then to float32."""
    bundled = list(Path(cl.__file__).parent.glob(".libs/libpocl*"))
    if not (bundled and device.platform == POCL and sys.platform == "linux" and platform.machine() == "x86_64"):
        pytest.skip("not PyPI's PoCL on x86-64 Linux")
    arguments = [__file__, "-q", "-m", "", "-k", "(test_what or test_fused) and float32-own", "-p", "no:cacheprovider"]
    code = f"import sys, pytest; sys.exit(pytest.main({arguments}))"
    variables = {FORCED: NEHALEM, "CLSHADE_TEST_PLATFORM": POCL, "POCL_AFFINITY": "0"}
    done = python(code, tmp_path, timeout=600.0, **variables)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{2 * len(LANES)} passed" in done.stdout


@pytest.mark.sampled
def test_functions_of_a_real(device, way):
    real, _, _, probe = way
    halves = np.arange(-100, 101) / 2
    ends = 2.0 ** np.finfo(real).nmant * np.array([[-1.0], [-0.5], [0.25], [0.5], [1.0], [2.0]]) + halves
    x = np.concatenate([patterns(real), ends.reshape(-1).astype(real), halves.astype(real)])
    found = columns(probe("of_one", x, width=5, dtype=real))
    for column, definition in zip(found, (np.abs, np.floor, np.ceil, np.rint, np.sqrt), strict=True):
        check(device, column, definition, x)
    positive = x[np.isfinite(x) & (x > 0)][:5000]  # np.sqrt is the host's instruction
    with mpmath.workprec(np.finfo(real).nmant + 1):
        assert np.array_equal(np.sqrt(positive), [float(mpmath.sqrt(v)) for v in positive.tolist()])


@pytest.mark.sampled
def test_least_and_most_of_reals(device, way):
    """The other one if one is NaN, which may be signaling or not; either of two zeros."""
    real, _, _, probe = way
    a, b, c = factors(real)[0]
    b, c = np.where(RNG.random(len(a)) < 0.1, a, b), np.where(RNG.random(len(a)) < 0.1, -a, c)
    found = columns(probe("of_some", a, b, c, width=3, dtype=real) + real(0))
    check(device, found[0], lambda a, b: np.fmin(a, b) + real(0), a, b)
    check(device, found[1], lambda a, b: np.fmax(a, b) + real(0), a, b)
    keep = ~np.isnan(a) & (b <= c)  # otherwise undefined
    assert np.count_nonzero(keep) > COUNT / 4
    operands = [v[keep] for v in (a, b, c)]
    check(device, found[2][keep], lambda a, b, c: np.minimum(np.maximum(a, b), c) + real(0), *operands)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_functions_of_integers(way, kind):
    probe = way[-1]
    a = integers(kind().itemsize * 8)
    b, c = np.sort([RNG.permutation(a), RNG.permutation(a)], axis=0)
    name = {np.int32: "of_int", np.int64: "of_long"}[kind]
    least, most, inside, size = probe(name, a, b, c, width=4, dtype=kind).T
    assert np.array_equal(least, np.minimum(a, b))
    assert np.array_equal(most, np.maximum(a, b))
    assert np.array_equal(inside, np.clip(a, b, c))
    can = a != np.iinfo(kind).min  # whose size is not in the type
    assert np.array_equal(size[can], np.abs(a[can]))


@pytest.mark.sampled
def test_bits(way):
    """Of 64 and of 32 bits."""
    x = integers(64, signed=False)
    y = RNG.permutation(x)
    x, y = (v[(x != 0) & (y & 0xFFFFFFFF != 0)] for v in (x, y))
    found = way[-1]("of_bits", x, y, width=5, dtype=np.uint64)
    rows = zip(x.tolist(), y.tolist(), strict=True)
    expected = [
        (
            bin(a).count("1"),
            bin(a & 0xFFFFFFFF).count("1"),
            a * b >> 64,
            (a & -a).bit_length() - 1,
            (b & -b).bit_length() - 1,
        )
        for a, b in [*rows]
    ]
    assert np.array_equal(found, np.array(expected, np.uint64))


@pytest.mark.sampled
def test_conversion_to_reals(device, way):
    """Each rounded once, ties to even."""
    real, _, _, probe = way
    count = COUNT // 2
    x, y = integers(32)[:count], integers(64)[:count]
    z = patterns(real)[:count]
    if real is np.float64:  # what is near a tie of float32
        a, b, c = (v.astype(real) for v in ties(np.float32))
        z = np.concatenate([z[: count - HARD], a * b + c])
    found = columns(probe("reals_of", x, y, z, width=6, dtype=real))
    for column, v, kind in ((0, x, real), (1, x.view(np.uint32), real), (2, y, real), (3, x, np.float32)):
        check(device, found[column], lambda v, kind=kind: each(nearest, kind, v, np.zeros_like(v)).astype(real), v)
    for column in (4, 5):
        check(device, found[column], lambda v: each(rounded, np.float32, v).astype(real), z)


@pytest.mark.sampled
def test_conversion_to_integers(way):
    """Within the range of the type; reals toward 0."""
    real, _, _, probe = way
    x = integers(32)
    y = integers(64) >> (32 if real is np.float32 else 0)
    z = np.concatenate([patterns(real), spread(-2, 30, real), (x / 2).astype(real)])
    z, w = (z[np.abs(z) < 2.0**bits] for bits in (31, 31 if real is np.float32 else 63))
    count = min(map(len, (x, y, z, w)))
    x, y, z, w = (RNG.permutation(v)[:count] for v in (x, y, z, w))
    found = probe("integers_of", x, y, z, w, width=6, dtype=np.int64).T
    expected = x, x.view(np.uint32), y.astype(np.int32), y, np.trunc(z), np.trunc(w)
    for column, v in zip(found, expected, strict=True):
        assert np.array_equal(column, v.astype(np.int64))


@pytest.mark.sampled
def test_loads_and_stores(way):
    real, _, _, probe = way
    for (name, kind), n in product(
        (("REAL", real), ("INTEGER", np.int32 if real is np.float32 else np.int64)), (4, 8, 16)
    ):
        values = np.arange(1, 1001).astype(kind)
        places = RNG.integers(0, len(values) - n, 1000).astype(np.int32)
        expected = np.zeros((len(places), n + 4), kind)
        moved = values[places[:, None] + np.arange(n)]
        np.put_along_axis(expected, places[:, None] % 4 + np.arange(n), moved, axis=1)
        assert np.array_equal(probe(f"move_{name}{n}", places, values, width=n + 4, dtype=kind), expected), (name, n)


@pytest.mark.sampled
def test_atomics(way):
    """Of work-items that run at the same time each gets what the others have left, and nothing is lost."""
    x = RNG.integers(1, 1000, 1 << 17).astype(np.int32)
    added, counted, had, after = way[-1]("count", x, width=4, dtype=np.int32).T
    order = np.argsort(added)
    assert np.array_equal(np.append(added[order], after[0]), np.append(0, np.cumsum(x[order])))
    assert np.array_equal(np.sort(counted), np.arange(len(x)))
    assert after[1] == len(x)
    before = had.view(np.uint32).reshape(-1, 32, 1) >> np.arange(32, dtype=np.uint32) & 1  # word, item, bit
    assert not before.diagonal(axis1=1, axis2=2).any()
    assert (np.sort(before.sum(axis=2), axis=1) == np.arange(32)).all()
    assert (after[2 : 2 + len(before)] == -1).all()
