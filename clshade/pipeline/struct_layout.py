"""What host and kernels share: the kernels' sources, constants, and kernels/structs.h as NumPy types; the inputs of the
pixel stages, which `Inputs` of kernels/surface.clh declares, and the layers, as parameters.

A `real` is float32, or float64 in kernels of that precision. NumPy aligns members as C does;
`tests/pipeline/test_layout.py` probes sizes and offsets on every device.
"""

from __future__ import annotations

import hashlib
import math
import re
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DeviceError
from ..images.layers import LAYER_TABLE
from ..scene import image_light
from ..scene.material import MAPS, MIN_ROUGHNESS, TERMS

SUBPIXEL_BITS = 16  # snapped positions count 1/65536 px
SAMPLE_BITS = 8  # samples lie at multiples of 1/256 px
# The guard band: image coordinates, from the corner of the region that is drawn, of a vertex without clipping. Two corners
# are less than 2^15 px apart, so that differences of snapped positions are ints.
GUARD_LOW, GUARD_HIGH = -8191, 24575
# Means "beyond the guard band" in snapped positions, which within it are at most 24575 px from any part of an image.
SNAP_LIMIT = 32767 << SUBPIXEL_BITS
TILE_SIZE = 16  # pixels per side
FEW_PIXELS = 4  # boxes of up to so many are rasterized pixel by pixel, larger ones by blocks
MOST_SAMPLES = 64  # per pixel
MOST_LENGTH = 2.0**60  # scaled eye-relative coordinates are clamped to it: their squares stay within float32's range
MOST_DEPTH = 2.0**100  # scaled depths are clamped to it: their reciprocals stay within float32's range
MOST_LEVELS = 16  # of a texture: its own size, at most 2^15, and each half of the previous down to 1
MOST_POSITION = 2.0**100  # in a color map: positions are clamped to it, and those below mean something else
NAN_POSITION = 2.0**120  # of what has no number
WHITE_POSITION = 2.0**124  # of what no color map colors
LINE_INSET = 64  # 1/256 px: the visibility of a line is not asked nearer to its ends, nor beyond its middle
# How far a column and a row shift the points of lights in their unit square, fractions of 2^24: powers of 1/g, with
# g^5 = g + 1, so that the shifts of neighboring pixels fill the square evenly (light_points.py).
SHIFT_U_COLUMN, SHIFT_U_ROW = 14372620, 9036163
SHIFT_V_COLUMN, SHIFT_V_ROW = 10547948, 12312662
SHADOW_REACH = 2.0**15  # coordinates of casters are at most this, in the units of shadows
SHADOW_GRID = 2.0**-31  # and multiples of this: differences have 47 bits, which a pair of float32 holds
RECEIVER_UNITS = 9  # of SHADOW_GRID: how far off its face's plane a receiver may lie along each axis
OCCLUSION_W = 0.125  # of the ends of rays of ambient occlusion, whose coordinates are below SHADOW_REACH / OCCLUSION_W
MOST_HIERARCHY_LEVELS = 7  # of nodes: 16^8 triangles
CURVE_BITS = 36  # of a caster's place along Hilbert's curve, 12 an axis
HIERARCHY_RUN = 4096  # casters that are put in a better order than that curve's
SIZE_BITS = 2  # of its class of size
LEAST_ALPHA = MIN_ROUGHNESS**2
ENVIRONMENT_LEVELS = image_light.LEVELS
BRDF_SIDE = image_light.TABLE_SIDE
OFF_MIRROR = image_light.OFF_MIRROR

CONSTANTS = {
    **{name: value for name, value in globals().items() if isinstance(value, (int, float))},  # all of the above
    **{f"TERM_{term.feature}": index for index, term in enumerate(TERMS.values())},
    "TERMS": len(TERMS),
    **{f"MAP_{each.name}": index for index, each in enumerate(MAPS.values())},
    "MAPS": len(MAPS),
    "SCALED_MAPS": sum(1 << index for index, each in enumerate(MAPS.values()) if each.factor),
    "WRAP_REPEAT": 0,
    "WRAP_CLAMP": 1,
    "WRAP_MIRROR": 2,
    "LOOKUP_STANDARD": 0,
    "LOOKUP_COURSE": 1,
}


