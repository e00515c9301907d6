"""Small kernels of single constructs: structs, arrays, address spaces and ids."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...base.arrays import Array
from .case import Case
from .construct import GRID_2D, construct, ints

POINT = """
typedef struct { int x; float w[3]; uchar tag; short more; int y; } point;
int sum_of(point p) { p.y += 1; return p.x + p.y + p.tag + p.more; }
point moved(point p, int by) { p.x += by; p.w[by & 1] = p.w[2] * 2.0f; return p; }
"""
TABLE = "constant int table[8] = {3, 1, 4, 1, 5, 9, 2, 6};\nconstant float steps[3] = {0.5f, -0.25f, 8.0f};\n"


def memory() -> Iterator[Case]:
    """Structs, arrays, address spaces, ids."""
    a, b = ints(60, -100, 100), ints(61, 0, 100)
    yield construct(
        "structs_by_value",
        "structs that are copied, passed by value and returned",
        """
point p = {a[i], {1.0f, 2.0f, (float)b[i]}, (uchar)b[i], (short)-b[i], 7}, q = p;
q = moved(q, b[i]);
out[i] = sum_of(p) + 1000 * sum_of(q) + (int)q.w[b[i] & 1] + p.y;
""",
        [a, b],
        lambda a, b: ((a + 8) + 1000 * (a + b + 8) + 2 * b + 7).astype(np.int32),
        POINT,
    )
    yield construct(
        "argument_by_value",
        "a function that changes its own copy of a struct",
        "pair p = {a[i], b[i]};\nint found = changed(p);\nout[i] = 1000 * found + p.y;",
        [a, b],
        lambda a, b: 1000 * (b + 1) + b,
        "typedef struct { int x, y; } pair;\nint changed(pair p) { p.y += 1; return p.y; }\n",
    )
    yield construct(
        "structs_in_memory",
        "structs of 24 bytes in an array",
        """
local point kept[64];
int l = get_local_id(0);
point p = {a[i], {1.0f, 2.0f, 3.0f}, 5, (short)(i & 63), b[i]};
kept[63 - l] = p;
barrier(CLK_LOCAL_MEM_FENCE);
out[i] = kept[l].x + 1000 * kept[l].y + kept[l].more + (int)sizeof(point);
""",
        [a, b],
        lambda a, b: _reversed(a) + 1000 * _reversed(b) + np.tile(np.arange(64)[::-1], len(a) // 64) + 24,
        POINT,
    )
    yield construct(
        "constant_tables",
        "tables in constant memory",
        "out[i] = table[b[i] & 7] * 100 + (int)(steps[b[i] % 3] * 4.0f) + a[i];",
        [a, b],
        lambda a, b: (
            np.array([3, 1, 4, 1, 5, 9, 2, 6], np.int32)[b & 7] * 100 + np.array([2, -1, 32], np.int32)[b % 3] + a
        ),
        TABLE,
    )
    yield construct(
        "private_arrays",
        "a private array at places that are only known as it runs",
        """
int own[16];
for (int k = 0; k < 16; ++k)
    own[k] = a[i] * k;
for (int k = 0; k < 5; ++k)
    own[(b[i] + k) & 15] ^= own[(b[i] * 3 + k) & 15];
uint sum = 0;
for (int k = 0; k < 16; ++k)
    sum = sum * 3 + own[k];
out[i] = (int)sum;
""",
        [a, b],
        lambda a, b: _mixed(a, b),
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
        [ints(62, 0, 100)],
        _ids,
        grid=GRID_2D,
    )
    yield construct(
        "vector_types_in_structs",
        "a struct with vectors, which are aligned",
        """
mixed m = {a[i], (float4)(1.0f, 2.0f, 3.0f, 4.0f), 9};
out[2 * i] = (int)sizeof(mixed) + (int)((char *)&m.v - (char *)&m);
out[2 * i + 1] = m.n + (int)m.v.z + m.last;
""",
        [a],
        lambda a: np.stack([np.full(len(a), 64), a + 12], axis=1).astype(np.int32),
        "typedef struct { int n; float4 v; uchar last; } mixed;\n",
    )


def _reversed(v: Array) -> Array:
    flipped: Array = v.reshape(-1, 64)[:, ::-1].reshape(-1)
    return flipped


def _mixed(a: Array, b: Array) -> Array:
    found = []
    for x, n in zip(a.tolist(), b.tolist(), strict=True):
        own = [x * k for k in range(16)]
        for k in range(5):
            own[(n + k) & 15] ^= own[(n * 3 + k) & 15]
        total = 0
        for v in own:
            total = total * 3 + v
        found.append((total + 2**31) % 2**32 - 2**31)
    return np.array(found, np.int32)


def _ids(a: Array) -> Array:
    y, x = np.divmod(np.arange(len(a)), GRID_2D.size[0])
    right, up = GRID_2D.offset or (0, 0)
    groups = 1000000 * (x // 8) + 8000000 * (y // 4)
    found: Array = a + 100 * (x + right) + 10000 * (y + up) + groups + 64000000
    return found
