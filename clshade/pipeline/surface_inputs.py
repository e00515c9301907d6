"""The inputs of the pixel stages, which `Inputs` of kernels/surface.clh declares, and the layers, as parameters."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import Any

from ..images.layers import LAYER_TABLE
from .kernel_files import kernel_text


@cache
def parameters(*conditions: str) -> dict[str, str]:
    """Return the declarations of SURFACE_PARAMETERS by name. conditions: CASTERS or INSTANCES, or both for all there are."""
    body = kernel_text("surface.clh").partition("typedef struct Inputs {")[2].partition("}")[0]
    text, *parts = re.split(r"^#(?:if (\w+)|endif)\n", body, flags=re.MULTILINE)
    text += "".join(part for name, part in zip(parts[::2], parts[1::2], strict=True) if not name or name in conditions)
    return {name: f"global const {kind} *{name}" for kind, name in re.findall(r"global const (\w+) \*(\w+);", text)}


@cache
def macros() -> str:
    """Return OpenCL C: SURFACE_PARAMETERS of a kernel; SURFACE_ARGUMENTS, which initialize `Inputs`."""
    text = ""
    for branch in ("if CASTERS", "elif INSTANCES", "else"):
        declared = parameters(branch.split()[-1])
        text += f"#{branch}\n#define SURFACE_PARAMETERS {', '.join(declared.values())}\n"
        text += f"#define SURFACE_ARGUMENTS {{image->needs, {', '.join(declared)}}}\n"
    return f"{text}#endif\n"


def surface(**buffers: Any) -> dict[str, Any]:
    """Return all inputs by name, None for those that no feature of a scene reads. Without indices of their own normals and
    texture coordinates have those of `faces`."""
    inputs = {**dict.fromkeys(parameters("CASTERS", "INSTANCES")), **buffers}
    return {**inputs, **{name: inputs[name] or inputs["faces"] for name in ("normal_faces", "uv_faces")}}


# The layers that kernels/surface_layers.cl writes, and their bits in what is asked for. Z and the numbers are drawn from the
# triangles that own the pixels by kernels/layers.cl.
_LAYERS = {name: row for name, row in LAYER_TABLE.items() if row.kind != "uint32" and name != "Z"}
LAYER_BITS = {name: 1 << index for index, name in enumerate(_LAYERS)}
MIRRORED = 1 << len(LAYER_BITS)  # another bit: whether placements mirror


def layer_macros() -> str:
    """Return OpenCL C: the bits, LAYER_N and so on, and MIRRORED; LAYER_PARAMETERS of the kernel, to_N and so on;
    LAYER_VALUES, members named as the layers of type reals3; and FOR_LAYERS(DO), which is DO(name, bit, components,
    background) for each."""
    bits = {name: f"LAYER_{name.upper()}" for name in _LAYERS}
    each = ""
    for name, row in _LAYERS.items():
        background = "NAN_POSITION" if math.isnan(row.background) else f"{row.background!r}f"
        each += f" DO({name}, {bits[name]}, {len(row.components) or 1}, {background})"
    return (
        "".join(f"#define {bits[name]} {bit}\n" for name, bit in LAYER_BITS.items())
        + f"#define MIRRORED {MIRRORED}\n"
        + f"#define LAYER_PARAMETERS {', '.join(f'global real *to_{name}' for name in _LAYERS)}\n"
        + f"#define LAYER_VALUES reals3 {', '.join(_LAYERS)};\n"
        + f"#define FOR_LAYERS(DO){each}\n"
    )
