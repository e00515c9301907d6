"""Small kernels of single constructs: loops and branches in which work-items go different ways."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .case import Case
from .construct import construct, ints


def loops() -> Iterator[Case]:
    """Loops and branches in which work-items, or lanes of a vector, go different ways."""
    count = ints(1, 0, 30)
    yield construct(
        "divergent_loop",
        "a loop of another length in each work-item",
        "int sum = 0;\nfor (int k = 0; k < a[i]; ++k)\n    sum += k * k;\nout[i] = sum;",
        [count],
        lambda a: np.array([sum(k * k for k in range(n)) for n in a.tolist()], np.int32),
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
    )
    yield construct(
        "nested_loops",
        "loops in loops, all of different lengths",
        """
int sum = 0;
for (int k = 0; k < a[i]; ++k)
    for (int j = k; j < b[i]; j += 2)
        sum += j - 2 * k;
out[i] = sum;
""",
        [ints(4, 0, 12), ints(5, 0, 12)],
        lambda a, b: np.array(
            [sum(j - 2 * k for k in range(n) for j in range(k, m, 2)) for n, m in zip(a, b, strict=True)], np.int32
        ),
    )
    yield construct(
        "while_halving",
        "a loop of which the end is found as it runs",
        """
uint v = (uint)a[i];
int steps = 0;
while (v != 1) {
    v = v & 1 ? 3 * v + 1 : v >> 1;
    ++steps;
}
out[i] = steps;
""",
        [ints(6, 1, 1000)],
        lambda a: np.array([_collatz(n) for n in a.tolist()], np.int32),
    )
    yield construct(
        "early_return",
        "work-items that return before the others",
        """
out[i] = -1;
if (a[i] % 2)
    return;
for (int k = 0; k < 8; ++k)
    if (a[i] == 2 * k)
        return;
out[i] = a[i] * 3;
""",
        [ints(7, 0, 40)],
        lambda a: np.where((a % 2 == 1) | (a < 16), -1, 3 * a).astype(np.int32),
    )
    yield construct(
        "switch_falls",
        "a switch that falls through",
        """
int v = 0;
switch (a[i]) {
case 0: v += 1;
case 1: v += 10; break;
case 2: v += 100;
default: v += 1000;
}
out[i] = v;
""",
        [ints(8, 0, 5)],
        lambda a: np.array([11, 10, 1100, 1000, 1000], np.int32)[a],
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
    )


def _owner(mask: int, depths: list[int]) -> int:
    owner, best = -1, 1 << 30
    for bit in range(32):
        if mask >> bit & 1 and best > 0 and depths[bit] <= best:
            owner, best = bit, depths[bit]
    return owner
