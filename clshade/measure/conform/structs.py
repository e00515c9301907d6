"""Every struct and constant that host and kernels share has the same size, places and value on the device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.arrays import Array
from ...pipeline import struct_layout
from ...pipeline.bare_kernel import Grid
from .case import Case


def struct_kernel(name: str, kernel: str, dtype: np.dtype) -> str:
    """Return a kernel that writes the size of a struct, then the place of each member."""
    lines = [f"{name} s;", f"out[0] = sizeof({name});"]
    for i, member in enumerate(dtype.names or (), 1):
        lines.append(f"out[{i}] = (int)((private char *)&s.{member} - (private char *)&s);")
    body = "\n    ".join(lines)
    return f"kernel void {kernel}(global const int *unused, global int *out)\n{{\n    {body}\n}}\n"


def _written(values: Sequence[float], kind: type) -> Array:
    return np.array(values, kind).reshape(1, -1)


def cases(double: bool) -> list[Case]:
    """Return a case for each struct with float32 and, on a device with float64, float64 reals; and one of the constants."""
    found = []
    for layout, is_double in ((struct_layout.SINGLE, False), (struct_layout.DOUBLE, True)):
        if is_double and not double:
            continue
        head = struct_layout.header(double_reals=is_double, with_double=double)
        for name, dtype in layout._asdict().items():
            if name == "real":
                continue
            reals = "float64" if is_double else "float32"
            expected = [dtype.itemsize, *(dtype.fields[member][1] for member in dtype.names)]
            found.append(_case(name, reals, dtype, expected, head))
    values = " ".join(f"out[{i}] = {name};" for i, name in enumerate(struct_layout.CONSTANTS))
    text = f"kernel void constants(global const int *unused, global float *out)\n{{\n    {values}\n}}\n"
    head = struct_layout.header(with_double=double)
    constants = list(struct_layout.CONSTANTS.values())  # float32 holds all of them
    one = np.zeros(1, np.int32)
    found.append(
        Case(
            "constants", "constants of host and kernels", text, (one,), lambda _: _written(constants, np.float32), head
        )
    )
    return found


def _case(name: str, reals: str, dtype: np.dtype, expected: list[int], head: str) -> Case:
    kernel, one = f"{name}_{reals}", np.zeros(1, np.int32)
    return Case(
        kernel,
        f"struct {name} with {reals} reals",
        struct_kernel(name, kernel, dtype),
        (one,),
        lambda _: _written(expected, np.int32),
        head,
        grid=Grid((1,), (1,)),
    )
