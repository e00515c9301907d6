"""Environments: their light reflected by surfaces, by the split sum as the kernels take it, and the background that they
are, with how far rounding may change both.

Functions broadcast over leading axes: normals and directions are (..., 3).
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats, Integers
from ..scene.camera import Camera
from ..scene.environment import Environment
from ..scene.image_light import OFF_MIRROR, TABLE_SIDE, brdf_table, image_light
from .microfacet import REACH, Facets, Reflected
from .transform import SAMPLE_STEPS, camera_frame, dot, unit


def extended(level: Floats) -> Floats:
    """Continue an octahedral map two texels beyond its edges, where it goes on turned by half a turn about the middle of
    the edge."""
    wide = np.concatenate([level[::-1, 1::-1], level, level[::-1, :-3:-1]], axis=1)
    return np.concatenate([wide[1::-1, ::-1], wide, wide[:-3:-1, ::-1]], axis=0)


def lookup(level: Floats, direction: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Return the bilinear means (..., 3) of an octahedral map in directions (..., 3), and how far they may be off if
    these are within `reach` (...).

    A unit vector that turns by r moves by at most 1.4 S r texels in a map of S texels a side: |d|_1 is 1 to sqrt(3), and
    the place changes by at most (1 + sqrt(3)) r of the half side S/2. The middle of a lobe is at least sqrt(1/2) long, so
    that it turns by up to 1.4 times as much: 2 S r in all. Less than a texel away the mean changes by at most the range of
    the 4 x 4 texels around it times twice the distance in texels; else by the range of the whole map.
    """
    side, d = len(level), direction / np.abs(direction).sum(axis=-1, keepdims=True)
    outside = (1.0 - np.abs(d[..., 1::-1])) * np.where(d[..., :2] < 0.0, -1.0, 1.0)
    place = np.where(d[..., 2:] < 0.0, outside, d[..., :2])
    x, y = np.moveaxis(place * (side / 2.0) + (side / 2.0 - 0.5), -1, 0)  # in texels, texel i's center at i
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    part_x, part_y = x - column, y - row
    rows, columns = (first[..., None] + np.arange(1, 5) for first in (row, column))
    around = extended(level)[rows[..., :, None], columns[..., None, :]]
    mean = np.zeros((*x.shape, 3))
    for down, share_y in enumerate((1.0 - part_y, part_y), 1):
        for across, share_x in enumerate((1.0 - part_x, part_x), 1):
            mean += (share_x * share_y)[..., None] * around[..., down, across, :]
    moved = 2.0 * side * reach
    near = 2.0 * moved[..., None] * np.ptp(around, axis=(-3, -2))
    return mean, np.where((moved < 1.0)[..., None], near, np.ptp(level, axis=(0, 1)))


