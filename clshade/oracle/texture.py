"""Lookups in textures, bilinear in both conventions and trilinear between mip-map levels, and in color maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Bools, Floats, Integers, Reals
from ..scene.model import Mesh, Settings, Texture
from ..scene.scalar_colors import ColorMap, color_map_of
from .corners import Corners, from_first, has_uvs, interpolated
from .shot import Hits


def wrapped(t: Floats, wrap: str) -> Floats:
    """Wrap a texture coordinate, in units of the image: repeat and clamp to [0, 1], mirror to [0, 2]."""
    return np.clip(t, 0.0, 1.0) if wrap == "clamp" else np.mod(t, 1.0 if wrap == "repeat" else 2.0)


def wrapped_index(i: Integers, size: int, wrap: str) -> Integers:
    """Return the texel, 0 to size - 1, at integer position i of an endless row of texels."""
    if wrap == "mirror":
        i = i % (2 * size)
        return np.minimum(i, 2 * size - 1 - i)
    return i % size if wrap == "repeat" else np.clip(i, 0, size - 1)


def neighbors(t: Floats, size: int, lookup: str, wrap: str) -> tuple[Integers, Integers, Floats]:
    """Return, along one axis, the two texels around coordinate t and how far t is from the first (0) to the second (1)."""
    t = np.where(np.isfinite(t), t, 0.0)
    if lookup == "nearest":
        index = np.floor(wrapped(t, wrap) * size).astype(np.int64)
        return (both := wrapped_index(index, size, wrap)), both, np.zeros_like(t)
    if lookup == "course":
        x, wrap = np.clip(t, 0.0, 1.0) * (size - 1), "clamp"
    else:
        x = wrapped(t, wrap) * size - 0.5
    first = np.floor(x)
    index = first.astype(np.int64)
    return wrapped_index(index, size, wrap), wrapped_index(index + 1, size, wrap), x - first


def four_texels(uv: Reals, image: Reals, lookup: str, wrap: str | tuple[str, str]) -> tuple[Floats, Floats, Floats]:
    """Return the texels (2, 2, ..., C) around texture coordinates uv (..., 2), [low or high v, left or right u], and
    the fractions of the way from left to right and low to high, (..., 1) each."""
    at = np.asarray(uv, dtype=np.float64)
    rows, columns = image.shape[:2]
    wrap_u, wrap_v = (wrap, wrap) if isinstance(wrap, str) else wrap
    left, right, fx = neighbors(at[..., 0], columns, lookup, wrap_u)
    low, high, fy = neighbors(at[..., 1], rows, lookup, wrap_v)
    texels = np.array([[image[low, left], image[low, right]], [image[high, left], image[high, right]]])
    return texels, fx[..., None], fy[..., None]


def bilerp(uv: Reals, image: Reals, lookup: str = "standard", wrap: str | tuple[str, str] = "repeat") -> Floats:
    """Return colors (..., C) of an image (h, w, C) at texture coordinates uv (..., 2).

    lookup `standard`: texel (i, j) has its center at ((i+0.5)/w, (j+0.5)/h), and `wrap` (repeat, clamp, mirror) defines
    what lies beyond the image. `course`: u and v are clamped to [0, 1], x = u*(w-1), y = v*(h-1), the neighbors are
    floor(x) and min(floor(x)+1, w-1). `nearest`: the texel whose rectangle holds the
    point. A coordinate that is NaN or infinite counts as 0.
    """
    texels, fx, fy = four_texels(uv, image, lookup, wrap)
    below, above = texels[:, 0] * (1.0 - fx) + texels[:, 1] * fx
    return np.asarray(below * (1.0 - fy) + above * fy)


def brightest(uv: Reals, image: Reals, lookup: str = "standard", wrap: str | tuple[str, str] = "repeat") -> Floats:
    """Return the largest magnitude (..., C) among the texels of a bilinear lookup: the sensitivity of the color to
    errors of its fractions."""
    return np.asarray(np.abs(four_texels(uv, image, lookup, wrap)[0]).max(axis=(0, 1)))


def spread(uv: Floats, image: Reals, wrap: tuple[str, str], slack: Floats) -> Floats:
    """Return how much the nearest texel's color (K, C) may change if texture coordinates uv (K, 2) are off by up to `slack`
    (K, 2)."""
    here = bilerp(uv, image, "nearest", wrap)
    change = np.zeros_like(here)
    for step in np.array([*np.ndindex(3, 3)]) - 1.0:
        change = np.maximum(change, np.abs(bilerp(uv + slack * step, image, "nearest", wrap) - here))
    return change


def covered_means(rows: Floats) -> Floats:
    """Reduce rows (s, ...) to d = max(s // 2, 1): row i of the result is the mean of what lies from i*s/d to (i+1)*s/d."""
    size = len(rows)
    count = max(size // 2, 1)
    start = np.arange(count) * size  # in units of 1/d row, in which row j lies from j*d to (j+1)*d
    total = np.zeros((count, *rows.shape[1:]))
    for step in range(3):
        j = start // count + step
        overlap = np.minimum((j + 1) * count, start + size) - np.maximum(j * count, start)
        total += np.maximum(overlap, 0)[:, None, None] * rows[np.minimum(j, size - 1)]
    return total / size


def levels(image: Reals) -> list[Reals]:
    """Return the mip-map of an image (h, w, C): the image itself, then each level half the size of the previous one,
    rounded down, to 1 x 1. A texel is the mean of the area that it covers; the levels are kept as float32, as the image
    is."""
    mipmap, exact = [image], image.astype(np.float64)
    while max(exact.shape[:2]) > 1:
        exact = covered_means(covered_means(exact).swapaxes(0, 1)).swapaxes(0, 1)
        mipmap.append(exact.astype(np.float32))
    return mipmap


def level_of_detail(right: Floats, up: Floats, size: tuple[int, int], last: int) -> Floats:
    """Return lambda (...) of OpenGL 4.6, section 8.14, clamped to the levels 0 to `last`.

    right, up: (..., 2) derivatives of u and v from pixel to pixel. size: columns and rows of the image.
    rho, the larger of the two distances in texels, is what a pixel spans; lambda is log2(rho). If one is NaN or infinite
    the last level is right: for derivatives beyond all numbers, the mean of the texture.
    """
    rho = np.maximum(np.hypot(*np.moveaxis(right * size, -1, 0)), np.hypot(*np.moveaxis(up * size, -1, 0)))
    return np.asarray(np.log2(np.clip(np.where(np.isnan(rho), np.inf, rho), 1.0, 2.0**last)))


def trilinear(
    uv: Floats, right: Floats, up: Floats, mipmap: list[Reals], lookup: str, wrap: tuple[str, str], slack: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return colors (K, C) at texture coordinates uv (K, 2) that change by right and up (K, 2) from pixel to pixel: between
    the colors of the levels before and after lambda. mipmap: see `levels`. lookup: see `bilerp`.

    Also the largest magnitude among the texels looked up, (K, C), see `brightest`; an error of lambda counts likewise.
    And with `nearest` how much the color may change if uv is off by slack (K, 2).
    """
    last = len(mipmap) - 1
    detail = level_of_detail(right, up, mipmap[0].shape[1::-1], last)
    first = np.floor(detail).astype(np.int64)
    color, magnitude, apart = np.zeros((3, len(uv), mipmap[0].shape[2]))
    for level in np.unique(first):
        mine = first == level
        share = (detail[mine] - level)[:, None]
        both = mipmap[level], mipmap[min(level + 1, last)]
        fine, coarse = (bilerp(uv[mine], image, lookup, wrap) for image in both)
        color[mine] = fine * (1.0 - share) + coarse * share
        magnitude[mine] = np.maximum(*(brightest(uv[mine], image, lookup, wrap) for image in both))
        if lookup == "nearest":
            fine, coarse = (spread(uv[mine], image, wrap, slack[mine]) for image in both)
            apart[mine] = fine * (1.0 - share) + coarse * share
    return color, magnitude + apart, apart


def color_texture(mesh: Mesh) -> Texture | None:
    """Return the texture of a material's color; None without texture coordinates."""
    return None if mesh.uvs is None else mesh.material.texture


def lookup_of(texture: Texture) -> str:
    """Return the lookup of `bilerp`: the texture's own, or `nearest`."""
    return "nearest" if texture.filter == "nearest" else texture.lookup


def uv_slack(settings: Settings, uvs: Floats, condition: Floats, size: tuple[int, int]) -> Floats:
    """Return how far interpolated texture coordinates may be off, (K, 2), with those of the corners (K, 3, 2), `condition`
    (K,) of `Hits`, and a texture of `size` columns and rows.

    In float32 they are accurate to 2^-42 of the largest one at a corner, with another 2^-25 of a texel from planes
    (kernels/texture.clh), twice that with the oracle's own. Rounding of positions in float64 counts as for the weights,
    76 * 2^-53.
    """
    unit, of_texel = (0.0, 0.0) if settings.precision == "float64" else (2.0**-41, 2.0**-24)
    slack: Floats = np.abs(uvs).max(axis=(1, 2)) * np.maximum(unit, 76.0 * 2.0**-53 * condition)
    return slack[:, None] + of_texel / np.array(size)


def corner_colors(settings: Settings, corners: Corners, face: Integers) -> Floats:
    """Return colors at the corners of faces `face` (U,): (U, 3, 3).

    With texture_at=vertex the texel replaces (course lookup) or multiplies the vertex color; with texture_at=pixel a
    course texture leaves white, to be multiplied by the texel later.
    """
    colors: Floats = corners.colors[face].copy()
    for mesh, mine in corners.by_mesh(face):
        texture = color_texture(mesh)
        if texture is not None and texture.lookup == "course":
            colors[mine] = 1.0
        colors[mine] = colors[mine] * mesh.material.color
        if texture is not None and settings.texture_at == "vertex":
            uv = corners.uvs_for(texture)[face[mine]]
            colors[mine] = colors[mine] * bilerp(uv, texture.image[..., :3], texture.lookup, texture.wrap)
    return colors


@dataclass(frozen=True, eq=False)
class Looked:
    """Colors of pixels, (K, 3) each."""

    color: Floats  # 1 where none is looked up
    magnitude: Floats  # the largest among those that it is a mean of, or that rounding may give
    spread: Floats  # by how much rounding may change it where it exchanges one for another


@dataclass(frozen=True, eq=False)
class Texels(Looked):
    """Texels of pixels."""

    looked_up: Bools  # (K,) where a texture is looked up
    slack: Floats  # (K,) how many texels the place may be off by


_mipmaps: WeakKeyDictionary[Texture, list[Reals]] = WeakKeyDictionary()  # without alpha


def texels(hits: Hits, texture_of: Callable[[Mesh], Texture | None]) -> Texels:
    """Return texels of pixels."""
    shape, corners = (len(hits.face), 3), hits.shot.corners
    result = Texels(np.ones(shape), np.ones(shape), np.zeros(shape), np.zeros(shape[0], bool), np.zeros(shape[0]))
    for mesh, mine in corners.by_mesh(hits.face):
        texture = texture_of(mesh)
        if texture is None or not has_uvs(mesh, texture):
            continue
        uvs, size = corners.uvs_for(texture)[hits.face[mine]], texture.image.shape[1::-1]
        uv = interpolated(hits.weights[mine], uvs)
        slack = uv_slack(hits.shot.settings, uvs, hits.condition[mine], size)
        result.looked_up[mine], result.slack[mine] = True, (slack * size).max(axis=1)
        right, up, mipmap = np.zeros_like(uv), np.zeros_like(uv), [texture.image[..., :3]]
        if hits.steps is not None and texture.lookup == "standard":
            if texture not in _mipmaps:
                _mipmaps[texture] = levels(mipmap[0])
            with np.errstate(invalid="ignore", over="ignore"):
                right, up = (from_first(step[mine], uvs) for step in hits.steps)
            mipmap = _mipmaps[texture]
        looked_up = trilinear(uv, right, up, mipmap, lookup_of(texture), texture.wrap, slack)
        result.color[mine], result.magnitude[mine], result.spread[mine] = looked_up
    return result


# Color maps


# Of the largest position at a face's corners, in units of 2^-24 (2^-53 in float64): how far an interpolated position may
# be off. The weights of two corners are off by 2 * 17 units together, and count for differences of positions, up to twice
# the largest; positions and their differences are rounded, 3, and two fma: 2 * 34 + 3 + 2 = 73, and 3 for the oracle's own.
POSITION_UNITS = 76.0


def scaled(color_map: ColorMap, scalars: Floats) -> tuple[Floats, Floats]:
    """Return scalars (K, 3) less the map's low end, and the map's width (K,): each row divided by a power of two, so that
    no difference overflows."""
    ends = np.array([color_map.low, color_map.high])
    exponent = -np.frexp(np.maximum(np.abs(np.nan_to_num(scalars)).max(axis=1), np.abs(ends).max()))[1] - 1
    low, high = np.ldexp(ends[0], exponent), np.ldexp(ends[1], exponent)
    return np.ldexp(scalars, exponent[:, None]) - low[:, None], high - low


def rows_of(color_map: ColorMap, above_low: Floats, width: Floats) -> Integers:
    """Return the rows of the map's table for numbers given as their distances above its low end, (K,), NaN included."""
    count = color_map.count
    inside = (above_low >= 0.0) & (above_low <= width)
    # The product first: where the quotient is a whole number, it is exact.
    position = np.divide(above_low * count, width, out=np.zeros_like(above_low), where=inside & (width > 0.0))
    row = np.minimum(np.floor(position), count - 1).astype(np.int64) + 1
    beyond = above_low < 0.0, above_low > width, np.isnan(above_low)
    return np.select(beyond, (0, count + 1, count + 2), row)


def map_colors(hits: Hits) -> Looked:
    """Return the colors of pixels by scalars."""
    corners, settings, shape = hits.shot.corners, hits.shot.settings, (len(hits.face), 3)
    result = Looked(np.ones(shape), np.ones(shape), np.zeros(shape))
    scalars = settings.scalars
    if scalars is None:
        return result
    color_map = color_map_of(hits.shot.scene, scalars)
    mapped = np.flatnonzero(corners.of_meshes(lambda mesh: scalars.name in mesh.scalars)[hits.face])
    unit = np.maximum(2.0**-53 if settings.precision == "float64" else 2.0**-24, 2.0**-53 * hits.condition[mapped])
    apart, width = scaled(color_map, corners.scalars[hits.face[mapped]])
    above_low = interpolated(hits.weights[mapped], apart[..., None])[:, 0]
    slack = POSITION_UNITS * unit * np.abs(apart).max(axis=1)
    table = color_map.table.astype(np.float64)
    row = rows_of(color_map, above_low, width)
    first, last = (rows_of(color_map, above_low + side * slack, width) for side in (-1.0, 1.0))
    magnitude, spread = np.abs(table[row]), np.zeros((len(row), 3))
    for step in range(int((last - first).max(initial=0)) + 1):
        other = table[np.minimum(first + step, last)]
        magnitude = np.maximum(magnitude, np.abs(other))
        spread = np.maximum(spread, np.abs(other - table[row]))
    result.color[mapped], result.magnitude[mapped], result.spread[mapped] = table[row], magnitude, spread
    return result
