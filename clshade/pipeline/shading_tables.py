"""Materials, textures, environments and lights as the kernels read them, scaled to float32's range; tables that take long to
compute are kept on disk by a digest of what they are computed from."""

from __future__ import annotations

import contextlib
import hashlib
import io
import math
import zipfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Floats
from ..base.atomic_files import write_bytes
from ..errors import ClshadeError
from ..images.decode import CodedImage
from ..scene import image_light
from ..scene.environment import Environment
from ..scene.material import MAPS, MIN_ROUGHNESS, TERMS
from ..scene.model import Material, Mesh, Texture
from .opencl.environment import cache_root
from .struct_layout import CONSTANTS, SINGLE, Structs

Real = type[np.floating]
_MOST_KEPT = 8  # files of tables: those that were not used for longest go


def to_real(values: ArrayLike, real: Real = np.float32) -> Array:
    """Round to a real; saturate at the largest finite value, flush values below the normal range to 0."""
    info = np.finfo(real)
    values = np.clip(np.asarray(values, np.float64), float(info.min), float(info.max))
    return np.where(np.abs(values) < float(info.tiny), 0.0, values).astype(real)


def split(values: Array, real: Real = np.float32) -> Array:
    """Return the real nearest to each value, then those nearest to the remainders: (..., 2 N) of (..., N) float64."""
    high = values.astype(real)
    return np.concatenate([high, (values - high).astype(real)], axis=-1)


def split_uvs(values: Array, real: Real = np.float32) -> Array:
    """Split texture coordinates (K, 2) into (K, 4) reals. Those that are not finite become 0."""
    # Beyond 2^24 float32 no longer distinguishes texels; keep the arithmetic finite.
    finite = np.where(np.isfinite(values), values, 0.0).astype(np.float64)
    return split(np.clip(finite, -(2.0**40), 2.0**40), real)


def joined(parts: list[Array], dtype: type | None = None) -> Array:
    """Concatenate the parts, C-contiguous; a single contiguous part is not copied."""
    rows = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return np.ascontiguousarray(rows, dtype=dtype or rows.dtype)


def material_table(
    materials: list[Material], textures: list[Texture], ambient: Array, structs: Structs = SINGLE
) -> Array:
    """Return rows of structs.Material. Coefficients beyond a real's range saturate."""
    table = np.zeros(len(materials), structs.Material)
    facets = [material.microfacets for material in materials]
    numbers = {id(texture): number for number, texture in enumerate(textures)}

    def reals(rows: list[Any]) -> Array:
        return to_real(np.array(rows), structs.real)

    def texture_numbers(looked_up: list[Texture | None]) -> list[int]:
        return [numbers.get(id(texture), -1) for texture in looked_up]

    table["ambient"] = to_real(np.array([each.ka for each in materials]) * ambient, structs.real)
    table["k"] = reals([np.concatenate([getattr(each, name) for name in TERMS]) for each in materials])
    table["n"] = [each.n for each in materials]
    for name, field in (("metallic", "metallic"), ("roughness", "roughness"), ("f90", "specular")):
        table[name] = [getattr(facet, field) for facet in facets]
    table["diffuse"] = reals([each.diffuse for each in materials])
    table["f0"], table["emission"] = reals([f.dielectric_f0 for f in facets]), reals([f.emission for f in facets])
    table["two_sided"] = [each.two_sided for each in materials]
    table["front_only"] = [each.sides == "front" for each in materials]
    table["texture"] = texture_numbers([each.texture for each in materials])
    for column, (name, kind) in enumerate(MAPS.items()):
        table["maps"][:, column] = texture_numbers([getattr(facet, name) for facet in facets])
        table["map_factors"][:, column] = [getattr(facet, kind.factor) if kind.factor else 1.0 for facet in facets]
    tested, blends = ([each.alpha_cutoff is not None for each in materials], [each.blend for each in materials])
    table["alpha_tested"], table["blends"] = tested, blends
    has_alpha = [each.texture is not None and each.texture.texels.shape[2] == 4 for each in materials]
    table["alpha_texture"] = np.where(has_alpha & np.logical_or(tested, blends), table["texture"], -1)
    table["alpha_cutoff"] = [each.alpha_cutoff or 0.0 for each in materials]
    table["opacity"] = reals([each.opacity for each in materials])
    return table


