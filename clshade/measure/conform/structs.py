"""Every struct and constant that host and kernels share has the same size, places and value on the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...pipeline import struct_layout
from .case import C_TYPES, GROUP, Case, in_one_program, signature


def cases(double: bool) -> list[Case]:
    """Return a case for each struct with float32 and, on a device with float64, float64 reals; and one of the constants."""
    all_cases: list[Case] = []
    for reals, layout in (("float32", struct_layout.SINGLE), ("float64", struct_layout.DOUBLE))[: 1 + double]:
        head = struct_layout.header(double_reals=reals == "float64", with_double=double)
        alike = []
        for name, dtype in layout.types.items():
            words = [f"{name} s; row[0] = sizeof({name});"]
            words += [f"row[{k}] = (char *)&s.{member} - (char *)&s;" for k, member in enumerate(dtype.names, 1)]
            numbers = [dtype.itemsize, *(dtype.fields[member][1] for member in dtype.names)]
            alike.append(_case(f"{name}_{reals}", f"struct {name} with {reals} reals", words, head, numbers, np.int32))
        all_cases += in_one_program(alike)
    words = [f"row[{k}] = {name};" for k, name in enumerate(struct_layout.CONSTANTS)]
    numbers = list(struct_layout.CONSTANTS.values())  # float32 holds all of them
    head = struct_layout.header(with_double=double)
    return [*all_cases, _case("constants", "constants of host and kernels", words, head, numbers, np.float32)]


def _case(name: str, title: str, words: list[str], head: str, numbers: Sequence[Any], kind: Any) -> Case:
    """Return the case of a kernel of which each item writes these numbers."""
    inputs, expected = (np.zeros(GROUP, np.int32),), np.array([numbers] * GROUP, kind)
    words = [f"global {C_TYPES[np.dtype(kind)]} *row = out + {len(numbers)} * get_global_id(0);", *words]
    text = f"{signature(name, ('unused',), inputs, kind)}\n{{\n    {chr(10).join(words)}\n}}\n"
    return Case(name, title, text, inputs, lambda _: expected, head)
