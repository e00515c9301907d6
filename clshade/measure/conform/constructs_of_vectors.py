"""Small kernels of single constructs: vectors, their choices, elements, loads and stores."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...base.arrays import Array
from .case import Case
from .construct import Define, construct, ints


def _wrapped(v: Array) -> Array:
    return v.astype(np.int64).astype(np.int32)


def vectors() -> Iterator[Case]:
    """Vectors: select, swizzles, unions, loads and stores."""
    a, b, c = ints(15, -50, 50, 4), ints(16, -50, 50, 4), ints(17, -2, 2, 4)
    four = "int4 x = vload4(i, a), y = vload4(i, b);\n"
    table: tuple[tuple[str, str, Define], ...] = (
        ("ternary", "x > y ? x : -y", lambda a, b: a * (a > b) - b * (a <= b)),
        ("selected", "select(x, y, x > 5)", lambda a, b: b * (a > 5) + a * (a <= 5)),
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
        ("any_and_all", "(int4)(any(x > y), all(x > y), any(x == y), all(x < 60))", _any_and_all),
    )
    for name, expression, define in table:
        yield construct(name, f"vectors: {expression}", f"{four}vstore4({expression}, i, out);", [a, b], define)
    yield construct(
        "lanes_of_a_union",
        "a vector whose elements are read and written through a union, by a variable",
        """
union { int4 all; int each[4]; } v = {vload4(i, a)};
for (int k = 0; k < 4; ++k)
    v.each[(k + b[4 * i]) & 3] += k;
vstore4(v.all, i, out);
""",
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
        """
int16 m = vload16(i, a) > 0;
uint bits = 0;
for (int k = 0; k < 16; ++k)
    bits |= (uint)(((int *)&m)[k] & 1 << k);
out[i] = (int)bits;
""",
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
