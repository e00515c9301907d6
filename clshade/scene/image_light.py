"""Light of an environment as shading reads it, computed once per environment: irradiance, and specular light.

Octahedral maps show the sphere as a square, without seams and with a few operations per lookup: a direction d is divided
by |x| + |y| + |z|; x and y of the upper half (z >= 0) fill the inner diamond of the square [-1, 1]^2, the lower half is
folded outward. Cigolle et al., A Survey of Efficient Representations for Independent Unit Vectors, JCGT 2014. Beyond an
edge the map goes on turned by half a turn about the middle of the edge.

Irradiance: Ramamoorthi and Hanrahan, An Efficient Representation for Irradiance Environment Maps, SIGGRAPH 2001. The
cosine lobe damps order l of the radiance by A_l/pi = 1, 2/3, 1/4, 0, -1/24, ..., so that spherical harmonics of orders 0
to 2 hold nearly all of the irradiance. They are moments of the radiance: with M0 = sum L, M1 = sum L w,
M2 = sum L w w^T over the sphere,

    E(n)/pi = M0/4pi + (2/3)(3/4pi) M1.n + (1/4)(5/4pi)(3/2 n.M2 n - 1/2 M0).

Specular light is that of the split sum (Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course). The first factor
is the mean of the radiance over the GGX lobe of one roughness, seen from straight above, with which view and normal
agree; octahedral maps hold it. Around the mirrored direction R it is

    sum L(l) K(R.l) / sum K(R.l),  K(c) = c D(h) for c > 0, with h halfway between R and l: (h.R)^2 = (1 + c)/2,

and D the GGX distribution with alpha = roughness^2. K depends on the angle alone, so that the symmetries of the map
save fifteen sixteenths of its values. With t = (1 - c)/2, a quarter of the squared distance of R and l, it is without
cancellation (1 - 2t) / (t + alpha^2 (1 - t))^2, but for a constant factor.

The second factor is how much light of an all-white environment a surface sends to the eye. With f = D V F of glTF 2.0
(appendix B): GGX, height-correlated Smith visibility, Schlick's F = F0 + (1 - F0) s with s = (1 - V.H)^5, the
integral of f N.L over the hemisphere is F0 A + B:

    A = integral of D V (1 - s) N.L,   B = integral of D V s N.L.

A third number belongs to the diffuse term below the specular layer, (1 - F)/pi: its integral is (1 - F0) C with
C = integral of (1 - s) N.L/pi, whatever the roughness.
"""

from __future__ import annotations

import functools
import itertools
import math
import threading
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base.arrays import Array, Floats, Integers
from ..base.validation import read_only
from .environment import Environment

TABLE_SIDE = 32  # entries of the BRDF's table along each axis
POINTS = 48  # of its quadrature along each angle
LEVELS = 9  # roughness k/8 for level k
SIDES = (512, 256, 64, 32, 32, 32, 32, 32, 32)  # texels per side: two or more within half the lobe's height
MIN_SIDE = 16  # of a sharp map
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
_known: WeakKeyDictionary[Environment, ImageLight] = WeakKeyDictionary()
_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class ImageLight:
    """irradiance: (9, 3), see `irradiance_coefficients`. levels: octahedral maps (S, S, 3), see `specular_levels`."""

    irradiance: Floats
    levels: tuple[Floats, ...]


def image_light(environment: Environment) -> ImageLight:
    """Return the light of an environment."""
    with _lock:
        if environment not in _known:
            levels = tuple(map(read_only, specular_levels(environment)))
            _known[environment] = ImageLight(read_only(irradiance_coefficients(environment)), levels)
        return _known[environment]


# Octahedral maps


def texel_directions(side: int) -> Floats:
    """Return the unit directions (side, side, 3) of the texels' centers; the first axis is y."""
    center = (np.arange(side) + 0.5) * (2.0 / side) - 1.0
    x, y = np.broadcast_arrays(center[None, :], center[:, None])
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    d = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=-1)
    return np.asarray(d / np.sqrt((d * d).sum(axis=-1, keepdims=True)))


def octahedral_positions(d: Floats) -> tuple[Floats, Floats]:
    """Return x and y in [-1, 1] of directions (..., 3) of any length but 0."""
    x, y, z = d[..., 0], d[..., 1], d[..., 2]
    ax, ay = np.abs(x), np.abs(y)
    inverse = 1.0 / (ax + ay + np.abs(z))
    ax, ay = ax * inverse, ay * inverse
    below = z < 0.0
    px, py = np.where(below, 1.0 - ay, ax), np.where(below, 1.0 - ax, ay)
    return np.copysign(px, x), np.copysign(py, y)


