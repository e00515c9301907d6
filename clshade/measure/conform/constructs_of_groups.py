"""Small kernels of single constructs: local memory and barriers."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ...base.arrays import Array
from .case import GROUP, Case
from .construct import Define, construct, ints


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
        by_group(lambda v: np.sum([np.roll(v, k, axis=1) for k in range(50)], axis=0)),
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
    )


def _batches(bits: Array, left: Array) -> Array:
    order = [item for k in range(4) for item in np.flatnonzero(bits >> k & 1).tolist()]
    return np.array([sum(order[: max(n, 0)]) for n in left.tolist()], np.int32)
