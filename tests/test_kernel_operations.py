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

pytestmark = pytest.mark.optimized

POCL = "Portable Computing Language"
HAS_FMA = {"nehalem": 0, "haswell": 1}  # of targets other than this processor
COUNT, HARD = 100_000, 16_000  # operands of all kinds, and of each kind that is hard to round
RNG = np.random.default_rng(31)
TEXT = """
#include "lanes.clh"
#define FIRST int i = get_global_id(0) * LANES
#define EACH for (int lane = 0; lane < LANES; ++lane)
#define LANES_IN(type) union { LANES_OF(type) all; type each[LANES]; }

kernel void kind(global const int *x, global int *out)
{
    out[0] = HAS_OWN_OPERATIONS;
#ifdef __FMA__
    out[1] = 1;
#endif
}

kernel void of_bits(global const ulong *a, global const ulong *b, global ulong *out)
{
    FIRST;
    EACH {
        ulong x = a[i + lane], y = b[i + lane];
        global ulong *row = out + 5 * (i + lane);
        row[0] = (ulong)popcount(x);
        row[1] = (ulong)popcount((uint)x);
        row[2] = mul_hi(x, y);
        row[3] = (ulong)LOWEST_BIT(x);
        row[4] = (ulong)LOWEST_BIT((uint)y);
    }
}

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

// From global through private to global memory, at addresses that suit a number only.
#define MOVE(type, n)                                                                                        \\
    kernel void move_##type##_##n(global const int *places, global const type *from, global type *out)       \\
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
MOVE(int, 4)
#if LANES > 1
MOVE(REAL, LANES)
MOVE(INTEGER, LANES)
#endif
"""


def kernel(name: str, kinds: str, out: str, *results: str) -> str:
    """Return a kernel of lanes a, b, c and d. kinds: their types. results: type: expression, one for each column. Lanes are
    loaded and stored number by number, neither by what is tested nor by functions of the runtime."""
    inputs = list(zip("abcd", kinds.split(), strict=False))
    lines = [f"LANES_IN({kind}) {v}_; EACH {v}_.each[lane] = {v}s[i + lane];" for v, kind in inputs]
    lines += [f"LANES_OF({kind}) {v} = {v}_.all;" for v, kind in inputs]
    for k, (kind, expression) in enumerate(result.split(": ") for result in results):
        write = f"EACH out[{len(results)} * (i + lane) + {k}] = v.each[lane];"
        lines.append(f"{{ LANES_IN({kind}) v = {{{expression}}}; {write} }}")
    arguments = "".join(f"global const {kind} *{v}s, " for v, kind in inputs)
    return "\n    ".join([f"kernel void {name}({arguments}global {out} *out)\n{{\n    FIRST;", *lines]) + "\n}\n"


OF_REALS = {
    "fabs(a)": np.abs,
    "floor(a)": np.floor,
    "ceil(a)": np.ceil,
    "rint(a)": np.rint,
    "sqrt(a)": np.sqrt,
    "fmin(a, b)": np.fmin,
    "fmax(a, b)": np.fmax,
    "clamp(a, b, c)": np.clip,
}
OF_INTEGERS = {"min(a, b)": np.minimum, "max(a, b)": np.maximum, "clamp(a, b, c)": np.clip}
TEXT += kernel("fused_all", "REAL REAL REAL", "REAL", "REAL: fma(a, b, c)")
TEXT += kernel("of_reals", "REAL REAL REAL", "REAL", *(f"REAL: {call}" for call in OF_REALS))
for KIND in ("int", "long"):  # OpenCL's abs is unsigned
    CALLS = *(f"{KIND}: {call}" for call in OF_INTEGERS), f"u{KIND}: JOIN(as_, LANES_OF(u{KIND}))(abs(a))"
    TEXT += kernel(f"of_{KIND}", f"{KIND} {KIND} {KIND}", KIND, *CALLS)
CALLS = "REAL: TO_REALS(a)", "REAL: TO_REALS(b)", "REAL: TO_REALS(c)", "float: TO_LANES(a, float)"
TEXT += kernel("reals_of", "int uint long REAL", "REAL", *CALLS, "float: TO_LANES(d, float)")
CALLS = "long: TO_LONGS(a)", "uint: TO_LANES(a, uint)", "int: TO_FIXEDS(b)", "INTEGER: TO_INTS(b)"
TEXT += kernel("integers_of", "int long REAL REAL", "long", *CALLS, "int: TO_FIXEDS(c)", "INTEGER: TO_INTS(d)")


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