def texel_indices(d: Floats, side: int) -> Integers:
    """Return the indices (...) of the texels that directions (..., 3) fall into, row by row."""
    x, y = (np.minimum(((p + 1.0) * (side / 2)).astype(np.int64), side - 1) for p in octahedral_positions(d))
    return y * side + x


def with_border(level: Floats, width: int = 1) -> Floats:
    """Return a map (side, side, ...) with a border of `width` texels that continues it."""
    turned_x = level[::-1, :][:, :width], level[::-1, :][:, -width:]
    wide = np.concatenate([turned_x[0][:, ::-1], level, turned_x[1][:, ::-1]], axis=1)
    top, bottom = wide[:width, ::-1][::-1], wide[-width:, ::-1][::-1]
    return np.concatenate([top, wide, bottom], axis=0)


def bilinear(level: Floats, d: Floats) -> Floats:
    """Return the bilinear means (..., C) of a map (side, side, C) in directions (..., 3)."""
    side = len(level)
    wide = with_border(level)
    x, y = (p * (side / 2) + (side / 2 + 0.5) for p in octahedral_positions(d))
    column, row = (np.clip(np.floor(p).astype(np.int64), 0, side) for p in (x, y))
    across, down = (x - column)[..., None], (y - row)[..., None]
    top = wide[row, column] * (1.0 - across) + wide[row, column + 1] * across
    bottom = wide[row + 1, column] * (1.0 - across) + wide[row + 1, column + 1] * across
    return top * (1.0 - down) + bottom * down


# Irradiance


def solid_angles(rows: int, columns: int) -> Floats:
    """Return the solid angle of the pixels of each row, (rows,), steradian."""
    middle = _middles(np.linspace(0.0, np.pi, rows + 1))
    return np.asarray(2.0 * np.sin(middle) * np.sin(np.pi / (2.0 * rows)) * (2.0 * np.pi / columns))


def _middles(edges: Floats) -> Floats:
    return np.asarray((edges[1:] + edges[:-1]) / 2.0)


def radiance(environment: Environment, directions: Floats) -> Floats:
    """Return the radiance (..., 3) from directions (..., 3) of any length but 0, each of its own pixel."""
    rows, columns, _ = environment.image.shape
    front, left, up = np.moveaxis(directions @ environment.axes.T, -1, 0)
    u = 0.5 - np.arctan2(left, front) / (2.0 * np.pi)
    v = np.arctan2(np.hypot(front, left), up) / np.pi
    row = np.minimum((v * rows).astype(np.int64), rows - 1)
    column = np.minimum((u * columns).astype(np.int64), columns - 1)
    return np.asarray(environment.image[row, column].astype(np.float64) * environment.intensity)


def moments(environment: Environment) -> tuple[Floats, Floats, Floats]:
    """Return the integrals over the sphere of L, L w and L w w^T: (3,), (3, 3) and (3, 3, 3), channels first.

    Exact for pixels of constant radiance but for rounding: each factor is integrated in closed form.
    """
    rows, columns, _ = environment.image.shape
    # Angles from the top, and longitudes from pi on the left to -pi, between which the pixels lie.
    polar, around = np.linspace(0.0, np.pi, rows + 1), np.linspace(np.pi, -np.pi, columns + 1)
    sine, cosine = np.sin(polar), np.cos(polar)
    squares = around / 2.0 + np.sin(2.0 * around) / 4.0, around / 2.0 - np.sin(2.0 * around) / 4.0
    # The integrals of 1, cos, sin, cos^2, sin^2 and cos sin; longitudes fall from left to right.
    integrals = np.stack([around, np.sin(around), -np.cos(around), *squares, np.sin(around) ** 2 / 2.0], axis=1)
    longitude = -np.diff(integrals, axis=0)
    # One row at a time, so that nothing as large as the image is needed in float64.
    sums = np.stack([row.T.astype(np.float64) @ longitude for row in environment.image])  # (rows, 3, 6)
    s1, sc = np.diff(-cosine), np.diff(sine**2 / 2.0)
    s2 = np.diff(polar / 2.0 - np.sin(2.0 * polar) / 4.0)
    s2c, scc, s3 = np.diff(sine**3 / 3.0), np.diff(-(cosine**3) / 3.0), np.diff(cosine**3 / 3.0 - cosine)

    def total(part: Floats, factor: int) -> Floats:
        return np.asarray(part @ sums[:, :, factor]) * environment.intensity

    zeroth = total(s1, 0)
    first = np.stack([total(s2, 1), total(s2, 2), total(sc, 0)], axis=1)
    ff, ll, fl = total(s3, 3), total(s3, 4), total(s3, 5)
    fu, lu, uu = total(s2c, 1), total(s2c, 2), total(scc, 0)
    second = np.stack([np.stack([ff, fl, fu], 1), np.stack([fl, ll, lu], 1), np.stack([fu, lu, uu], 1)], axis=1)
    axes = environment.axes
    return zeroth, first @ axes, axes.T @ second @ axes


