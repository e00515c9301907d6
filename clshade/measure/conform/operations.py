"""Each operation of kernels/operations.clh against its definition, in exact integers or in NumPy: the compiler's own, and
the runtime's function that it stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...pipeline.features import COMPILED
from .case import C_TYPES, GROUP, UNWRITTEN, Case, in_one_program, signature
from .definitions import each, fused, nearest, rounded
from .operands import COUNT, factors, integers, patterns, rng, spread, ties

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
        own = ("-DLIBRARY_OPERATIONS",) if self.library else ()
        return (*(f"-D{name}={value}" for name, value in chosen.items()), "-DLEFT_OUT=0UL", *own)


class Operation(NamedTuple):
    """An expression of lanes a, b and c, and what it is; of inputs (K,) each.

    kind: NumPy type of the result, None: that of a. scalars: whether it is one of numbers instead of lanes.
    """

    name: str
    expression: str
    inputs: tuple[Array, ...]
    define: Callable[..., Array]
    kind: Any = None
    scalars: bool = False


def cases(way: Way) -> list[Case]:
    """Return all cases of a way, built as one program."""
    operations = [*_of_reals(way.real), *_of_integers(), *_of_bits(), *_to_reals(way.real), *_to_integers(way.real)]
    found = [_case(way, operation) for operation in operations]
    found += [*(_moves(way, n) for n in dict.fromkeys((4, way.lanes)) if n > 1), _atomics(way)]
    return in_one_program(found)


def ways(lanes: int, double: bool) -> list[Way]:
    """Return the ways that a device is tested in: with its own number of lanes, and with one."""
    kinds = [np.float32, np.float64] if double else [np.float32]
    counts = dict.fromkeys((lanes, 1))
    return [Way(real, library, count) for real in kinds for count in counts for library in (False, True)]


def _case(way: Way, operation: Operation) -> Case:
    """Lanes are loaded and stored number by number, neither by what is tested nor by functions of the runtime."""
    name, expression, inputs, define, kind, scalars = operation
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
    divides = name in ("quotient_float", "root_float")
    title = f"{expression} of {types[0][1]}"
    return Case(
        name, title, text, inputs, lambda *v: define(*v).astype(kind), HEAD, way.options, way.lanes, None, divides
    )


def _of_reals(real: Any) -> Iterator[Operation]:
    a, b, c = factors(real)
    yield Operation("fused", "fma(a, b, c)", (a, b, c), lambda a, b, c: each(fused, real, a, b, c))
    yield Operation("sum", "a + b", (a, b), np.add)
    yield Operation("difference", "a - b", (a, b), np.subtract)
    yield Operation("product", "a * b", (a, b), np.multiply)
    yield Operation("quotient", "a / b", (a, b), np.divide)
    yield Operation("root", "sqrt(a)", (a,), np.sqrt)
    with np.errstate(all="ignore"):
        product = np.abs(a * b)  # a device that flushes denormals may take it as 0
    normal = ~((product > 0) & (product <= np.finfo(real).tiny))
    yield Operation("rounded_twice", "a * b + c", (a[normal], b[normal], c[normal]), lambda a, b, c: a * b + c)
    a, b, c = quiet_operands(real)
    for name, define in {"fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "rint": np.rint}.items():
        yield Operation(name, f"{name}(a)", (a,), define)
    yield Operation("fmin", "fmin(a, b)", (a, b), np.fmin)
    yield Operation("fmax", "fmax(a, b)", (a, b), np.fmax)
    ordered = (a == a) & (b <= c)
    yield Operation("clamp", "clamp(a, b, c)", tuple(np.where(v == 0, real(0), v)[ordered] for v in (a, b, c)), np.clip)


@cache
def quiet_operands(real: Any) -> tuple[Array, Array, Array]:
    """Return a, b and c of all kinds: NaN is quiet, of two zeros a and b either both are negative or none."""
    own = rng(6)
    a, b, c = (np.where(np.isnan(v), real(np.nan), v) for v in factors(real))
    b, c = np.where(own.random(len(a)) < 0.1, a, b), np.where(own.random(len(a)) < 0.1, -a, c)
    return a, np.where((a == 0.0) & (b == 0.0), a, b), c


def _of_integers() -> Iterator[Operation]:
    for kind, unsigned in ((np.int32, np.uint32), (np.int64, np.uint64)):
        a = integers(kind)
        a = a[a != np.iinfo(kind).min]
        b, c = np.sort([rng(7).permutation(a), rng(8).permutation(a)], axis=0)
        yield Operation("min", "min(a, b)", (a, b), np.minimum)
        yield Operation("max", "max(a, b)", (a, b), np.maximum)
        yield Operation("clamp", "clamp(a, b, c)", (a, b, c), np.clip)
        yield Operation("abs", f"JOIN(as_, LANES_OF({C_TYPES[np.dtype(unsigned)]}))(abs(a))", (a,), np.abs, unsigned)


def _of_bits() -> Iterator[Operation]:
    def counted(v: Array) -> Array:
        bytes_of = np.ascontiguousarray(v).view(np.uint8).reshape(len(v), -1)
        found: Array = np.unpackbits(bytes_of, axis=1).sum(axis=1, dtype=v.dtype)
        return found

    def lowest(v: Array) -> Array:
        return counted((v & -v) - v.dtype.type(1))

    def upper(a: Array, b: Array) -> Array:
        return np.array([p * q >> 64 for p, q in zip(a.tolist(), b.tolist(), strict=True)], np.uint64)

    a = integers(np.uint64)
    yield Operation("mul_hi", "mul_hi(a, b)", (a, rng(9).permutation(a)), upper, scalars=True)
    for v in (a, a.astype(np.uint32)):
        yield Operation("popcount", "popcount(a)", (v,), counted, scalars=True)
        yield Operation("lowest", "LOWEST_BIT(a)", (v[v != 0],), lowest, scalars=True)


def _to_reals(real: Any) -> Iterator[Operation]:
    """Conversions to reals, rounded once."""

    def of(kind: Any) -> Callable[[Array], Array]:
        return lambda v: each(nearest, kind, v, np.zeros_like(v))

    with np.errstate(all="ignore"):
        a, b, c = (v.astype(real) for v in ties(np.float32))
        z = np.concatenate([a * b + c, patterns(real)])[: COUNT // 2]  # in float64 near ties of float32
    x, y = integers(np.int32)[: len(z)], integers(np.int64)[: len(z)]
    for v in (x, x.view(np.uint32), y):
        yield Operation("to_real", "TO_REALS(a)", (v,), of(real), real)
    yield Operation("to_float", "TO_LANES(a, float)", (x,), of(np.float32), np.float32)
    yield Operation("to_float", "TO_LANES(a, float)", (z,), lambda v: each(rounded, np.float32, v), np.float32)


def _to_integers(real: Any) -> Iterator[Operation]:
    """Conversions toward 0."""
    most, kind = (31, np.int32) if real is np.float32 else (63, np.int64)
    x, y = integers(np.int32), integers(np.int64) >> (63 - most)
    z = np.concatenate([patterns(real), spread(-2, 30, real, 10), (x / 2).astype(real)])
    z, w = (rng(bits).permutation(z[(z >= -(2.0**bits)) & (z < 2.0**bits)])[: COUNT // 2] for bits in (31, most))
    for name, expression, v, to in (
        ("to_long", "TO_LONGS(a)", x, np.int64),
        ("to_uint", "TO_LANES(a, uint)", x, np.uint32),
        ("to_fixed", "TO_FIXEDS(a)", y, np.int32),
        ("to_int", "TO_INTS(a)", y, kind),
        ("to_fixed", "TO_FIXEDS(a)", z, np.int32),
        ("to_int", "TO_INTS(a)", w, kind),
    ):
        yield Operation(name, expression, (v,), np.trunc if v.dtype.kind == "f" else np.asarray, to)


def _moves(way: Way, n: int) -> Case:
    """Return the case of vectors of n, loaded from any place and stored at any place of a row."""

    def define(places: Array, values: Array) -> Array:
        found = np.full(values.nbytes, UNWRITTEN, np.uint8).view(values.dtype).reshape(values.shape)
        lane = np.arange(n)
        taken = np.take_along_axis(values, places[:, None] % 4 + lane, axis=1)
        np.put_along_axis(found, places[:, None] // 4 + lane, taken, axis=1)
        return found

    rows = 1024
    places = rng(n).integers(0, 16, rows).astype(np.int32)
    values = np.arange(1, rows * (n + 4) + 1).astype(way.real).reshape(rows, n + 4)
    text = signature(f"move_{n}", ("places", "from"), (places, values), way.real) + MOVE.format(n=n)
    return Case(f"move_{n}", f"loads and stores of {n}", text, (places, values), define, HEAD, way.options, way.lanes)


def _atomics(way: Way) -> Case:
    """Return the case of atomic operations by work-items that run at the same time: each gets what the others have left,
    and nothing is lost."""

    def define(x: Array, scratch: Array) -> Array:
        start = int(np.full(4, UNWRITTEN, np.uint8).view(np.int32)[0])
        found = np.full((len(x), 4), start + 1, np.int64)
        found[:, 3] = start
        found[0, 3] += int(x.sum())
        return found.astype(np.int32)

    inputs = rng(11).integers(1, 1000, 1 << 17).astype(np.int32), np.zeros(1 << 17, np.int32)
    title = "atomic operations on global memory"
    return Case("count", title, COUNT_TEXT, inputs, define, HEAD, way.options, way.lanes)
