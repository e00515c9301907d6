"""Materials, textures, lights and coordinates as the kernels read them, scaled to float32's range."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import Material, Texture
from . import struct_layout
from .features import tests_alpha
from .mipmaps import levels_below
from .struct_layout import Structs

Real = type[np.floating]
_WRAPS = {
    "repeat": struct_layout.CONSTANTS["WRAP_REPEAT"],
    "clamp": struct_layout.CONSTANTS["WRAP_CLAMP"],
    "mirror": struct_layout.CONSTANTS["WRAP_MIRROR"],
}
_LOOKUPS = {"standard": struct_layout.CONSTANTS["LOOKUP_STANDARD"], "course": struct_layout.CONSTANTS["LOOKUP_COURSE"]}


def to_real(values: Array, real: Real = np.float32) -> Array:
    """Round to a real; saturate at the largest finite value, flush values below the normal range to 0."""
    info = np.finfo(real)
    values = np.clip(np.asarray(values, np.float64), float(info.min), float(info.max))
    return np.where(np.abs(values) < float(info.tiny), 0.0, values).astype(real)


def split(values: Array, real: Real = np.float32) -> Array:
    """Split (K, 2) float64 into (K, 4) reals: rounded values and their rounding errors. Values that are not finite
    become 0."""
    values = np.where(np.isfinite(values), values, 0.0).astype(np.float64)
    # Beyond 2^24 float32 no longer distinguishes texels; keep the arithmetic finite.
    values = np.clip(values, -(2.0**40), 2.0**40)
    rounded = values.astype(real)
    return np.concatenate([rounded, (values - rounded).astype(real)], axis=1)


def joined(parts: list[Array], dtype: type | None = None) -> Array:
    """Concatenate the parts, C-contiguous; a single contiguous part is not copied."""
    rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return np.ascontiguousarray(rows, dtype=dtype or rows.dtype)


def material_table(
    materials: list[Material], textures: list[Texture], ambient: Array, structs: Structs = struct_layout.SINGLE
) -> Array:
    """Return rows of structs.Material. Coefficients beyond a real's range saturate."""
    table = np.zeros(len(materials), structs.Material)
    for row, material in zip(table, materials, strict=True):
        for name, value in (("ambient", material.ka * ambient), ("kd", material.kd), ("ks", material.ks)):
            row[name] = to_real(value, structs.real)
        row["n"] = material.n
        row["two_sided"], row["front_only"] = material.two_sided, material.sides == "front"
        row["texture"] = next((i for i, t in enumerate(textures) if t is material.texture), -1)
        row["alpha_texture"] = row["texture"] if tests_alpha(material) else -1
        row["alpha_cutoff"] = material.alpha_cutoff if tests_alpha(material) else 0.0
    return table


def texture_tables(textures: list[Texture], *, mipmaps: bool = False) -> tuple[Array, Array]:
    """Return rows of `struct_layout.SINGLE.Texture` and all textures' texels, concatenated, (X, 4) float32; with `mipmaps`
    each texture is followed by its smaller levels, which are opaque."""
    table = np.zeros(len(textures), struct_layout.SINGLE.Texture)
    offset, parts = 0, []
    for row, texture in zip(table, textures, strict=True):
        height, width, _ = texture.image.shape
        row["width"], row["height"] = width, height
        row["wrap"], row["lookup"] = [_WRAPS[wrap] for wrap in texture.wrap], _LOOKUPS[texture.lookup]
        levels = [texture.image]
        if mipmaps and texture.lookup == "standard":
            levels += levels_below(texture)
        row["levels"] = len(levels)
        for number, level in enumerate(levels):
            row["offset"][number] = offset
            texels = np.ones((level.shape[0] * level.shape[1], 4), np.float32)
            texels[:, : level.shape[2]] = level.reshape(len(texels), -1)
            parts.append(texels)
            offset += len(texels)
    return table, joined(parts)


def light_unit(materials: Iterable[Material], intensities: Array, ambient: Array, brightest: float) -> float:
    """Return the unit of light, a power of two, in which no sum of light overflows float32: 1 for all but extreme scenes.

    intensities: (L, 3). ambient: (3,). brightest: the largest component of a surface's color.
    """
    reflected = max((float((np.abs(m.kd) + np.abs(m.ks)).max()) for m in materials), default=0.0)
    scattered = max((float(np.abs(m.ka * ambient).max()) for m in materials), default=0.0)
    with np.errstate(over="ignore"):
        most = (float(np.abs(intensities).sum(axis=0).max(initial=0.0)) * reflected + scattered) * max(brightest, 1.0)
    return 2.0 ** max(min(math.frexp(most)[1] if math.isfinite(most) else 1000, 220) - 96, 0)


def relative_lights(positions: Array, eye: Array, scale: float) -> Floats:
    """Return light positions (L, 3) relative to the eye, times `scale`, a power of two. Of a light beyond 2^60 (2^59
    along an axis) only the direction is kept."""
    half = positions * 0.5 - eye * 0.5  # halves cannot overflow
    exponent = np.frexp(np.abs(half).max(axis=1, initial=0.0))[1]
    relative: Floats = np.ldexp(half, np.minimum(math.frexp(scale)[1], 60 - exponent)[:, None])
    return relative


def scale_for(extent: float) -> float:
    """Return the power of two that scales lengths of up to `extent` to about 1: it changes no bit of a direction, and
    keeps squares within float32's range."""
    return 2.0 ** -min(max(math.frexp(extent or 1.0)[1], -1000), 1000)