def irradiance_coefficients(environment: Environment) -> Floats:
    """Return (9, 3): the factors of x, y, z, xx, yy, zz, xy, yz, zx of a unit normal whose sum is E/pi per channel."""
    zeroth, first, second = moments(environment)
    linear = first / (2.0 * np.pi)
    square = (15.0 / (32.0 * np.pi)) * second
    # The constant term goes to the squares, of which the sum is 1.
    square = square + (zeroth / (4.0 * np.pi) - (5.0 / (32.0 * np.pi)) * zeroth)[:, None, None] * np.eye(3)
    xx, yy, zz = square[:, 0, 0], square[:, 1, 1], square[:, 2, 2]
    xy, yz, zx = 2.0 * square[:, 0, 1], 2.0 * square[:, 1, 2], 2.0 * square[:, 2, 0]
    return np.stack([*linear.T, xx, yy, zz, xy, yz, zx])


def irradiance_at(coefficients: Floats, normal: Floats) -> Floats:
    """Return E/pi per channel, (3,), for a unit normal (3,). coefficients: of `irradiance_coefficients`. At least 0."""
    x, y, z = normal
    return np.maximum(np.array([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]) @ coefficients, 0.0)


# Specular light


def sharp_map(environment: Environment) -> tuple[Floats, Floats]:
    """Return level 0, (S, S, 3) float64, and the solid angle (S, S) that its texels got.

    Every pixel, or part of a pixel in small images, goes whole to the texel of its center, weighted by its solid angle:
    nothing is lost or counted twice, so that the integral over the sphere is exact. Its side grows with the image.
    """
    rows, columns, _ = environment.image.shape
    side = min(max(MIN_SIDE, 1 << (max(columns // 4, 1) - 1).bit_length()), SIDES[0])
    down, across = -(-2 * side // rows), -(-4 * side // columns)
    row_parts, column_parts = rows * down, columns * across
    weight = solid_angles(row_parts, column_parts)
    polar = _middles(np.linspace(0.0, np.pi, row_parts + 1))
    longitude = _middles(np.linspace(np.pi, -np.pi, column_parts + 1))
    front, left, up = environment.axes
    around = np.cos(longitude)[:, None] * front + np.sin(longitude)[:, None] * left
    total = np.zeros((4, side * side))
    band = max(BAND // (down * column_parts), 1)  # rows of the image
    for start in range(0, rows, band):
        image = environment.image[start : start + band]
        part = slice(start * down, (start + len(image)) * down)
        d = np.sin(polar[part])[:, None, None] * around + np.cos(polar[part])[:, None, None] * up
        texel = texel_indices(d, side).reshape(-1)
        weights = np.repeat(weight[part], column_parts)
        total[3] += np.bincount(texel, weights, side * side)
        for channel in range(3):
            values = np.repeat(np.repeat(image[:, :, channel], down, axis=0), across, axis=1).reshape(-1)
            total[channel] += np.bincount(texel, weights * values, side * side)
    solid = total[3].reshape(side, side)
    level = np.moveaxis(total[:3], 0, -1).reshape(side, side, 3) * environment.intensity
    level /= np.where(solid > 0.0, solid, 1.0)[..., None]
    missed = solid == 0.0  # few, if any
    level[missed] = radiance(environment, texel_directions(side)[missed])
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
            sums += bilinear(far, texel_directions(side))
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
    texel = texel_directions(len(source[0])).reshape(-1, 3)
    target = texel_directions(side).reshape(-1, 3)
    # One target of each set of images under the symmetries: 0 <= y <= x, z >= 0.
    first = target[(target[:, 1] >= 0.0) & (target[:, 1] <= target[:, 0]) & (target[:, 2] >= 0.0)]
    symmetries = [np.diag(signs)[list(order)] for order in ((0, 1, 2), (1, 0, 2)) for signs in _SIGNS]
    content = _weighted(source).reshape(-1, 4)
    images = np.concatenate([content[texel_indices(texel @ g.T, len(source[0]))] for g in symmetries], axis=1)
    sums = np.empty((len(first), images.shape[1]))
    for start in range(0, len(first), _ROWS):
        chord = (1.0 - first[start : start + _ROWS] @ texel.T) / 2.0
        weight = lobe(np.maximum(chord, least_chord), alpha)
        parts = weight.reshape(len(weight), -1, _TEXELS).swapaxes(0, 1) @ images.reshape(-1, _TEXELS, images.shape[1])
        sums[start : start + _ROWS] = parts.sum(axis=0)
    result = np.empty((side * side, 4))
    for number, g in enumerate(symmetries):
        result[texel_indices(first @ g.T, side)] = sums[:, 4 * number : 4 * number + 4]
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
    d = np.moveaxis(texel_directions(side), -1, 0)
    around = [with_border(plane, width) for plane in d]
    content = [with_border(plane, width) for plane in np.moveaxis(_weighted(source), -1, 0)]
    sums = np.zeros((4, side, side))
    for row in range(2 * width + 1):
        for column in range(2 * width + 1):
            window = slice(row, row + side), slice(column, column + side)
            square = sum((plane - other[window]) ** 2 for plane, other in zip(d, around, strict=True)) / 4.0
            weight = np.maximum(lobe(square, alpha) - outside, 0.0)
            for total, part in zip(sums, content, strict=True):
                total += weight * part[window]
    return np.moveaxis(sums, 0, -1)


@functools.cache
def brdf_table() -> Floats:
    """Return A, B and C, (TABLE_SIDE, TABLE_SIDE, 3) float64, by roughness (rows) and N.V (columns) from 0 to 1."""
    steps = np.linspace(0.0, 1.0, TABLE_SIDE)
    return read_only(np.stack([np.stack(split_sum(steps, roughness), axis=-1) for roughness in steps]))


def split_sum(n_v: Floats, roughness: float, points: int = POINTS) -> tuple[Floats, Floats, Floats]:
    """Return A, B and C (...) for cosines n_v (...) and a roughness, with points^2 directions each."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    share, weight = (nodes + 1.0) / 2.0, weights[:, None] / (2.0 * points)
    azimuth = np.cos((np.arange(points) + 0.5) * (np.pi / points))
    n_v = np.asarray(n_v, np.float64)[..., None, None]
    tangent = np.sqrt(1.0 - n_v * n_v)
    a2 = roughness**4
    # Half vectors of GGX's density D N.H: their share below cos is (1 - cos^2) / (1 + cos^2 (a^2 - 1)), inverted.
    cosine2 = ((1.0 - share) / (1.0 + (a2 - 1.0) * share))[:, None]
    n_h = np.sqrt(cosine2)
    v_h = np.maximum(tangent * np.sqrt(1.0 - cosine2) * azimuth + n_v * n_h, 0.0)
    n_l = np.maximum(2.0 * v_h * n_h - n_v, 0.0)
    smith = n_l * np.sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * np.sqrt(n_l * n_l * (1.0 - a2) + a2)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.where(n_l > 0.0, 2.0 * v_h * n_l / (n_h * smith), 0.0) * weight  # D V N.L over the density of l
    fresnel = (1.0 - v_h) ** 5
    a, b = ((seen * part).sum(axis=(-2, -1)) for part in (1.0 - fresnel, fresnel))
    grazing = n_v[..., 0, 0] == 0.0
    if a2 == 0.0:  # a mirror, at grazing angles too
        a, b = np.where(grazing, 0.0, a), np.where(grazing, 1.0, b)
    # The diffuse term: N.L^2 is uniform under the cosine's density.
    n_l = np.sqrt(share)[:, None]
    l_v = tangent * np.sqrt(1.0 - n_l * n_l) * azimuth + n_v * n_l
    c = ((1.0 - (1.0 - np.sqrt((1.0 + l_v) / 2.0)) ** 5) * weight).sum(axis=(-2, -1))
    return a, b, c