def texture_tables(textures: list[Texture], *, mipmaps: bool = False, uv_rows: int = 0) -> tuple[Array, Array]:
    """Return rows of `struct_layout.SINGLE.Texture` and all textures' texels, concatenated, (X, 4) float32; with `mipmaps`
    each texture is followed by its smaller levels, which are opaque. uv_rows: of a set of texture coordinates."""
    table = np.zeros(len(textures), SINGLE.Texture)
    below = (levels_below(each) if mipmaps and each.lookup == "standard" else [] for each in textures)
    mipmap = [[each.texels, *levels] for each, levels in zip(textures, below, strict=True)]
    starts = np.cumsum([0, *(level.shape[0] * level.shape[1] for levels in mipmap for level in levels)])
    texels, offsets = np.empty((starts[-1], 4), np.float32), iter(starts)
    with ThreadPoolExecutor(_THREADS) as threads:
        list(threads.map(_write_texels, chain.from_iterable(mipmap), np.split(texels, starts[1:])))
    first: dict[tuple[object, ...], int] = {}
    for number, (row, texture, levels) in enumerate(zip(table, textures, mipmap, strict=True)):
        height, width, _ = texture.texels.shape
        kind = width, height, texture.wrap, texture.lookup, texture.filter, texture.coordinates
        row["alike"] = first.setdefault(kind, number)
        row["width"], row["height"] = width, height
        row["wrap"] = [CONSTANTS[f"WRAP_{wrap.upper()}"] for wrap in texture.wrap]
        row["lookup"] = CONSTANTS[f"LOOKUP_{texture.lookup.upper()}"]
        row["nearest"], row["uv_offset"] = texture.filter == "nearest", texture.coordinates * uv_rows
        row["levels"] = len(levels)
        row["offset"][: len(levels)] = list(islice(offsets, len(levels)))
    return table, texels


def _write_texels(level: CodedImage | Array, texels: Array) -> None:
    """Fill texels (h w, 4) with an image (h, w, 3 or 4), opaque unless it has alpha."""
    texels = texels.reshape(*level.shape[:2], 4)
    if isinstance(level, CodedImage):
        level.write(texels)
    else:
        texels[..., : level.shape[2]] = level
        texels[..., level.shape[2] :] = 1.0


def light_unit(
    materials: Iterable[Material],
    intensities: Array,
    ambient: Array,
    brightest: float,
    *,
    pbr: bool = False,
    radiance: float = 0.0,
) -> float:
    """Return the unit of light, a power of two, in which no sum of light overflows float32: 1 for all but extreme scenes.

    intensities: (L, 3). ambient: (3,). brightest: the largest component of a surface's color. pbr: whether the shader is
    pbr, whose lobe is at most 1/(2 alpha^3), at grazing incidence. radiance: the largest of an environment; irradiance
    over pi is at most 4 times as much by spherical harmonics, as a sum of 9 terms, and reflected once more as highlights.
    """
    lobe = MIN_ROUGHNESS**-6 / 2.0
    sums = (np.abs(m.diffuse) + lobe if pbr else sum(np.abs(getattr(m, name)) for name in TERMS) for m in materials)
    reflected = max((float(total.max()) for total in sums), default=0.0)
    diffuse = max((float(np.abs(m.diffuse).max()) for m in materials), default=0.0)
    scattered = max((float(np.abs(m.ka * ambient).max()) for m in materials), default=0.0)
    with np.errstate(over="ignore"):
        limit = (float(np.abs(intensities).sum(axis=0).max(initial=0.0)) * reflected + scattered) * max(brightest, 1.0)
        limit += 8.0 * radiance * max(diffuse, 1.0) * max(brightest, 1.0)
    return 2.0 ** max(min(math.frexp(limit)[1] if math.isfinite(limit) else 1000, 220) - 96, 0)


def relative_lights(positions: Array, eye: Array, scale: float, limit: Array | int = 60) -> Floats:
    """Return light positions (L, 3) relative to the eye, times `scale`, a power of two. Of a light beyond 2^limit (half of
    that along an axis) only the direction is kept. limit: a number, or (L,)."""
    half = positions * 0.5 - eye * 0.5  # halves cannot overflow
    return np.asarray(np.ldexp(half, light_exponents(positions, eye, scale, limit)[:, None] + 1))


def light_exponents(
    positions: Array, eye: Array, scale: float, limit: Array | int = 60, sizes: Array | float = 0.0
) -> Array:
    """Return the powers of two (L,) that `relative_lights` scales by: that of `scale`, or less for lights beyond
    2^limit. sizes: of what is to be scaled with them and no larger than 2^limit either."""
    half = positions * 0.5 - eye * 0.5
    exponent = np.frexp(np.maximum(np.abs(half).max(axis=1, initial=0.0), 0.5 * np.asarray(sizes)))[1]
    return np.asarray(np.minimum(math.frexp(scale)[1], limit - exponent) - 1)


