"""Each operation of kernels/operations.clh against its definition, in exact integers or in NumPy: the compiler's own, and
the runtime's function that it stands for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...pipeline import programs
from ...pipeline.features import COMPILED
from .case import C_TYPES, GROUP, UNWRITTEN, Case, in_one_program, signature
from .operands import COUNT, factors, integers, patterns, rng, spread, ties

DIVIDING = ("quotient_float", "root_float")  # correctly rounded on devices that say so
HEAD = """
#include "lanes.clh"
#define FIRST int i = get_global_id(0) * LANES
#define EACH for (int lane = 0; lane < LANES; ++lane)
#define LANES_IN(type) union { LANES_OF(type) all; type each[LANES]; }
"""
# From global through private to global memory, at addresses that suit a number only: {n} numbers of a row of {n} + 4.
MOVE = """
{{
    FIRST;
    EACH {{
        int place = places[i + lane] % 4, shift = places[i + lane] / 4;
        REAL own[{n} + 4];
        JOIN(store, {n})(JOIN(load, {n})(from + ({n} + 4) * (i + lane) + place), own + shift);
        JOIN(store, {n})(JOIN(load, {n})(own + shift), out + ({n} + 4) * (i + lane) + shift);
    }}
}}
"""
# Each item takes a number from a counter by atomic_inc, one from another by atomic_add, and the place in its word of the bit
# that it sets: in each column one item gets each row, to which it adds 1. The last column is the sum of x.
COUNT_TEXT = """
kernel void count(global const int *x, global int *scratch, global int *out)
{
    FIRST;
    EACH {
        int item = i + lane;
        atomic_add(out + 4 * atomic_inc(scratch), 1);
        atomic_add(out + 4 * (atomic_add(scratch + 1, 3) / 3) + 1, 1);
        uint had = atomic_or((global uint *)scratch + 2 + item / 32, 1u << item % 32);
        if (!(had >> item % 32 & 1))
            atomic_add(out + 4 * (item / 32 * 32 + popcount(had)) + 2, 1);
        atomic_add(out + 3, x[item]);
    }
}
"""


class Way(NamedTuple):
    """real: type of reals, float32 or float64. library: whether the runtime's functions are chosen. lanes: 1 to 16."""

    real: Any
    library: bool
    lanes: int

    def __str__(self) -> str:
        return f"{self.real.__name__}-{'library' if self.library else 'own'}-{self.lanes}"

    @property
    def options(self) -> tuple[str, ...]:
        double = int(self.real is np.float64)
        chosen = {**dict.fromkeys(COMPILED, 0), "DOUBLE": double, "FP64": double, "LANES": self.lanes}
        library = ("-DLIBRARY_OPERATIONS",) if self.library else ()
        return (*(f"-D{name}={value}" for name, value in chosen.items()), "-DLEFT_OUT=0UL", *library)


def cases(way: Way) -> list[Case]:
    """Return all cases of a way, built as one program."""
    all_cases = [*_of_reals(way), *_of_integers(way), *_of_bits(way), *_conversions(way)]
    all_cases += [*(_moves(way, n) for n in dict.fromkeys((4, way.lanes)) if n > 1), _atomics(way)]
    return in_one_program(all_cases)


def nearest(numerator: int, places: int, kind: Any) -> float:
    """Return the number of a type that is nearest to numerator / 2^places; of two, the one whose last digit is even."""
    info, size = np.finfo(kind), abs(numerator)
    last = max(size.bit_length() - places - info.nmant - 1, info.minexp - info.nmant)  # the power of the last digit
    shift = max(last + places, 0)
    quotient = (size << shift - last - places) >> shift
    remainder = 2 * (size - (quotient << shift)) if shift else 0
    quotient += remainder > 1 << shift or (remainder == 1 << shift and quotient % 2)
    magnitude = math.inf if quotient.bit_length() + last > info.maxexp else math.ldexp(quotient, last)
    return -magnitude if numerator < 0 else magnitude


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
    """Return a definition's results, (K,), for operands (K,) each."""
    rows = zip(*(v.tolist() for v in operands), strict=True)
    return np.array([definition(*row, kind) for row in rows]).astype(kind)


