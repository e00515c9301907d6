"""Specular light of an environment: octahedral maps of its radiance, each blurred by the GGX lobe of one roughness.

The first factor of the split sum (Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course): the mean of the
radiance over the lobe seen from straight above, with which view and normal agree. Around the mirrored direction R it is

    sum L(l) K(R.l) / sum K(R.l),  K(c) = c D(h) for c > 0, with h halfway between R and l: (h.R)^2 = (1 + c)/2,

and D the GGX distribution with alpha = roughness^2. K depends on the angle alone, so that the symmetries of the map
save fifteen sixteenths of its values. With t = (1 - c)/2, a quarter of the squared distance of R and l, it is without
cancellation (1 - 2t) / (t + alpha^2 (1 - t))^2, but for a constant factor.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ...base.arrays import Array, Floats
from ..environment import Environment
from . import octahedral
from .irradiance import column_edges, radiance, row_edges, solid_angles

LEVELS = 9  # roughness k/8 for level k
SIDES = (512, 256, 64, 32, 32, 32, 32, 32, 32)  # texels per side: two or more within half the lobe's height
LEAST_SIDE = 16  # of a sharp map
SOURCE_SIDE = 128  # of the map that lobes are summed over: 4 texels or more within half the height of each
WIDE_SOURCE_SIDE = 64  # from WIDE on
WIDE = 3
# Where the middle of a lobe lies when it is seen at an angle: this many times alpha, times 1 - alpha, more than 1 - alpha of
# the way from the normal to the mirrored view.
OFF_MIRROR = 0.375
NEAR_TEXELS = 14  # of SIDES[1]: half the width of the window in which narrow lobes are summed texel by texel
BAND = 1 << 20  # pixels at once
# Sums are taken of so many lobes over so many texels at once: 2^18 products, which no BLAS spreads over threads, whose
# meetings take longer than the sums on a busy machine.
_ROWS, _TEXELS = 32, 128
_SIGNS = [np.array(signs, np.float64) for signs in itertools.product((1, -1), repeat=3)]


def sharp_map(environment: Environment) -> tuple[Floats, Floats]:
    """Return level 0, (S, S, 3) float64, and the solid angle (S, S) that its texels got.

    Every pixel, or part of a pixel in small images, goes whole to the texel of its center, weighted by its solid angle:
    nothing is lost or counted twice, so that the integral over the sphere is exact. Its side grows with the image.
    """
    rows, columns, _ = environment.image.shape
    side = min(max(LEAST_SIDE, 1 << (max(columns // 4, 1) - 1).bit_length()), SIDES[0])
    down, across = -(-2 * side // rows), -(-4 * side // columns)
    row_parts, column_parts = rows * down, columns * across
    weight = solid_angles(row_parts, column_parts)
    polar = (row_edges(row_parts)[1:] + row_edges(row_parts)[:-1]) / 2.0
    longitude = (column_edges(column_parts)[1:] + column_edges(column_parts)[:-1]) / 2.0
    front, left, up = environment.axes
    around = np.cos(longitude)[:, None] * front + np.sin(longitude)[:, None] * left
    total = np.zeros((4, side * side))
    band = max(BAND // (down * column_parts), 1)  # rows of the image
    for start in range(0, rows, band):
        image = environment.image[start : start + band]
        part = slice(start * down, (start + len(image)) * down)
        d = np.sin(polar[part])[:, None, None] * around + np.cos(polar[part])[:, None, None] * up
        texel = octahedral.texels(d, side).reshape(-1)
        weights = np.repeat(weight[part], column_parts)
        total[3] += np.bincount(texel, weights, side * side)
        for channel in range(3):
            values = np.repeat(np.repeat(image[:, :, channel], down, axis=0), across, axis=1).reshape(-1)
            total[channel] += np.bincount(texel, weights * values, side * side)
    solid = total[3].reshape(side, side)
    level = np.moveaxis(total[:3], 0, -1).reshape(side, side, 3) * environment.intensity
    level /= np.where(solid > 0.0, solid, 1.0)[..., None]
    missed = solid == 0.0  # few, if any
    level[missed] = radiance(environment, octahedral.directions(side)[missed])
    return level, solid


def specular_levels(environment: Environment) -> tuple[Floats, ...]:
    """Return LEVELS octahedral maps (S, S, 3) float64: of radiance blurred by the lobes of roughness 0, 1/8, ..., 1."""
    sharp = sharp_map(environment)
    source = _halved(sharp, SOURCE_SIDE)
    levels = [sharp[0]]
    for k in range(1, LEVELS):
        alpha, side = (k / (LEVELS - 1)) ** 2, min(SIDES[k], len(sharp[0]))
        if k == 1 and side >= SOURCE_SIDE:
            sums = _near_sums(_halved(sharp, side), alpha)
            far = _sums(source, side // 4, alpha, _near_chord(side))
            sums += octahedral.lookup(far, octahedral.directions(side))
        else:
            sums = _sums(_halved(source, WIDE_SOURCE_SIDE) if k >= WIDE else source, side, alpha)
        levels.append(sums[..., :3] / sums[..., 3:])
    return tuple(levels)


def lobe(chord: Array | float, alpha: float) -> Array:
    """Return K of directions whose difference has the squared length 4 * chord: their cosine is 1 - 2 * chord."""
    spread = chord + alpha * alpha * (1.0 - chord)
    return np.maximum(1.0 - 2.0 * chord, 0.0) / (spread * spread)


def _halved(level: tuple[Floats, Floats], side: int) -> tuple[Floats, Floats]:
    """Return a map and its solid angles with at most `side` texels a side: means of 2 x 2 texels by solid angle."""
    values, solid = level
    while len(solid) > side:
        n = len(solid) // 2
        product = (values * solid[..., None]).reshape(n, 2, n, 2, 3).sum(axis=(1, 3))
        solid = solid.reshape(n, 2, n, 2).sum(axis=(1, 3))
        values = product / solid[..., None]
    return values, solid


def _weighted(level: tuple[Floats, Floats]) -> Floats:
    """Return (S, S, 4): radiance times solid angle, and the solid angle."""
    values, solid = level
    return np.concatenate([values * solid[..., None], solid[..., None]], axis=2)


def _sums(source: tuple[Floats, Floats], side: int, alpha: float, least_chord: float = 0.0) -> Floats:
    """Return the sums over all texels of a map, (side, side, 4): of radiance times K, and of K. least_chord: nearer
    texels count as if they were so far away."""
    texel = octahedral.directions(len(source[0])).reshape(-1, 3)
    target = octahedral.directions(side).reshape(-1, 3)
    # One target of each set of images under the symmetries: 0 <= y <= x, z >= 0.
    first = target[(target[:, 1] >= 0.0) & (target[:, 1] <= target[:, 0]) & (target[:, 2] >= 0.0)]
    symmetries = [np.diag(signs)[list(order)] for order in ((0, 1, 2), (1, 0, 2)) for signs in _SIGNS]
    content = _weighted(source).reshape(-1, 4)
    images = np.concatenate([content[octahedral.texels(texel @ g.T, len(source[0]))] for g in symmetries], axis=1)
    sums = np.empty((len(first), images.shape[1]))
    for start in range(0, len(first), _ROWS):
        chord = (1.0 - first[start : start + _ROWS] @ texel.T) / 2.0
        weight = lobe(np.maximum(chord, least_chord), alpha)
        parts = weight.reshape(len(weight), -1, _TEXELS).swapaxes(0, 1) @ images.reshape(-1, _TEXELS, images.shape[1])
        sums[start : start + _ROWS] = parts.sum(axis=0)
    result = np.empty((side * side, 4))
    for number, g in enumerate(symmetries):
        result[octahedral.texels(first @ g.T, side)] = sums[:, 4 * number : 4 * number + 4]
    return result.reshape(side, side, 4)


def _near_chord(side: int) -> float:
    """Return the chord within which all texels lie in the window of `_near_sums`: a texel is at least sqrt(2)/side wide
    in every direction."""
    return (NEAR_TEXELS * math.sqrt(2.0) / SIDES[1]) ** 2 / 4.0


def _near_sums(source: tuple[Floats, Floats], alpha: float) -> Floats:
    """Return the rest of `_sums`, what the nearest texels contribute beyond K at their largest distance, in a map of the
    source's size, (S, S, 4)."""
    side, chord = len(source[0]), _near_chord(len(source[0]))
    width, outside = NEAR_TEXELS * side // SIDES[1], float(lobe(chord, alpha))
    d = np.moveaxis(octahedral.directions(side), -1, 0)
    around = [octahedral.padded(plane, width) for plane in d]
    content = [octahedral.padded(plane, width) for plane in np.moveaxis(_weighted(source), -1, 0)]
    sums = np.zeros((4, side, side))
    for row in range(2 * width + 1):
        for column in range(2 * width + 1):
            window = slice(row, row + side), slice(column, column + side)
            square = sum((plane - other[window]) ** 2 for plane, other in zip(d, around, strict=True)) / 4.0
            weight = np.maximum(lobe(square, alpha) - outside, 0.0)
            for total, part in zip(sums, content, strict=True):
                total += weight * part[window]
    return np.moveaxis(sums, 0, -1)