def test_definitions():
    """The processor rounds conversions from float64, and from integers, and square roots."""
    with np.errstate(all="ignore"):
        a, b, c = (v.astype(np.float64) for v in ties(np.float32))
        v = np.concatenate([a * b + c, patterns(np.float64)[:20_000], patterns(np.float32)[:20_000]])
        assert same(each(rounded, np.float32, v), v.astype(np.float32)).all()
    assert same(each(rounded, np.float64, v), v).all()
    for kind in (np.float32, np.float64):
        v = integers(np.int64)
        assert same(each(nearest, kind, v, np.zeros_like(v)), v.astype(kind)).all()
        v = patterns(kind)[:20_000]
        v = v[np.isfinite(v) & (v > 0)]
        with mpmath.workprec(np.finfo(kind).nmant + 1):
            assert np.array_equal(np.sqrt(v), [float(mpmath.sqrt(x)) for x in v.tolist()])
    assert fused(1 + 2**-12, 1 + 2**-12, -(1 + 2**-11), np.float32) == 2**-24


# Operands


def spread(low: float, high: float, kind: Any) -> Array:
    """Return numbers of both signs with exponents from `low` to `high`."""
    exponents = RNG.integers(int(low), int(high) + 1, HARD)
    return (np.ldexp(RNG.uniform(1.0, 2.0, HARD), exponents) * RNG.choice([-1.0, 1.0], HARD)).astype(kind)