def _case(
    way: Way,
    name: str,
    expression: str,
    inputs: Sequence[Array],
    define: Callable[..., Array],
    kind: Any = None,
    scalars: bool = False,
) -> Case:
    """Return the case of an expression of lanes a, b and c, or of numbers if it is one of `scalars`.

    kind: NumPy type of the result, None: that of a. Lanes are loaded and stored number by number, neither by what is tested
    nor by functions of the runtime.
    """
    inputs = tuple(np.append(v, np.repeat(v[-1:], -len(v) % GROUP)) for v in inputs)
    kind = np.dtype(inputs[0].dtype if kind is None else kind)
    types = [(v, C_TYPES[array.dtype]) for v, array in zip("abc", inputs, strict=False)]
    if scalars:
        numbers = " ".join(f"{c} {v} = {v}s[i + lane];" for v, c in types)
        lines = [f"EACH {{ {numbers} out[i + lane] = {expression}; }}"]
    else:
        lines = [f"LANES_IN({c}) {v}_; EACH {v}_.each[lane] = {v}s[i + lane];" for v, c in types]
        lines += [f"LANES_OF({c}) {v} = {v}_.all;" for v, c in types]
        lines.append(f"LANES_IN({C_TYPES[kind]}) v = {{{expression}}};")
        lines.append("EACH out[i + lane] = v.each[lane];")
    name = f"{name}_{types[0][1]}"
    body = "".join(f"    {line}\n" for line in ("FIRST;", *lines))
    text = f"{signature(name, [f'{v}s' for v in 'abc'], inputs, kind)}\n{{\n{body}}}\n"
    more = (_head(), way.options, way.lanes)
    return Case(name, f"{expression} of {types[0][1]}", text, inputs, lambda *v: define(*v).astype(kind), *more)


@cache
def _head() -> str:
    return programs.flatten_text(HEAD)