@cache
def kernel_folder() -> Path:
    """Return the folder of the kernel sources: inside an installed package, or at the top level of a checkout."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "kernels", package.parent / "kernels"):
        if (folder / "features.clh").is_file():
            return folder
    raise DeviceError(f"{package}: the kernel sources are missing; install clshade again")


@cache
def kernel_text(name: str) -> str:
    """Return the source in a file of that name, with the same line ends everywhere."""
    return (kernel_folder() / name).read_text(encoding="utf-8")


@cache
def kernels_digest() -> str:
    """Return the SHA-256 of the names and contents of all sources, in hexadecimal."""
    digest = hashlib.sha256()
    for path in sorted(path for path in kernel_folder().iterdir() if path.suffix in (".cl", ".clh", ".h")):
        content = kernel_text(path.name).encode()
        digest.update(b"%s %d\n" % (path.name.encode(), len(content)) + content)
    return digest.hexdigest()


_NUMPY = {"double": "<f8", "float": "<f4", "int": "<i4", "ulong": "<u8"}


class Structs:
    """The structs' NumPy types, as attributes, read at first use. real: the scalar type of their members of that name."""

    def __init__(self, real: type[np.floating]) -> None:
        self.real = real

    @cached_property
    def types(self) -> dict[str, Any]:
        """All types by name."""
        kinds, types = {**_NUMPY, "real": np.dtype(self.real).str}, {}
        for body, name in re.findall(r"(?ms)^typedef struct \{(.*?)^\} (\w+);", kernel_text("structs.h")):
            members: list[tuple[str, str, tuple[int, ...]]] = []
            for kind, declared in re.findall(r"(?m)^ +(\w+) ([^;]+);", body):
                for member, size in re.findall(r"(\w+)(?:\[(.*?)\])?(?:, |$)", declared):
                    factors = [int(CONSTANTS.get(factor, factor)) for factor in size.split(" * ") if factor]
                    members.append((member, kinds[kind], (math.prod(factors),) if factors else ()))
            types[name] = np.dtype(members, align=True)
        return types

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self.types:
            raise AttributeError(name)
        return self.types[name]


SINGLE, DOUBLE = Structs(np.float32), Structs(np.float64)


def header(*, double_reals: bool = False, with_double: bool = True) -> str:
    """Return OpenCL C of all constants and structs.

    double_reals: whether a real is a double. with_double: whether the device has float64; if not, members of type ulong hold
    the bits of doubles.
    """
    lines = [f"#define FP64 {int(with_double)}", f"typedef {'double' if double_reals else 'float'} real;"]
    lines += [f"#define {name} {value}" for name, value in CONSTANTS.items()]
    text = kernel_text("structs.h")
    structs = text if with_double else re.sub(r"\bdoubles?\b", "ulong", text)
    return "\n".join([*lines, structs])


@cache
def surface_parameters(*conditions: str) -> dict[str, str]:
    """Return the declarations of SURFACE_PARAMETERS by name. conditions: CASTERS or INSTANCES, or both for all there are."""
    body = kernel_text("surface.clh").partition("typedef struct Inputs {")[2].partition("}")[0]
    text, *parts = re.split(r"^#(?:if (\w+)|endif)\n", body, flags=re.MULTILINE)
    text += "".join(part for name, part in zip(parts[::2], parts[1::2], strict=True) if not name or name in conditions)
    return {name: f"global const {kind} *{name}" for kind, name in re.findall(r"global const (\w+) \*(\w+);", text)}


@cache
def surface_macros() -> str:
    """Return OpenCL C: SURFACE_PARAMETERS of a kernel; SURFACE_ARGUMENTS, which initialize `Inputs`."""
    text = ""
    for branch in ("if CASTERS", "elif INSTANCES", "else"):
        declared = surface_parameters(branch.split()[-1])
        text += f"#{branch}\n#define SURFACE_PARAMETERS {', '.join(declared.values())}\n"
        text += f"#define SURFACE_ARGUMENTS {{image->needs, {', '.join(declared)}}}\n"
    return f"{text}#endif\n"


def surface_inputs(**buffers: Any) -> dict[str, Any]:
    """Return all inputs by name, None for those that no feature of a scene reads. Without indices of their own normals and
    texture coordinates have those of `faces`."""
    inputs = {**dict.fromkeys(surface_parameters("CASTERS", "INSTANCES")), **buffers}
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