@cache
def patterns(kind: Any) -> Array:
    """Return numbers of all kinds: signs, exponents and mantissas of a sample, all combinations; random bits; and halves."""
    info = np.finfo(kind)
    bias = info.maxexp - 1
    exponents = [0, 1, 2, 60, bias - 1, bias, bias + 1, bias + info.nmant, 2 * bias - 1, 2 * bias, 2 * bias + 1]
    exponents = np.array([*exponents, *RNG.integers(0, 2 * bias, 8)], np.uint64) << np.uint64(info.nmant)
    mantissas = [0, 1, 1 << (info.nmant - 1), (1 << info.nmant) - 1, *RNG.integers(0, 1 << info.nmant, 8)]
    signs = np.array([0, 1 << (info.bits - 1)], np.uint64)
    grid = sum(np.meshgrid(signs, exponents, np.array(mantissas, np.uint64))).reshape(-1)
    more = RNG.choice(grid, COUNT // 2), RNG.integers(0, 1 << info.bits, COUNT // 2, np.uint64)
    numbers = np.concatenate([grid, *more]).astype(f"u{info.bits // 8}").view(kind)
    starts = np.array([[-1.0], [-0.5], [0.0], [0.25], [0.5], [1.0]]) * 2.0**info.nmant
    return RNG.permutation(np.append(numbers, (starts + np.arange(-100, 101) / 2).astype(kind)))


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
    free = tuple(RNG.permutation(patterns(kind)) for _ in "abc")
    a, b = spread(-most / 4, most / 4, kind), spread(-most / 4, most / 4, kind)
    near = a, b, a * b * spread(-2 * info.nmant, 2 * info.nmant, kind)
    cancel = a, b, np.nextafter(-a * b, RNG.choice([-2.0, -1.0, 0.0], HARD).astype(kind) * a * b)
    tiny = *(spread(least / 2 - 9, info.minexp / 2 + 1, kind) for _ in "ab"), spread(least, info.minexp + 2, kind)
    huge = *(spread(most / 2 - 2, most / 2, kind) for _ in "ab"), spread(most - 4, most - 1, kind)
    operands = tuple(map(np.concatenate, zip(free, ties(kind), near, cancel, tiny, huge, strict=True)))
    return operands, each(fused, kind, *operands)


@cache
def integers(kind: Any) -> Array:
    """Return integers of a type: the outermost ones, ties between reals and those beside them, and any of each length."""
    bits = np.iinfo(kind).bits
    chosen = [(1 << bits) - 1, 1 << (bits - 1), (1 << (bits - 1)) - 1, (1 << bits // 2) - 1, *range(8)]
    for digits in (24, 53):
        for k in list(range(bits - digits)) * 4:
            tie = (1 << digits | int(RNG.integers(1 << digits)) | 1) << k
            chosen += [tie, tie - 1, tie + 1]
    chosen = np.array([v % (1 << bits) for v in (*chosen, *(-v for v in chosen))], np.uint64)
    free = RNG.integers(0, 1 << bits, (2, COUNT // 2), np.uint64)
    shifts = RNG.integers(0, bits, COUNT // 2, np.uint64)
    values = np.concatenate([chosen, free[0] >> shifts, free[1] >> shifts << shifts])
    return RNG.permutation(values).astype(f"u{bits // 8}").view(kind)


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


# Tests


@pytest.mark.sampled
def test_what_is_tested(device, way):
    """PoCL compiles for x86-64 by clang; elsewhere both ways may be the runtime's functions."""
    _, library, _, probe = way
    own, has_fma = probe("kind", np.zeros(2, np.int32), dtype=np.int32)
    assert not (own and library)
    if device.platform == POCL and platform.machine() == "x86_64":
        assert own == (not library)
        assert has_fma == HAS_FMA.get(os.environ.get(FORCED, ""), has_fma)


@pytest.mark.sampled
def test_fused(device, way):
    """a * b + c rounded once, which the operands tell from two roundings, and from the rounding of a sum in float64."""
    real, _, _, probe = way
    operands, expected = factors(real)
    a, b, c = operands
    with np.errstate(all="ignore"):
        assert np.count_nonzero(~same(a * b + c, expected)) > HARD
        wide = (a.astype(np.float64) * b + c).astype(real)
        assert np.count_nonzero(~same(wide, expected)) > HARD / 8
    found = probe("fused_all", *operands, dtype=real)
    check(device, found, lambda *v: expected if v[0] is a else each(fused, real, *v), *operands)
    x = np.array([1 + 2.0**-12, 1 + 2.0**-12, -(1 + 2.0**-11)]).astype(real)
    assert probe("fused_all", x[:1], x[1:2], x[2:], dtype=real) == 2.0**-24


@pytest.mark.long
@pytest.mark.parametrize("target", HAS_FMA)
def test_another_processor(device, tmp_path, target):
    """Without an instruction for fma, and with one but without AVX-512. The runtime's functions are not made for these."""
    bundled = list(Path(cl.__file__).parent.glob(".libs/libpocl*"))
    if not (bundled and device.platform == POCL and sys.platform == "linux" and platform.machine() == "x86_64"):
        pytest.skip("not PyPI's PoCL on x86-64 Linux")
    if HAS_FMA[target] and " avx2 " not in Path("/proc/cpuinfo").read_text():
        pytest.skip(f"this processor does not run code for {target}")
    arguments = [__file__, "-q", "-m", "", "-k", "own", "-p", "no:cacheprovider"]
    code = f"import sys, pytest; sys.exit(pytest.main({arguments}))"
    done = python(code, tmp_path, timeout=600.0, CLSHADE_TEST_PLATFORM=POCL, **{FORCED: target})
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout


@pytest.mark.sampled
def test_functions_of_reals(device, way):
    """Each where it is defined: fmin and fmax of any NaN that is quiet; of two zeros either."""
    real, _, _, probe = way
    a, b, c = (np.where(np.isnan(v), real(np.nan), v) for v in factors(real)[0])
    b, c = np.where(RNG.random(len(a)) < 0.1, a, b), np.where(RNG.random(len(a)) < 0.1, -a, c)
    found = np.ascontiguousarray(probe("of_reals", a, b, c, width=len(OF_REALS), dtype=real).T)
    for column, (call, definition) in zip(found, OF_REALS.items(), strict=True):
        count = call.count(",") + 1
        defined = ~np.isnan(a) & (b <= c) if count == 3 else np.full(len(a), True)
        assert np.count_nonzero(defined) > COUNT / 4
        operands = [v[defined] for v in (a, b, c)[:count]]
        zero = real(0 if count > 1 else -0.0)  # only -0 + 0 is another number's zero
        check(device, column[defined] + zero, lambda *v, f=definition, zero=zero: f(*v) + zero, *operands)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_functions_of_integers(way, kind):
    a = integers(kind)
    b, c = np.sort([RNG.permutation(a), RNG.permutation(a)], axis=0)
    *found, size = way[-1]("of_int" if kind is np.int32 else "of_long", a, b, c, width=4, dtype=kind).T
    for column, (call, definition) in zip(found, OF_INTEGERS.items(), strict=True):
        assert np.array_equal(column, definition(*(a, b, c)[: call.count(",") + 1]))
    fits = a != np.iinfo(kind).min
    assert np.array_equal(size[fits], np.abs(a[fits]))


@pytest.mark.sampled
def test_bits(way):
    """Of 64 and of 32 bits."""
    x = integers(np.uint64)
    y = RNG.permutation(x)
    x, y = (v[(x != 0) & (y & 0xFFFFFFFF != 0)] for v in (x, y))
    ones, low_ones, high, first, low_first = way[-1]("of_bits", x, y, width=5, dtype=np.uint64).T.tolist()
    pairs = list(zip(x.tolist(), y.tolist(), strict=True))
    assert ones == [bin(a).count("1") for a, _ in pairs]
    assert low_ones == [bin(a & 0xFFFFFFFF).count("1") for a, _ in pairs]
    assert high == [a * b >> 64 for a, b in pairs]
    assert first == [(a & -a).bit_length() - 1 for a, _ in pairs]
    assert low_first == [(b & -b).bit_length() - 1 for _, b in pairs]


@pytest.mark.sampled
def test_conversion_to_reals(device, way):
    """Each rounded once, ties to even."""
    real, _, _, probe = way
    a, b, c = (v.astype(real) for v in ties(np.float32))
    with np.errstate(over="ignore"):
        z = np.concatenate([a * b + c, patterns(real)])[: COUNT // 2]  # in float64 near ties of float32
    x, y = integers(np.int32)[: len(z)], integers(np.int64)[: len(z)]
    found = np.ascontiguousarray(probe("reals_of", x, x.view(np.uint32), y, z, width=5, dtype=real).T)
    for column, v, kind in zip(found, (x, x.view(np.uint32), y, x), (real, real, real, np.float32), strict=False):
        check(device, column, lambda v, kind=kind: each(nearest, kind, v, np.zeros_like(v)).astype(real), v)
    check(device, found[4], lambda v: each(rounded, np.float32, v).astype(real), z)


@pytest.mark.sampled
def test_conversion_to_integers(way):
    """Of numbers within the range of the type; of reals, toward 0."""
    real, _, _, probe = way
    most = 31 if real is np.float32 else 63
    x, y = integers(np.int32), integers(np.int64) >> (63 - most)
    z = np.concatenate([patterns(real), spread(-2, 30, real), (x / 2).astype(real)])
    z, w = (RNG.permutation(z[(z >= -(2.0**bits)) & (z < 2.0**bits)])[: COUNT // 2] for bits in (31, most))
    x, y = x[: len(z)], y[: len(z)]
    found = probe("integers_of", x, y, z, w, width=6, dtype=np.int64).T
    expected = x, x.view(np.uint32), y.astype(np.int32), y, np.trunc(z), np.trunc(w)
    for column, v in zip(found, expected, strict=True):
        assert np.array_equal(column, v.astype(np.int64))


@pytest.mark.sampled
def test_loads_and_stores(way):
    real, _, lanes, probe = way
    moves = {"REAL_4": real, "int_4": np.int32}
    if lanes > 1:
        moves |= {"REAL_LANES": real, "INTEGER_LANES": np.int32 if real is np.float32 else np.int64}
    for name, kind in moves.items():
        row = np.arange(4 if name.endswith("4") else lanes)
        values = np.arange(1, 1001).astype(kind)
        places = RNG.integers(0, len(values) - len(row), 1000).astype(np.int32)[:, None]
        expected = np.zeros((len(places), len(row) + 4), kind)
        np.put_along_axis(expected, places % 4 + row, values[places + row], axis=1)
        found = probe(f"move_{name}", places.reshape(-1), values, width=len(row) + 4, dtype=kind)
        assert np.array_equal(found, expected), name


@pytest.mark.sampled
def test_atomics(way):
    """Of work-items that run at the same time each gets what the others have left, and nothing is lost."""
    x = RNG.integers(1, 1000, 1 << 17).astype(np.int32)
    added, counted, had, after = way[-1]("count", x, width=4, dtype=np.int32).T
    order = np.argsort(added)
    assert np.array_equal(np.append(added[order], after[0]), np.append(0, np.cumsum(x[order])))
    assert np.array_equal(np.sort(counted), np.arange(len(x)))
    assert after[1] == len(x)
    before = np.ascontiguousarray(had).view(np.uint32).reshape(-1, 32, 1) >> np.arange(32, dtype=np.uint32) & 1
    assert not before.diagonal(axis1=1, axis2=2).any()  # of word, item, bit
    assert (np.sort(before.sum(axis=2), axis=1) == np.arange(32)).all()
    assert (after[2 : 2 + len(before)] == -1).all()
