"""Small kernels, each of one construct of OpenCL C that the renderer's kernels rely on, with what they have to write."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...pipeline.bare_kernel import Grid
from .case import Case
from .operands import rng

ROWS, GROUP = 1024, 64
TYPES = {np.dtype(name): c for name, c in (("i4", "int"), ("u4", "uint"), ("f4", "float"), ("f8", "double"))}
TYPES |= {np.dtype(name): c for name, c in (("i8", "long"), ("u8", "ulong"), ("u1", "uchar"), ("i2", "short"))}
Define = Callable[..., Array]


def construct(
    name: str,
    title: str,
    body: str,
    inputs: Sequence[Array],
    define: Define,
    head: str = "",
    out: str = "",
    **more: Any,
) -> Case:
    """Return a case whose kernel has arguments a, b, c, ... and out, and the item's number i. out: the C type of what it
    writes, that of a by default."""
    given = [np.ascontiguousarray(v) for v in inputs]
    kinds = [TYPES[v.dtype] for v in given]
    arguments = ", ".join(f"global const {kind} *{v}" for kind, v in zip(kinds, "abcd", strict=False))
    lines = "\n".join(f"    {line}" if line else "" for line in body.strip("\n").splitlines())
    text = f"kernel void {name}({arguments}, global {out or kinds[0]} *out)\n{{\n"
    text += f"    int i = get_global_id(0);\n{lines}\n}}\n"
    kind = next(kind for kind, c in TYPES.items() if c == out) if out else given[0].dtype
    return Case(name, title, text, tuple(given), lambda *v: np.asarray(define(*v)).astype(kind), head, **more)


def ints(seed: int, low: int, high: int, *width: int) -> Array:
    """Return ROWS rows of int32 from low to high - 1."""
    return rng(20, seed).integers(low, high, (ROWS, *width)).astype(np.int32)


def reals(seed: int, *width: int, kind: Any = np.float32) -> Array:
    """Return ROWS rows of numbers of both signs between 2^-20 and 2^20."""
    own = rng(21, seed)
    size = np.ldexp(own.uniform(1.0, 2.0, (ROWS, *width)), own.integers(-20, 20, (ROWS, *width)))
    return (size * own.choice([-1.0, 1.0], (ROWS, *width))).astype(kind)


def _wrapped(v: Array) -> Array:
    return v.astype(np.int64).astype(np.int32)


def loops() -> Iterator[Case]:
    """Loops and branches in which work-items, or lanes of a vector, go different ways."""
    count = ints(1, 0, 30)
    yield construct(
        "divergent_loop",
        "a loop of another length in each work-item",
        "int sum = 0;\nfor (int k = 0; k < a[i]; ++k)\n    sum += k * k;\nout[i] = sum;",
        [count],
        lambda a: np.array([sum(k * k for k in range(n)) for n in a.tolist()], np.int32),
        group=GROUP,
    )
    table = ints(2, 0, 100, 16)
    yield construct(
        "break_and_continue",
        "a loop that work-items leave, and steps that they skip, at different times",
        """
