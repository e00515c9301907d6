"""How the cases of single constructs are made: small kernels with arguments a, b, c, ... and out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...pipeline.bare_kernel import Grid
from .case import Case
from .operands import rng

ROWS = 1024
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
    """Return a case whose kernel has arguments a, b, c, ... and out, and the item's number i; its work-groups have
    GROUP rows. out: the C type of what it writes, that of a by default."""
    given = [np.ascontiguousarray(v) for v in inputs]
    kinds = [TYPES[v.dtype] for v in given]
    arguments = ", ".join(f"global const {kind} *{v}" for kind, v in zip(kinds, "abcd", strict=False))
    lines = "\n".join(f"    {line}" if line else "" for line in body.strip("\n").splitlines())
    text = f"kernel void {name}({arguments}, global {out or kinds[0]} *out)\n{{\n"
    text += f"    int i = get_global_id(0);\n{lines}\n}}\n"
    kind = next(kind for kind, c in TYPES.items() if c == out) if out else given[0].dtype
    case = Case(name, title, text, tuple(given), lambda *v: np.asarray(define(*v)).astype(kind), head, **more)
    return case.in_groups()


def ints(seed: int, low: int, high: int, *width: int) -> Array:
    """Return ROWS rows of int32 from low to high - 1."""
    found: Array = rng(20, seed).integers(low, high, (ROWS, *width)).astype(np.int32)
    return found


def reals(seed: int, *width: int, kind: Any = np.float32) -> Array:
    """Return ROWS rows of numbers of both signs between 2^-20 and 2^20."""
    own = rng(21, seed)
    size = np.ldexp(own.uniform(1.0, 2.0, (ROWS, *width)), own.integers(-20, 20, (ROWS, *width)))
    found: Array = (size * own.choice([-1.0, 1.0], (ROWS, *width))).astype(kind)
    return found


GRID_2D = Grid((32, 32), (8, 4), (3, 5))
