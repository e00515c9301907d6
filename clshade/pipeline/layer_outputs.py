"""The layers that kernels/surface_layers.cl writes: known to the host and, by macros, to the kernel."""

from __future__ import annotations

import math

from ..images.layers import LAYER_TABLE

# Z and the numbers are drawn from the triangles that own the pixels by kernels/layers.cl.
SURFACE_LAYERS = [name for name, row in LAYER_TABLE.items() if row.kind != "uint32" and name != "Z"]
LAYER_BITS = {name: 1 << index for index, name in enumerate(SURFACE_LAYERS)}  # of those asked for
MIRRORED = 1 << len(LAYER_BITS)  # another bit: whether placements mirror


def _background(value: float) -> str:
    return "NAN_POSITION" if math.isnan(value) else f"{value!r}f"


def macros() -> str:
    """Return OpenCL C: the bits, LAYER_N and so on, and MIRRORED; LAYER_PARAMETERS of the kernel, to_N and so on;
    LAYER_VALUES, members named as the layers of type reals3; and FOR_LAYERS(DO), which is DO(name, bit, components,
    background) for each."""
    rows = {name: LAYER_TABLE[name] for name in SURFACE_LAYERS}
    bits = {name: f"LAYER_{name.upper()}" for name in rows}
    each = "".join(
        f" DO({name}, {bits[name]}, {len(row.components) or 1}, {_background(row.background)})"
        for name, row in rows.items()
    )
    return (
        "".join(f"#define {bits[name]} {bit}\n" for name, bit in LAYER_BITS.items())
        + f"#define MIRRORED {MIRRORED}\n"
        + f"#define LAYER_PARAMETERS {', '.join(f'global real *to_{name}' for name in rows)}\n"
        + f"#define LAYER_VALUES reals3 {', '.join(rows)};\n"
        + f"#define FOR_LAYERS(DO){each}\n"
    )