int sum = 0;
for (int k = 0; k < 16; ++k) {
    int v = b[16 * i + k];
    if (v % 3 == 0)
        continue;
    if (v > a[i])
        break;
    sum += v;
}
out[i] = sum;
""",
        [ints(3, 20, 100), table],
        lambda a, b: np.array([_until(*row) for row in zip(a.tolist(), b.tolist(), strict=True)], np.int32),
        group=GROUP,
    )
    yield construct(
        "nested_loops",
        "loops in loops, all of different lengths",
        "int sum = 0;\nfor (int k = 0; k < a[i]; ++k)\n    for (int j = k; j < b[i]; j += 2)\n        sum += j - 2 * k;\nout[i] = sum;",
        [ints(4, 0, 12), ints(5, 0, 12)],
        lambda a, b: np.array(
            [sum(j - 2 * k for k in range(n) for j in range(k, m, 2)) for n, m in zip(a, b, strict=True)], np.int32
        ),
        group=GROUP,
    )
    yield construct(
        "while_halving",
        "a loop of which the end is found as it runs",
        "uint v = (uint)a[i];\nint steps = 0;\nwhile (v != 1) {\n    v = v & 1 ? 3 * v + 1 : v >> 1;\n    ++steps;\n}\nout[i] = steps;",
        [ints(6, 1, 1000)],
        lambda a: np.array([_collatz(n) for n in a.tolist()], np.int32),
        group=GROUP,
    )
    yield construct(
        "early_return",
        "work-items that return before the others",
        "out[i] = -1;\nif (a[i] % 2)\n    return;\nfor (int k = 0; k < 8; ++k)\n    if (a[i] == 2 * k)\n        return;\nout[i] = a[i] * 3;",
        [ints(7, 0, 40)],
        lambda a: np.where((a % 2 == 1) | (a < 16), -1, 3 * a).astype(np.int32),
        group=GROUP,
    )
    yield construct(
        "switch_falls",
        "a switch that falls through",
        "int v = 0;\nswitch (a[i]) {\ncase 0: v += 1;\ncase 1: v += 10; break;\ncase 2: v += 100;\ndefault: v += 1000;\n}\nout[i] = v;",
        [ints(8, 0, 5)],
        lambda a: np.array([11, 10, 1100, 1000, 1000], np.int32)[a],
        group=GROUP,
    )
    yield from _lane_loops()


def _until(most: int, row: list[int]) -> int:
    total = 0
    for v in row:
        if v % 3 == 0:
            continue
        if v > most:
            break
        total += v
    return total


def _collatz(n: int) -> int:
    steps = 0
    while n != 1:
        n, steps = (3 * n + 1 if n % 2 else n // 2), steps + 1
    return steps


def _lane_loops() -> Iterator[Case]:
    for lanes in (4, 8, 16):
        yield construct(
            f"lanes_until_all_{lanes}",
            f"a loop over vectors of {lanes} that goes on until no lane does",
            f"""
int{lanes} left = vload{lanes}(i, a), sum = 0, active = left > 0;
while (any(active)) {{
    sum += active & left;
    left -= active & 1;
    active = left > 0;
}}
vstore{lanes}(sum, i, out);
""",
            [ints(9, 0, 20)],
            lambda a: a * (a + 1) // 2,
            lanes=lanes,
        )
    yield construct(
        "claim_by_bits",
        "a loop over the bits of a mask, with a flag that some lanes set",
        """
uint mask = (uint)a[i];
int owner = -1, best = 1 << 30;
while (mask) {
    int bit = 31 - (int)clz(mask & -mask);
    mask &= mask - 1;
    int depth = b[32 * i + bit];
    if (depth < best || (depth == best && bit > owner)) {
        best = depth;
        owner = bit;
    }
    if (best == 0)
        break;
}
out[i] = owner;
""",
        [ints(10, -(2**31), 2**31), ints(11, 0, 9, 32)],
        lambda a, b: np.array(
            [_owner(int(m) & 0xFFFFFFFF, row) for m, row in zip(a, b.tolist(), strict=True)], np.int32
        ),
        group=GROUP,
    )


def _owner(mask: int, depths: list[int]) -> int:
    owner, best = -1, 1 << 30
    for bit in range(32):
        if mask >> bit & 1 and best > 0 and depths[bit] <= best:
            owner, best = bit, depths[bit]
    return owner


def groups() -> Iterator[Case]:
    """Local memory and barriers."""
    item = "int l = get_local_id(0);\n"
    a = ints(12, -1000, 1000)

    def by_group(work: Callable[[Array], Array]) -> Define:
        return lambda a, *rest: work(a.reshape(-1, GROUP).astype(np.int64)).reshape(-1).astype(np.int32)

    yield construct(
        "reversed_in_group",
        "local memory that another work-item wrote before a barrier",
        f"local int kept[{GROUP}];\n{item}kept[l] = a[i];\nbarrier(CLK_LOCAL_MEM_FENCE);\nout[i] = kept[{GROUP - 1} - l];",
        [a],
        by_group(lambda v: v[:, ::-1]),
        group=GROUP,
    )
    yield construct(
        "prefix_sums",
        "a loop with barriers",
        f"""