def _of_reals(way: Way) -> Iterator[Case]:
    real = way.real
    a, b, c = factors(real)
    yield _case(way, "fused", "fma(a, b, c)", (a, b, c), lambda a, b, c: each(fused, real, a, b, c))
    yield _case(way, "sum", "a + b", (a, b), np.add)
    yield _case(way, "difference", "a - b", (a, b), np.subtract)
    yield _case(way, "product", "a * b", (a, b), np.multiply)
    yield _case(way, "quotient", "a / b", (a, b), np.divide)
    yield _case(way, "root", "sqrt(a)", (a,), np.sqrt)
    with np.errstate(all="ignore"):
        product = np.abs(a * b)  # a device that flushes denormals may take it as 0
    normal = ~((product > 0) & (product <= np.finfo(real).tiny))
    yield _case(way, "rounded_twice", "a * b + c", (a[normal], b[normal], c[normal]), lambda a, b, c: a * b + c)
    random = rng(6)  # NaN is quiet, and of two zeros a and b either both are negative or none
    a, b, c = (np.where(np.isnan(v), real(np.nan), v) for v in (a, b, c))
    b, c = np.where(random.random(len(a)) < 0.1, a, b), np.where(random.random(len(a)) < 0.1, -a, c)
    b = np.where((a == 0.0) & (b == 0.0), a, b)
    for name, define in {"fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "rint": np.rint}.items():
        yield _case(way, name, f"{name}(a)", (a,), define)
    yield _case(way, "fmin", "fmin(a, b)", (a, b), np.fmin)
    yield _case(way, "fmax", "fmax(a, b)", (a, b), np.fmax)
    ordered = (a == a) & (b <= c)
    yield _case(
        way, "clamp", "clamp(a, b, c)", tuple(np.where(v == 0, real(0), v)[ordered] for v in (a, b, c)), np.clip
    )


def _of_integers(way: Way) -> Iterator[Case]:
    for kind, unsigned in ((np.int32, np.uint32), (np.int64, np.uint64)):
        a = integers(kind)
        a = a[a != np.iinfo(kind).min]
        b, c = np.sort([rng(7).permutation(a), rng(8).permutation(a)], axis=0)
        yield _case(way, "min", "min(a, b)", (a, b), np.minimum)
        yield _case(way, "max", "max(a, b)", (a, b), np.maximum)
        yield _case(way, "clamp", "clamp(a, b, c)", (a, b, c), np.clip)
        yield _case(way, "abs", f"JOIN(as_, LANES_OF({C_TYPES[np.dtype(unsigned)]}))(abs(a))", (a,), np.abs, unsigned)


def _of_bits(way: Way) -> Iterator[Case]:
    def counted(v: Array) -> Array:
        bytes_of = np.ascontiguousarray(v).view(np.uint8).reshape(len(v), -1)
        counts: Array = np.unpackbits(bytes_of, axis=1).sum(axis=1, dtype=v.dtype)
        return counts

    def upper(a: Array, b: Array) -> Array:
        return np.array([p * q >> 64 for p, q in zip(a.tolist(), b.tolist(), strict=True)], np.uint64)

    a = integers(np.uint64)
    yield _case(way, "mul_hi", "mul_hi(a, b)", (a, rng(9).permutation(a)), upper, scalars=True)
    for v in (a, a.astype(np.uint32)):
        yield _case(way, "popcount", "popcount(a)", (v,), counted, scalars=True)
        yield _case(
            way, "lowest", "LOWEST_BIT(a)", (v[v != 0],), lambda v: counted((v & -v) - v.dtype.type(1)), scalars=True
        )


def _conversions(way: Way) -> Iterator[Case]:
    """To reals and among them, rounded once, and to integers, toward 0, as NumPy's own."""
    real = way.real
    highest, integer = (31, np.int32) if real is np.float32 else (63, np.int64)
    x, y = integers(np.int32), integers(np.int64)
    with np.errstate(all="ignore"):
        a, b, c = (v.astype(real) for v in ties(np.float32))
        near = np.concatenate([a * b + c, patterns(real)])[: COUNT // 2]  # in float64 near ties of float32
    z = np.concatenate([patterns(real), spread(-2, 30, real, 10), (x / 2).astype(real)])
    z, w = (rng(bits).permutation(z[(z >= -(2.0**bits)) & (z < 2.0**bits)])[: COUNT // 2] for bits in (31, highest))
    for name, expression, v, kind in (
        ("to_real", "TO_REALS(a)", x, real),
        ("to_real", "TO_REALS(a)", x.view(np.uint32), real),
        ("to_real", "TO_REALS(a)", y, real),
        ("to_float", "TO_LANES(a, float)", x, np.float32),
        ("to_float", "TO_LANES(a, float)", near, np.float32),
        ("to_long", "TO_LONGS(a)", x, np.int64),
        ("to_uint", "TO_LANES(a, uint)", x, np.uint32),
        ("to_fixed", "TO_FIXEDS(a)", y >> (63 - highest), np.int32),
        ("to_int", "TO_INTS(a)", y >> (63 - highest), integer),
        ("to_fixed", "TO_FIXEDS(a)", z, np.int32),
        ("to_int", "TO_INTS(a)", w, integer),
    ):
        yield _case(way, name, expression, (v,), np.asarray, kind)


def _moves(way: Way, n: int) -> Case:
    """Return the case of vectors of n, loaded from any place and stored at any place of a row."""

    def define(places: Array, values: Array) -> Array:
        output = np.full(values.nbytes, UNWRITTEN, np.uint8).view(values.dtype).reshape(values.shape)
        lane = np.arange(n)
        shuffled = np.take_along_axis(values, places[:, None] % 4 + lane, axis=1)
        np.put_along_axis(output, places[:, None] // 4 + lane, shuffled, axis=1)
        return output

    rows = 1024
    places = rng(n).integers(0, 16, rows).astype(np.int32)
    values = np.arange(1, rows * (n + 4) + 1).astype(way.real).reshape(rows, n + 4)
    text = signature(f"move_{n}", ("places", "from"), (places, values), way.real) + MOVE.format(n=n)
    return Case(
        f"move_{n}", f"loads and stores of {n}", text, (places, values), define, _head(), way.options, way.lanes
    )


def _atomics(way: Way) -> Case:
    """Return the case of atomic operations by work-items that run at the same time: each gets what the others have left,
    and nothing is lost."""

    def define(x: Array, scratch: Array) -> Array:
        start = int(np.full(4, UNWRITTEN, np.uint8).view(np.int32)[0])
        expected = np.full((len(x), 4), start + 1, np.int64)
        expected[:, 3] = start
        expected[0, 3] += int(x.sum())
        return expected.astype(np.int32)

    inputs = rng(11).integers(1, 1000, 1 << 17).astype(np.int32), np.zeros(1 << 17, np.int32)
    title = "atomic operations on global memory"
    return Case("count", title, COUNT_TEXT, inputs, define, _head(), way.options, way.lanes)
