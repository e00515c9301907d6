"""Each operation of kernels/operations.clh against its definition, in exact integers or in NumPy: the compiler's own, and
the runtime's function that it stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array, Bools
from ...pipeline.features import COMPILED
from .case import UNWRITTEN, Case
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
kernel void {name}(global const int *places, global const {kind} *from, global {kind} *out)
{{
    FIRST;
    EACH {{
        int place = places[i + lane] % 4, shift = places[i + lane] / 4;
        {kind} own[{n} + 4];
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
    """An expression of lanes a, b, c and d, and of the type `kind`; what its value is, and an intermediate result."""

    kind: str
    expression: str
    define: Callable[..., Array]
    between: Callable[..., Array] | None = None


def kernel(name: str, kinds: str, out: str, operations: Sequence[Operation]) -> str:
    """Return a kernel that writes a column for each operation. kinds: types of a, b, c, d. Lanes are loaded and stored
    number by number, neither by what is tested nor by functions of the runtime."""
    inputs = list(zip("abcd", kinds.split(), strict=False))
    lines = [f"LANES_IN({kind}) {v}_; EACH {v}_.each[lane] = {v}s[i + lane];" for v, kind in inputs]
    lines += [f"LANES_OF({kind}) {v} = {v}_.all;" for v, kind in inputs]
    for k, (kind, expression, *_) in enumerate(operations):
        write = f"EACH out[{len(operations)} * (i + lane) + {k}] = v.each[lane];"
        lines.append(f"{{ LANES_IN({kind}) v = {{{expression}}}; {write} }}")
    return _whole(name, inputs, out, lines)


def scalar_kernel(name: str, kinds: str, out: str, operations: Sequence[Operation]) -> str:
    """Return the same of numbers instead of lanes."""
    inputs = list(zip("abcd", kinds.split(), strict=False))
    lines = [f"EACH {{ {' '.join(f'{kind} {v} = {v}s[i + lane];' for v, kind in inputs)}"]
    for k, (kind, expression, *_) in enumerate(operations):
        lines.append(f"    out[{len(operations)} * (i + lane) + {k}] = ({kind})({expression});")
    return _whole(name, inputs, out, [*lines, "}"])


def _whole(name: str, inputs: Sequence[tuple[str, str]], out: str, lines: Sequence[str]) -> str:
    arguments = "".join(f"global const {kind} *{v}s, " for v, kind in inputs)
    body = "\n    ".join(["FIRST;", *lines])
    return f"kernel void {name}({arguments}global {out} *out)\n{{\n    {body}\n}}\n"


def _case(
    way: Way,
    name: str,
    title: str,
    kinds: str,
    out: tuple[str, Any],
    operations: Sequence[Operation],
    inputs: Sequence[Array],
    write: Callable[..., str] = kernel,
    allowed: Callable[..., Bools] | None = None,
) -> Case:
    """Return the case of some operations of the same inputs. out: the C type and the NumPy type of the results."""

    def define(*given: Array) -> Array:
        return np.stack([op.define(*given).astype(out[1]) for op in operations], axis=1)

    def between(*given: Array) -> Array:
        return np.stack([(op.between or op.define)(*given).astype(out[1]) for op in operations], axis=1)

    def alone(column: int) -> Case:
        return _case(way, name, operations[column].expression, kinds, out, [operations[column]], inputs, write, allowed)

    words = tuple(op.expression for op in operations)
    text = write(name, kinds, out[0], operations)
    way_of: dict[str, Any] = {
        "options": way.options,
        "lanes": way.lanes,
        "allowed": allowed,
        "between": between if any(op.between for op in operations) else None,
    }
    return Case(name, title, text, tuple(inputs), define, HEAD, words, alone if len(words) > 1 else None, **way_of)


def _ordered(a: Array, b: Array, c: Array) -> Bools:
    """Return where clamp(a, b, c) is defined."""
    found: Bools = (a == a) & (b <= c)
    return found


def _first(count: int, define: Callable[..., Array]) -> Callable[..., Array]:
    """Return a definition that takes the first `count` inputs."""
    return lambda *v: define(*v[:count])


OF_REALS = {"fabs": np.abs, "floor": np.floor, "ceil": np.ceil, "rint": np.rint}
OF_PAIRS = {"fmin": np.fmin, "fmax": np.fmax}
ARITHMETIC = {
    "a + b": lambda a, b, c: a + b,
    "a - b": lambda a, b, c: a - b,
    "a * b": lambda a, b, c: a * b,
}


@cache
def quiet_operands(real: Any) -> tuple[Array, Array, Array]:
    """Return a, b and c of all kinds: NaN is quiet, of two zeros a and b either both are negative or none."""
    own = rng(6)
    a, b, c = (np.where(np.isnan(v), real(np.nan), v) for v in factors(real))
    b, c = np.where(own.random(len(a)) < 0.1, a, b), np.where(own.random(len(a)) < 0.1, -a, c)
    return a, np.where((a == 0.0) & (b == 0.0), a, b), c


def _reals(way: Way) -> Iterator[Case]:
    real, out = way.real, ("REAL", way.real)
    given, three = factors(real), "REAL REAL REAL"
    once = Operation("REAL", "fma(a, b, c)", lambda a, b, c: each(fused, real, a, b, c))
    yield _case(way, "fused", "a * b + c, rounded once", three, out, [once], given)
    table = [Operation("REAL", text, define) for text, define in ARITHMETIC.items()]
    table.append(Operation("REAL", "a * b + c", lambda a, b, c: a * b + c, lambda a, b, c: a * b))  # rounded twice
    yield _case(way, "arithmetic", "operators, each rounded", three, out, table, given)
    a, b, c = quiet_operands(real)
    table = [Operation("REAL", f"{name}(a)", _first(1, define)) for name, define in OF_REALS.items()]
    table += [Operation("REAL", f"{name}(a, b)", define) for name, define in OF_PAIRS.items()]
    yield _case(way, "of_reals", "functions of reals", "REAL REAL", out, table, (a, b))
    table = [Operation("REAL", "a / b", np.divide), Operation("REAL", "sqrt(a)", _first(1, np.sqrt))]
    divided = _case(way, "divided", "division and roots", "REAL REAL", out, table, given[:2])
    yield replace(divided, divides=real is np.float32)
    ordered = _ordered(a, b, c)
    a, b, c = (np.where(v == 0.0, real(0.0), v)[ordered] for v in (a, b, c))
    clamp = [Operation("REAL", "clamp(a, b, c)", np.clip)]
    yield _case(way, "clamp_reals", "clamp of reals", three, out, clamp, (a, b, c), allowed=_ordered)


def _integers(way: Way, name: str, kind: Any) -> Case:
    a = integers(kind)
    a = a[a != np.iinfo(kind).min]
    b, c = np.sort([rng(7).permutation(a), rng(8).permutation(a)], axis=0)
    table = [
        Operation(name, "min(a, b)", lambda a, b, c: np.minimum(a, b)),
        Operation(name, "max(a, b)", lambda a, b, c: np.maximum(a, b)),
        Operation(name, "clamp(a, b, c)", np.clip),
        Operation(f"u{name}", f"JOIN(as_, LANES_OF(u{name}))(abs(a))", lambda a, b, c: np.abs(a)),
    ]
    kinds, title = f"{name} {name} {name}", f"functions of {name}"
    return _case(way, f"of_{name}", title, kinds, (name, kind), table, (a, b, c), allowed=_ordered)


def _bits(way: Way) -> Case:
    def counted(v: Array) -> Array:
        bytes_of = np.ascontiguousarray(v).view(np.uint8).reshape(len(v), -1)
        found: Array = np.unpackbits(bytes_of, axis=1).sum(axis=1, dtype=np.uint64)
        return found

    def lowest(v: Array) -> Array:
        return counted((v & -v) - v.dtype.type(1))

    def upper(a: Array, b: Array) -> Array:
        return np.array([p * q >> 64 for p, q in zip(a.tolist(), b.tolist(), strict=True)], np.uint64)

    x = integers(np.uint64)
    y = rng(9).permutation(x)
    kept = (x != 0) & (y & np.uint64(0xFFFFFFFF) != 0)
    x, y = x[kept], y[kept]
    table = [
        Operation("ulong", "popcount(a)", lambda a, b: counted(a)),
        Operation("ulong", "popcount((uint)a)", lambda a, b: counted(a.astype(np.uint32))),
        Operation("ulong", "mul_hi(a, b)", upper),
        Operation("ulong", "LOWEST_BIT(a)", lambda a, b: lowest(a)),
        Operation("ulong", "LOWEST_BIT((uint)b)", lambda a, b: lowest(b.astype(np.uint32))),
    ]
    return _case(way, "of_bits", "bits", "ulong ulong", ("ulong", np.uint64), table, (x, y), scalar_kernel)


def _conversions(way: Way) -> Iterator[Case]:
    real = way.real
    with np.errstate(all="ignore"):
        a, b, c = (v.astype(real) for v in ties(np.float32))
        z = np.concatenate([a * b + c, patterns(real)])[: COUNT // 2]  # in float64 near ties of float32
    x, y = integers(np.int32)[: len(z)], integers(np.int64)[: len(z)]

    def of(kind: Any) -> Callable[[Array], Array]:
        return lambda v: each(nearest, kind, v, np.zeros_like(v))

    table = [
        Operation("REAL", "TO_REALS(a)", lambda a, b, c, d: of(real)(a)),
        Operation("REAL", "TO_REALS(b)", lambda a, b, c, d: of(real)(b)),
        Operation("REAL", "TO_REALS(c)", lambda a, b, c, d: of(real)(c)),
    ]
    kinds, given = "int uint long REAL", [x, x.view(np.uint32), y, z]
    yield _case(way, "to_reals", "conversions to reals, rounded once", kinds, ("REAL", real), table, given)
    table = [
        Operation("float", "TO_LANES(a, float)", lambda a, b, c, d: of(np.float32)(a)),
        Operation("float", "TO_LANES(d, float)", lambda a, b, c, d: each(rounded, np.float32, d)),
    ]
    yield _case(way, "to_floats", "conversions to float32, rounded once", kinds, ("float", np.float32), table, given)
    most = 31 if real is np.float32 else 63
    x, y = integers(np.int32), integers(np.int64) >> (63 - most)
    z = np.concatenate([patterns(real), spread(-2, 30, real, 10), (x / 2).astype(real)])
    z, w = (rng(bits).permutation(z[(z >= -(2.0**bits)) & (z < 2.0**bits)])[: COUNT // 2] for bits in (31, most))
    table = [
        Operation("long", "TO_LONGS(a)", lambda a, b, c, d: a),
        Operation("uint", "TO_LANES(a, uint)", lambda a, b, c, d: a.view(np.uint32)),
        Operation("int", "TO_FIXEDS(b)", lambda a, b, c, d: b.astype(np.int32)),
        Operation("INTEGER", "TO_INTS(b)", lambda a, b, c, d: b),
        Operation("int", "TO_FIXEDS(c)", lambda a, b, c, d: np.trunc(c)),
        Operation("INTEGER", "TO_INTS(d)", lambda a, b, c, d: np.trunc(d)),
    ]
    given = [x[: len(z)], y[: len(z)], z, w]
    yield _case(way, "to_integers", "conversions toward 0", "int long REAL REAL", ("long", np.int64), table, given)


def _moves(way: Way) -> Iterator[Case]:
    """Vectors of 4, and as many as there are lanes, loaded from any place and stored at any place of a row."""
    reals, whole = (np.dtype(way.real), np.dtype(np.int64 if way.real is np.float64 else np.int32))
    sorts = [("REAL", reals, 4), ("int", np.dtype(np.int32), 4)]
    if way.lanes > 1:
        sorts += [("REAL", reals, way.lanes), ("INTEGER", whole, way.lanes)]
    for name, kind, n in dict.fromkeys(sorts):

        def define(places: Array, values: Array, n: int = n) -> Array:
            found = np.full(values.nbytes, UNWRITTEN, np.uint8).view(values.dtype).reshape(values.shape)
            lane = np.arange(n)
            taken = np.take_along_axis(values, places[:, None] % 4 + lane, axis=1)
            np.put_along_axis(found, places[:, None] // 4 + lane, taken, axis=1)
            return found

        rows = 1024
        places = rng(n).integers(0, 16, rows).astype(np.int32)
        values = np.arange(1, rows * (n + 4) + 1).astype(kind).reshape(rows, n + 4)
        own = f"move_{name.lower()}_{n}"
        text = MOVE.format(name=own, kind=name, n=n)
        yield Case(
            own, f"loads and stores of {n}", text, (places, values), define, HEAD, (), None, way.options, way.lanes
        )


def _atomics(way: Way) -> Case:
    """Return the case of atomic operations by work-items that run at the same time: each gets what the others have left,
    and nothing is lost."""

    def define(x: Array, scratch: Array) -> Array:
        start = int(np.full(4, UNWRITTEN, np.uint8).view(np.int32)[0])
        found = np.full((len(x), 4), start + 1, np.int64)
        found[:, 3] = start
        found[0, 3] += int(x.sum())
        return found.astype(np.int32)

    x = rng(11).integers(1, 1000, 1 << 17).astype(np.int32)
    more: dict[str, Any] = {"options": way.options, "lanes": way.lanes, "allowed": lambda x, scratch: scratch == 0}
    return Case("count", "atomic operations on global memory", COUNT_TEXT, (x, np.zeros_like(x)), define, HEAD, **more)


def cases(way: Way) -> list[Case]:
    """Return all cases of a way. Their kernels form one program."""
    found = [*_reals(way), _integers(way, "int", np.int32), _integers(way, "long", np.int64), _bits(way)]
    found += [*_conversions(way), *_moves(way), _atomics(way)]
    return [case.in_groups() for case in found]


def program(found: Sequence[Case]) -> str:
    """Return the text of all kernels of cases with one head."""
    return found[0].source + "".join(case.text for case in found[1:])


def ways(lanes: int, double: bool) -> list[Way]:
    """Return the ways that a device is tested in: with its own number of lanes, and with one."""
    kinds = [np.float32, np.float64] if double else [np.float32]
    counts = dict.fromkeys((lanes, 1))
    return [Way(real, library, count) for real in kinds for count in counts for library in (False, True)]
