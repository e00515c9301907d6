"""Small kernels of single constructs that the renderer's kernels rely on, with what they have to write: those at which a
runtime failed, and those that no golden scene reaches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...pipeline.bare_kernel import Grid
from .case import Case, signature
from .operands import integers, rng

ROWS = 1024
GRID = Grid((32, 32), (8, 4), (3, 5))
PAIR = "typedef struct { int x, y; } pair;\nint changed(pair p) { p.y += 1; return p.y; }\n"


def construct(
    name: str, title: str, body: str, inputs: Sequence[Array], define: Any, head: str = "", **more: Any
) -> Case:
    """Return a case whose kernel has arguments a, b and out, and the item's number i. define: returns an array of the type
    that the kernel writes."""
    inputs = tuple(np.ascontiguousarray(v) for v in inputs)
    lines = "".join(f"    {line}\n" for line in ("int i = get_global_id(0);", *body.strip().splitlines()))
    with np.errstate(all="ignore"):
        kind = define(*inputs).dtype
    text = f"{signature(name, 'ab', inputs, kind)}\n{{\n{lines}}}\n"
    return Case(name, title, text, inputs, define, head, **more)


def ints(seed: int, low: int, high: int, *width: int) -> Array:
    """Return ROWS rows of int32 from low to high - 1."""
    return rng(20, seed).integers(low, high, (ROWS, *width)).astype(np.int32)


def cases() -> list[Case]:
    return [*_items(), *_values()]


def _items() -> Iterator[Case]:
    """What work-items do: loops, masks, structs, ids."""
    a, b = ints(60, -100, 100), ints(61, 0, 100)
    yield construct(
        "divergent_loop",
        "a loop of another length in each work-item",
        "int sum = 0;\nfor (int k = 0; k < a[i]; ++k)\n    sum += k * k;\nout[i] = sum;",
        [ints(1, 0, 30)],
        lambda a: a * (a - 1) * (2 * a - 1) // 6,
    )
    yield construct(
        "wide_masks",
        "masks of 16 lanes, packed into bits",
        "int16 m = vload16(i, a) > 0;\nuint bits = 0;\n"
        "for (int k = 0; k < 16; ++k)\n    bits |= (uint)(((int *)&m)[k] & 1 << k);\nout[i] = (int)bits;",
        [ints(21, -5, 5, 16)],
        lambda a: ((a > 0) << np.arange(16)).sum(axis=1).astype(np.int32),
    )
    yield construct(
        "argument_by_value",
        "a function that changes its own copy of a struct",
        "pair p = {a[i], b[i]};\nint y = changed(p);\nout[i] = 1000 * y + p.y;",
        [a, b],
        lambda a, b: 1000 * (b + 1) + b,
        PAIR,
    )
    yield construct(
        "ids_in_2_dimensions",
        "ids, sizes, groups and offsets in two dimensions",
        """
int x = get_global_id(0) - get_global_offset(0), y = get_global_id(1) - get_global_offset(1);
int at = y * get_global_size(0) + x;
out[at] = a[at] + 100 * (int)get_global_id(0) + 10000 * (int)get_global_id(1) + 1000000 * (int)get_group_id(0)
    + 8000000 * (int)get_group_id(1) + 64000000 * (int)(get_local_id(0) == x % 8 && get_local_id(1) == y % 4
        && get_num_groups(0) == 4 && get_local_size(1) == 4 && get_work_dim() == 2);
""",
        [b],
        _ids,
        grid=GRID,
    )


def _ids(a: Array) -> Array:
    (width, _), (right, up) = GRID.size, GRID.offset or (0, 0)
    y, x = np.divmod(np.arange(len(a), dtype=np.int32), np.int32(width))
    ids: Array = a + 100 * (x + right) + 10000 * (y + up) + 1000000 * (x // 8) + 8000000 * (y // 4) + 64000000
    return ids


def _values() -> Iterator[Case]:
    """Shifts, conversions, sums, zeros, denormals and NaN."""
    half = (ints(43, -(2**22), 2**22) / 32).astype(np.float32)
    tiny = np.ldexp(1.0 + ints(44, 0, 2**23) / 2**23, ints(45, -149, -127)).astype(np.float32)
    longs = integers(np.int64)[:ROWS]
    for name, expression, inputs, define in (
        ("long_shifts", "a[i] >> b[i]", [longs, ints(33, 0, 64)], lambda a, b: a >> b.astype(np.int64)),
        ("converts_down", "convert_int_rtn(a[i])", [half], lambda a: np.floor(a).astype(np.int32)),
        ("rounds_longs", "(float)a[i]", [longs], lambda a: a.astype(np.float32)),
        ("zeros_have_signs", "1.0f / (a[i] * 0.0f)", [half], lambda a: np.float32(1.0) / (a * np.float32(0.0))),
        ("not_reassociated", "(a[i] + b[i]) - a[i]", [half, tiny + half[::-1]], lambda a, b: (a + b) - a),
        ("denormals", "a[i] * 0.5f", [tiny], lambda a: a * np.float32(0.5)),
    ):
        yield construct(name, expression, f"out[i] = {expression};", inputs, define)
    values = [0.0, -0.0, 1.0, -2.0, np.inf, -np.inf, np.nan]
    yield construct(
        "comparisons",
        "comparisons of infinities, NaN and zeros",
        "float x = a[i], y = b[i];\nout[i] = (x < y) + 2 * (x <= y) + 4 * (x == y) + 8 * (x != y) + 16 * (x > y)\n"
        "    + 32 * !(x >= y) + 64 * (isnan(x) != 0) + 128 * (isfinite(y) != 0);",
        np.resize(np.array(list(product(values, repeat=2)), np.float32), (ROWS, 2)).T,
        _compared,
    )


def _compared(a: Array, b: Array) -> Array:
    tests = a < b, a <= b, a == b, a != b, a > b, ~(a >= b), np.isnan(a), np.isfinite(b)
    bits: Array = (np.stack(tests, axis=1) << np.arange(8)).sum(axis=1).astype(np.int32)
    return bits