local int kept[{GROUP}];
{item}kept[l] = a[i];
for (int step = 1; step < {GROUP}; step *= 2) {{
    barrier(CLK_LOCAL_MEM_FENCE);
    int more = l >= step ? kept[l - step] : 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    kept[l] += more;
}}
out[i] = kept[l];
""",
        [a],
        by_group(lambda v: np.cumsum(v, axis=1)),
        group=GROUP,
    )
    yield construct(
        "groups_apart",
        "local memory of each work-group apart from that of the others",
        f"""
local int kept[{GROUP}];
{item}kept[l] = 0;
for (int k = 0; k < 50; ++k) {{
    barrier(CLK_LOCAL_MEM_FENCE);
    kept[(l + k) % {GROUP}] += a[i];
}}
barrier(CLK_LOCAL_MEM_FENCE);
out[i] = kept[l];
""",
        [a],
        by_group(lambda v: sum(np.roll(v, k, axis=1) for k in range(50))),
        group=GROUP,
    )
    yield construct(
        "loop_to_local_count",
        "a loop with barriers whose length a work-item wrote to local memory",
        f"""
local int count, sum;
{item}if (l == 0) {{
    count = (a[i] & 15) + 1;
    sum = 0;
}}
barrier(CLK_LOCAL_MEM_FENCE);
for (int k = 0; k < count; ++k) {{
    if (l == k)
        sum += a[i];
    barrier(CLK_LOCAL_MEM_FENCE);
}}
out[i] = sum;
""",
        [a],
        by_group(lambda v: np.repeat([[row[: (row[0] & 15) + 1].sum()] for row in v], GROUP, axis=1)),
        group=GROUP,
    )
    yield construct(
        "batches_of_bits",
        "a loop with barriers in which work-items fill words of bits in local memory and then take different steps",
        f"""
local uint words[2];
{item}int left = b[i], found = 0;
for (int k = 0; k < 4; ++k) {{
    if (l < 2)
        words[l] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (a[i] >> k & 1)
        atomic_or(words + l / 32, 1u << l % 32);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int w = 0; w < 2; ++w)
        for (uint bits = words[w]; bits && left > 0; bits &= bits - 1, --left)
            found += 32 * w + 31 - (int)clz(bits & -bits);
    barrier(CLK_LOCAL_MEM_FENCE);
}}
out[i] = found;
""",
        [ints(13, 0, 16), ints(14, 0, 60)],
        lambda a, b: np.concatenate(
            [_batches(*pair) for pair in zip(a.reshape(-1, GROUP), b.reshape(-1, GROUP), strict=True)]
        ),
        group=GROUP,
    )
    yield construct(
        "local_atomics",
        "atomic operations on local memory",
        f"""