def irradiance(factors: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Return E(n)/pi, (..., 3), at least 0, and the sum of its terms' magnitudes."""
    x, y, z = np.moveaxis(normal, -1, 0)
    terms = np.stack([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=-1)[..., None] * factors
    return np.maximum(terms.sum(axis=-2), 0.0), np.abs(terms).sum(axis=-2)


def shares(n_v: Floats, roughness: Floats) -> tuple[Floats, Floats]:
    """Return A, B and the diffuse term's 1 - C (..., 3) of `brdf_table`, bilinear, and their largest slopes nearby."""
    table = brdf_table() * (1.0, 1.0, -1.0) + (0.0, 0.0, 1.0)
    x, y = np.broadcast_arrays(n_v * (TABLE_SIDE - 1), roughness * (TABLE_SIDE - 1))
    column, row = (np.clip(np.floor(p).astype(np.int64), 0, TABLE_SIDE - 2) for p in (x, y))
    across, down = (x - column)[..., None], (y - row)[..., None]
    top = table[row, column] * (1.0 - across) + table[row, column + 1] * across
    bottom = table[row + 1, column] * (1.0 - across) + table[row + 1, column + 1] * across
    rows, columns = (np.clip(first[..., None] + np.arange(-1, 3), 0, TABLE_SIDE - 1) for first in (row, column))
    slope: Floats = np.ptp(table[rows[..., :, None], columns[..., None, :]], axis=(-3, -2)) * (TABLE_SIDE - 1)
    return top * (1.0 - down) + bottom * down, slope


def reflected(
    environment: Environment, normal: Floats, view: Floats, facets: Facets, max_color: Floats, reach: Floats
) -> Reflected:
    """Return the light of an environment that surfaces reflect, by the split sum; `microfacet.reflected` is for lights.

    normal, view: (..., 3) unit or 0, view toward the eye. max_color: (..., 3) the largest color that errors are relative
    to. reach: (...) how far rounding may turn a direction.

    Errors: the irradiance is a polynomial of degree 2 with slopes at most twice its terms' magnitudes; the maps are
    `lookup`'s; the shares of the BRDF have their slope. Each is divided by `reach`, the unit of errors, and counts besides
    as itself, for the roundings of its own sums and of its table.
    """
    light, roughness = image_light(environment), facets.roughness
    dielectric, metal = (1.0 - facets.metallic)[..., None], facets.metallic[..., None]
    f0, f90, base = dielectric * facets.f0, dielectric * facets.f90[..., None], dielectric * facets.diffuse
    facing, alpha = np.clip(dot(normal, view), 0.0, 1.0), (roughness**2)[..., None]
    mirrored = 2.0 * normal * facing[..., None] - view
    share = (1.0 - alpha) * (1.0 + OFF_MIRROR * alpha)
    mirrored = share * mirrored + (1.0 - share) * normal  # the middle of a lobe that the horizon cuts off
    visible = ((view != 0.0).any(axis=-1) & (normal != 0.0).any(axis=-1))[..., None]
    mirrored = np.where(visible, mirrored, (0.0, 0.0, 1.0))
    share, slope = shares(facing, roughness)
    diffuse, terms = irradiance(light.irradiance, normal)
    blur, off = (np.where(visible, part, 0.0) for part in _blurred(light.levels, mirrored, roughness, reach))
    a, b, grazing = (share[..., k, None] for k in range(3))
    max_f0 = facets.f0.max(axis=-1)[..., None]
    below = 1.0 - max_f0 + (max_f0 - facets.f90[..., None]) * grazing
    color, steep = np.maximum(np.abs(max_color), 1.0), slope[..., :2].max(axis=-1)[..., None]
    of_lobe = off * (1.0 / reach[..., None]) * (a + b) + blur * (a + b + 2.0 * steep)
    return Reflected(
        tinted=base * diffuse * below + metal * blur * a,
        plain=(f0 * a + (f90 + metal) * b) * blur,
        spread=base * color * terms * (4.0 + slope[..., 2:]) + (f0 + f90 + metal * color) * of_lobe,
    )


def _blurred(levels: tuple[Floats, ...], mirrored: Floats, roughness: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Return the radiance blurred by lobes of roughness (...) around directions, and how far it may be off."""
    steps = len(levels) - 1  # roughness k over steps for level k
    level = np.minimum(np.floor(roughness * steps), steps - 1).astype(np.int64)
    alpha, next_alpha = (((level + k) / steps) ** 2 for k in (0, 1))
    fraction = ((roughness**2 - alpha) / (next_alpha - alpha))[..., None]
    blur, off = np.zeros_like(mirrored), np.zeros_like(mirrored)
    for number in np.unique(level):
        here = level == number
        first, second = (lookup(levels[number + k], mirrored[here], reach[here]) for k in (0, 1))
        part = fraction[here]
        blur[here] = (1.0 - part) * first[0] + part * second[0]
        off[here] = (1.0 - part) * first[1] + part * second[1]
    return blur, off


# The background


def rays(camera: Camera, x: Integers, y: Integers) -> Floats:
    """Return unit directions (K, 3), world space, of the rays through points of the image (K,), 1/256 px, y up."""
    axes = camera_frame(camera)
    if camera.orthographic:
        return np.tile(axes[2], (len(x), 1))
    (height, width), (columns, rows), principal = camera.plane, camera.resolution, camera.principal
    right = (x / (SAMPLE_STEPS * columns) - principal[0]) * (width / camera.focal)
    up = (y / (SAMPLE_STEPS * rows) - principal[1]) * (height / camera.focal)
    return unit(right[:, None] * axes[0] + up[:, None] * axes[1] + axes[2])


def seen(environment: Environment, directions: Floats, precision: str) -> tuple[Floats, Floats]:
    """Return the radiance (K, 3) in unit directions (K, 3), bilinear between the centers of pixels, and the budget (K, 3)
    of its errors. At a pole the first or last row is interpolated to its mean, so that the radiance is continuous there.

    A direction that turns by r moves by at most 2 h/pi r rows, since the row at a pole is half as far away as the others,
    and by w/(2 pi) min(h, 1/sin) r columns: within half a row of a pole, where longitudes turn faster, they count the less.
    Less than a pixel away the mean changes by at most twice that distance times the range of the pixels around, else by the
    range of the image.
    """
    rows, columns, _ = environment.image.shape
    front, left, up = (directions @ axis for axis in environment.axes)
    longitude, polar = np.arctan2(left, front), np.arctan2(np.hypot(left, front), up)
    x, y = columns * (0.5 - longitude / (2.0 * np.pi)) - 0.5, rows * polar / np.pi - 0.5
    column = np.floor(x).astype(np.int64)
    row = np.clip(np.floor(y).astype(np.int64), -1, rows - 1)
    across, down = (x - column)[:, None], (y - row)[:, None]
    down = np.where((row == -1)[:, None], 2.0 * down - 1.0, np.where((row == rows - 1)[:, None], 2.0 * down, down))
    first, last = (environment.image[k].astype(np.float64) * environment.intensity for k in (0, -1))

    def pixel(k: int, i: int) -> Floats:
        """Return the pixels k rows below and i columns to the right of the one above and to the left."""
        at = (row + k)[:, None]
        inside = environment.image[np.clip(row + k, 0, rows - 1), (column + i) % columns].astype(np.float64)
        beyond = np.where(at < 0, first.mean(axis=0), last.mean(axis=0))
        return np.asarray(np.where((at < 0) | (at >= rows), beyond, inside * environment.intensity))

    upper = (1.0 - across) * pixel(0, 0) + across * pixel(0, 1)
    lower = (1.0 - across) * pixel(1, 0) + across * pixel(1, 1)
    radiance = (1.0 - down) * upper + down * lower
    around = np.array([pixel(k, i) for k in (-1, 0, 1, 2) for i in (-1, 0, 1, 2)])
    low, high = around.min(axis=0), around.max(axis=0)
    for near, end in ((row <= 0, first), (row >= rows - 2, last)):  # all longitudes meet there
        low = np.where(near[:, None], np.minimum(low, end.min(axis=0)), low)
        high = np.where(near[:, None], np.maximum(high, end.max(axis=0)), high)
    reach = REACH[precision]
    sine = np.maximum(np.sin(polar), 1.0 / rows)
    moved = reach * (2.0 * rows / np.pi + columns / (2.0 * np.pi * sine))[:, None]
    image_max = float(environment.image.max()) * environment.intensity
    off = np.where(moved < 1.0, 2.0 * moved * (high - low), image_max)
    limit = np.finfo(np.float64 if precision == "float64" else np.float32).max  # where samples saturate
    return np.minimum(radiance, float(limit)), radiance + off / reach