def scale_for(extent: float) -> float:
    """Return the power of two that scales lengths of up to `extent` to about 1: it changes no bit of a direction, and
    keeps squares within float32's range."""
    return 2.0 ** -min(max(math.frexp(extent or 1.0)[1], -1000), 1000)


def environment_tables(environment: Environment | None, unit: float, structs: Structs) -> tuple[Array, ...]:
    """Return a row of structs.Environment, and the table that it points into, (R, 4) reals: that of the BRDF, with its
    last row and column twice, then the levels with a border of one texel. unit: of light. None: black."""
    around = environment or Environment(np.zeros((1, 1, 3)))

    def compute() -> tuple[Array, Array]:
        light, row = image_light.image_light(around), np.zeros(1, structs.Environment)
        row["irradiance"] = to_real(light.irradiance / unit, structs.real).reshape(-1)
        share = image_light.brdf_table().copy()
        share[..., 2] = 1.0 - share[..., 2]
        parts = [np.pad(share, ((0, 1), (0, 1), (0, 0)), mode="edge").reshape(-1, 3)]
        parts += [image_light.with_border(level).reshape(-1, 3) / unit for level in light.levels]
        starts = np.cumsum([len(part) for part in parts])
        for number, level in enumerate(light.levels):
            row["offset"][0, number], row["side"][0, number] = starts[number], len(level)
        table = np.zeros((starts[-1], 4), structs.real)
        table[:, :3] = to_real(np.concatenate(parts), structs.real)
        return row, table

    sizes = around.image.shape, around.rotation, around.intensity, around.up.tolist(), unit, structs.Environment.descr
    code = [Path(__file__), Path(image_light.__file__)]
    return kept(code, [repr(sizes).encode(), around.image.tobytes()], compute)