local int sum, least, most;
{item}if (l == 0) {{
    sum = 0;
    least = 1 << 30;
    most = -(1 << 30);
}}
barrier(CLK_LOCAL_MEM_FENCE);
atomic_add(&sum, a[i]);
atomic_min(&least, a[i]);
atomic_max(&most, a[i]);
barrier(CLK_LOCAL_MEM_FENCE);
out[i] = sum ^ least ^ most;
""",
        [a],
        by_group(
            lambda v: np.repeat(v.sum(1) ^ v.min(1) ^ v.max(1), GROUP).reshape(v.shape),
        ),
        group=GROUP,
    )


def _batches(bits: Array, left: Array) -> Array:
    order = [item for k in range(4) for item in np.flatnonzero(bits >> k & 1).tolist()]
    return np.array([sum(order[: max(n, 0)]) for n in left.tolist()], np.int32)


def vectors() -> Iterator[Case]:
    """Vectors: select, swizzles, unions, loads and stores."""
    a, b, c = ints(15, -50, 50, 4), ints(16, -50, 50, 4), ints(17, -2, 2, 4)
    four = "int4 x = vload4(i, a), y = vload4(i, b);\n"
    for name, expression, define in (
        ("ternary", "x > y ? x : -y", lambda a, b: np.where(a > b, a, -b)),
        ("selected", "select(x, y, x > 5)", lambda a, b: np.where(a > 5, b, a)),
        ("comparison_is_minus_1", "(x == y) + 2 * (x < y)", lambda a, b: -(a == b).astype(np.int32) - 2 * (a < b)),
        (
            "logic",
            "!x + (x && y) + (x || y)",
            lambda a, b: -(a == 0).astype(np.int32) - ((a != 0) & (b != 0)) - ((a != 0) | (b != 0)),
        ),
        ("swizzled", "(int4)(x.wz, y.yx)", lambda a, b: np.stack([a[:, 3], a[:, 2], b[:, 1], b[:, 0]], 1)),
        (
            "halves",
            "(int4)(x.lo + y.hi, x.odd - y.even)",
            lambda a, b: np.concatenate([a[:, :2] + b[:, 2:], a[:, 1::2] - b[:, ::2]], 1),
        ),
        (
            "bitselected",
            "bitselect(x, y, (int4)(0xF0F0F0F0))",
            lambda a, b: _wrapped((a & 0x0F0F0F0F) | (b & ~0x0F0F0F0F)),
        ),
        (
            "shuffled",
            "shuffle2(x, y, (uint4)(7, 0, 5, 2))",
            lambda a, b: np.stack([b[:, 3], a[:, 0], b[:, 1], a[:, 2]], 1),
        ),
        ("any_and_all", "(int4)(any(x > y), all(x > y), any(x == y), all(x < 60))", lambda a, b: _any_and_all(a, b)),
    ):
        yield construct(name, f"vectors: {expression}", f"{four}vstore4({expression}, i, out);", [a, b], define)
    yield construct(
        "lanes_of_a_union",
        "a vector whose elements are read and written through a union, by a variable",
        "union { int4 all; int each[4]; } v = {vload4(i, a)};\nfor (int k = 0; k < 4; ++k)\n    v.each[(k + b[4 * i]) & 3] += k;\nvstore4(v.all, i, out);",
        [a, c],
        lambda a, b: a + (np.arange(4) - b[:, :1]) % 4,
    )
    yield construct(
        "vector_of_3",
        "vload3 and vstore3, which lie close together",
        "vstore3(vload3(i, a).zxy, i, out);",
        [ints(18, -99, 99, 3)],
        lambda a: a[:, [2, 0, 1]],
    )
    yield construct(
        "unaligned_vectors",
        "vectors of 4 at places that suit one number only",
        "vstore4(vload4(0, a + 7 * i + (b[i] & 3)) + 1, 0, out + 7 * i + (b[i] >> 2 & 3));",
        [ints(19, 0, 99, 7), ints(20, 0, 16)],
        lambda a, b: _moved(a, b),
    )
    yield construct(
        "wide_masks",
        "masks of 16 lanes, packed into bits",
        "int16 m = vload16(i, a) > 0;\nuint bits = 0;\nfor (int k = 0; k < 16; ++k)\n    bits |= (uint)(((int *)&m)[k] & 1 << k);\nout[i] = (int)bits;",
        [ints(21, -5, 5, 16)],
        lambda a: ((a > 0) << np.arange(16)).sum(axis=1).astype(np.int32),
    )


def _any_and_all(a: Array, b: Array) -> Array:
    columns = (a > b).any(1), (a > b).all(1), (a == b).any(1), (a < 60).all(1)
    return np.stack(columns, axis=1).astype(np.int32)


def _moved(a: Array, b: Array) -> Array:
    out = np.full(a.shape, np.full(4, 0xA5, np.uint8).view(np.int32)[0], np.int32)
    for row, shift in enumerate(b.tolist()):
        out[row, (shift >> 2) + np.arange(4)] = a[row, (shift & 3) + np.arange(4)] + 1
    return out


def all_cases(double: bool = True) -> list[Case]:
    """Return all cases. double: whether with those that need float64."""
    from .constructs_of_values import memory, values

    found = [*loops(), *groups(), *vectors(), *values(), *memory()]
    return [case for case in found if double or not case.double]


GRID_2D = Grid((32, 32), (8, 4), (3, 5))
