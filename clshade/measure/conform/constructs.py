"""Small kernels of single constructs that the renderer's kernels rely on, with what they have to write: those at which a
runtime failed, and those that no golden scene reaches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from ...base.arrays import Array
from .case import Case, signature
from .operands import integers, rng

ROWS = 1024
PAIR = "typedef struct { int x, y; } pair;\nint changed(pair p) { p.y += 1; return p.y; }\n"
LOOP = """
    int sum = 0;
    for (int k = 0; k < a[i]; ++k)
        sum += k * k;
    out[i] = sum;
"""
MASKS = """
    int16 m = vload16(i, a) > 0;
    uint bits = 0;
    for (int k = 0; k < 16; ++k)
        bits |= (uint)(((int *)&m)[k] & 1 << k);
    out[i] = (int)bits;
"""
ARGUMENT = """
    pair p = {a[i], b[i]};
    int y = changed(p);
    out[i] = 1000 * y + p.y;
"""
COMPARISONS = "(a[i] < b[i]) + 2 * (a[i] <= b[i]) + 4 * (a[i] == b[i]) + 8 * (a[i] != b[i]) + 16 * !(a[i] >= b[i])"


def cases() -> list[Case]:
    """Loops, masks, structs, and expressions: shifts, conversions, sums, zeros, denormals and NaN."""
    a, b, half = _ints(60, -100, 100), _ints(61, 0, 100), (_ints(43, -(2**22), 2**22) / 32).astype(np.float32)
    tiny = np.ldexp(1.0 + _ints(44, 0, 2**23) / 2**23, _ints(45, -149, -127)).astype(np.float32)
    longs, one = integers(np.int64)[:ROWS], np.float32(1.0)
    special = list(product([0.0, -0.0, 1.0, -2.0, np.inf, -np.inf, np.nan], repeat=2))
    pairs = np.resize(np.array(special, np.float32), (ROWS, 2)).T
    expressions: list[tuple[str, str, Sequence[Array], Callable[..., Array]]] = [
        ("long_shifts", "a[i] >> b[i]", [longs, _ints(33, 0, 64)], lambda a, b: a >> b.astype(np.int64)),
        ("converts_down", "convert_int_rtn(a[i])", [half], lambda a: np.floor(a).astype(np.int32)),
        ("rounds_longs", "(float)a[i]", [longs], lambda a: a.astype(np.float32)),
        ("zeros_have_signs", "1.0f / (a[i] * 0.0f)", [half], lambda a: one / (a * np.float32(0.0))),
        ("not_reassociated", "(a[i] + b[i]) - a[i]", [half, tiny + half[::-1]], lambda a, b: (a + b) - a),
        ("denormals", "a[i] * 0.5f", [tiny], lambda a: a * np.float32(0.5)),
        ("comparisons", COMPARISONS, list(pairs), _compared),
    ]
    return [
        _case("divergent_loop", LOOP, [_ints(1, 0, 30)], lambda a: a * (a - 1) * (2 * a - 1) // 6),
        _case(
            "wide_masks", MASKS, [_ints(21, -5, 5, 16)], lambda a: ((a > 0) << np.arange(16)).sum(1).astype(np.int32)
        ),
        _case("argument_by_value", ARGUMENT, [a, b], lambda a, b: 1000 * (b + 1) + b, PAIR),
        *(_case(name, f"    out[i] = {value};\n", inputs, define) for name, value, inputs, define in expressions),
    ]


def _case(name: str, body: str, inputs: Sequence[Array], define: Callable[..., Array], head: str = "") -> Case:
    """Return a case whose kernel has arguments a, b and out, of the type that `define` returns, and the item's number i."""
    inputs = tuple(np.ascontiguousarray(v) for v in inputs)
    with np.errstate(all="ignore"):
        kind = define(*inputs).dtype
    text = f"{signature(name, 'ab', inputs, kind)}\n{{\n    int i = get_global_id(0);\n{body}}}\n"
    return Case(name, " ".join(body.split()), text, inputs, define, head)


def _ints(seed: int, low: int, high: int, *width: int) -> Array:
    """Return ROWS rows of int32 from low to high - 1."""
    return rng(20, seed).integers(low, high, (ROWS, *width)).astype(np.int32)


def _compared(a: Array, b: Array) -> Array:
    bits: Array = (a < b) + 2 * (a <= b) + 4 * (a == b) + 8 * (a != b) + 16 * ~(a >= b)
    return bits.astype(np.int32)