def kept(code: Iterable[Path], inputs: Iterable[bytes], compute: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return what `compute` returns, from disk if an earlier call with equal `inputs` wrote it. code: the files that say how
    it is computed. A file that is damaged or cannot be written only costs time."""
    path: Path | None = None
    with contextlib.suppress(OSError, ValueError, EOFError, KeyError, MemoryError, zipfile.BadZipFile, ClshadeError):
        parts = [np.__version__.encode(), *(file.read_bytes() for file in code), *inputs]
        digest = hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts))
        path = cache_root() / "tables" / f"{digest.hexdigest()}.npz"
        with np.load(path, allow_pickle=False) as file:
            arrays = tuple(file.values())
        path.touch()
        return arrays
    arrays, content = compute(), io.BytesIO()
    if path is None:
        return arrays
    np.savez(content, *arrays)
    with contextlib.suppress(OSError, ClshadeError):
        path.parent.mkdir(exist_ok=True)
        write_bytes(path, content.getbuffer())
        for old in sorted(path.parent.glob("*.npz"), key=lambda entry: entry.stat().st_mtime)[:-_MOST_KEPT]:
            old.unlink(missing_ok=True)
    return arrays


def has_coordinates(mesh: Mesh, texture: Texture | None) -> bool:
    """Return whether there is a texture, and the mesh has its texture coordinates."""
    return texture is not None and mesh.uvs is not None and texture.coordinates <= len(mesh.more_uvs)


def map_of(mesh: Mesh, name: str) -> Texture | None:
    """Return a map of shader pbr, one of `scene.material.MAPS`; None if the mesh cannot look it up."""
    texture: Texture | None = None if mesh.material.pbr is None else getattr(mesh.material.pbr, name)
    return texture if has_coordinates(mesh, texture) else None


def textures_of(mesh: Mesh, *, maps: bool) -> list[Texture]:
    """Return the textures that a mesh looks up at the pixels. maps: whether the shader uses those of shader pbr."""
    own = mesh.material.texture
    looked_up = [own if has_coordinates(mesh, own) else None, *(map_of(mesh, name) for name in (MAPS if maps else ()))]
    return [texture for texture in looked_up if texture is not None]


def usable(mesh: Mesh) -> Material:
    """Return the material of a mesh with what applies to it alone: textures, transparency, alpha test."""
    material, facets = mesh.material, mesh.material.pbr
    changes: dict[str, Any] = {"blend": mesh.blends}
    changes["texture"] = material.texture if has_coordinates(mesh, material.texture) else None
    changes["alpha_cutoff"] = material.alpha_cutoff if mesh.tests_alpha else None
    if facets is not None:
        maps: dict[str, Any] = {name: map_of(mesh, name) for name in MAPS}
        is_whole = all(getattr(facets, name) is texture for name, texture in maps.items())
        changes["pbr"] = facets if is_whole else replace(facets, **maps)
    unchanged = all(getattr(material, name) is value for name, value in changes.items())
    return material if unchanged else replace(material, **changes)


_THREADS = 4  # that fill the table of texels
BAND = 1 << 18  # values of the larger level halved at a time, in float64: they stay in the cache

_levels: WeakKeyDictionary[Texture, list[Array]] = WeakKeyDictionary()


def levels_below(texture: Texture) -> list[Array]:
    """Return `smaller_levels` of a texture without its alpha; kept as long as the texture lives."""
    if texture not in _levels:
        _levels[texture] = smaller_levels(np.asarray(texture.texels)[..., :3])
    return _levels[texture]


def smaller_levels(image: Array) -> list[Array]:
    """Return the levels below an image (h, w, C), float32, from the largest, max(h // 2, 1) by max(w // 2, 1), to 1 x 1.

    A texel is the mean, in linear light, of the area of the previous level that it covers: the box filter, also for odd
    sizes. Computed in float64 from level to level, rounded once, so that a constant image has constant levels.
    """
    values, levels = image, []
    while max(values.shape[:2]) > 1:
        height, width, channels = values.shape
        half = np.empty((max(height // 2, 1), max(width // 2, 1), channels))
        band = max(1, BAND // (2 * width * channels))  # rows at a time: only the result is held whole in float64
        for start in range(0, len(half), band):
            rows = _halved(values, start, min(start + band, len(half)))
            half[start : start + band] = _halved(rows.swapaxes(0, 1), 0, half.shape[1]).swapaxes(0, 1)
        values = half
        levels.append(half.astype(np.float32))
    return levels


def _halved(rows: Array, start: int, stop: int) -> Array:
    """Return rows `start` to `stop` of an image with half as many rows, rounded down, but at least one; float64.

    Of 2m+1 rows each new one covers 2 + 1/m. The i-th has (m-i)/m of the first, all of the second and (i+1)/m of the third
    of its three: a polyphase box filter, as in the remarks on OpenGL's ARB_texture_non_power_of_two.
    """
    m = len(rows) // 2
    if m == 0:
        return rows.astype(np.float64)
    if len(rows) == 2 * m:
        part = rows[2 * start : 2 * stop].astype(np.float64, copy=False)
        return (part[0::2] + part[1::2]) * 0.5
    part = rows[2 * start : 2 * stop + 1].astype(np.float64, copy=False)
    i = np.arange(start, stop, dtype=np.float64)[:, None, None]
    return ((m - i) * part[:-1:2] + m * part[1::2] + (i + 1.0) * part[2::2]) / (2 * m + 1)


_MOST_RADIANCE = 2.0**100  # of the backdrop's table: sums of its numbers stay within float32's range


def backdrop_table(environment: Environment, structs: Structs) -> Array:
    """Return the radiance over `backdrop_unit`, ((h + 3) * (w + 2), 4) reals, row by row.

    A column more on each side continues the image around the seam. The first row and the last but one are the poles: the
    mean of the image's first and last row. The last row is read, with a weight of 0, at the lower pole.
    """
    height, width, _ = environment.image.shape
    factor = environment.intensity / backdrop_unit(environment)
    table = np.zeros((height + 3, width + 2, 4), structs.real)
    for row in range(height):
        table[1 + row, 1:-1, :3] = to_real(environment.image[row].astype(np.float64) * factor, structs.real)
    for place, row in ((0, 0), (height + 1, -1), (height + 2, -1)):
        table[place, 1:-1, :3] = to_real(environment.image[row].astype(np.float64).mean(axis=0) * factor, structs.real)
    table[:, 0], table[:, -1] = table[:, -2], table[:, 1]
    return table.reshape(-1, 4)


def backdrop_unit(environment: Environment) -> float:
    """Return what the table is counted in: 1 for all but extreme radiance, a power of two."""
    limit = float(environment.image.max()) * environment.intensity
    return max(1.0, 2.0 ** math.ceil(math.log2(limit / _MOST_RADIANCE))) if limit > 0.0 else 1.0


def write_backdrop_size(image: np.void, environment: Environment) -> None:
    """Fill a row of structs.Image with what `backdrop_table` holds."""
    image["backdrop_rows"], image["backdrop_columns"] = environment.image.shape[:2]
    image["backdrop_unit"] = backdrop_unit(environment)
