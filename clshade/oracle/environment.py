"""Image-based light: the split sum as the kernels take it, with how far rounding may change it, and the true integral.

Functions broadcast over leading axes: normals and directions are (..., 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Integers
from ..scene.environment import Environment
from ..scene.image_light.brdf_table import SIDE, brdf_table
from ..scene.image_light.irradiance import radiance
from ..scene.image_light.light import image_light
from ..scene.image_light.specular import OFF_MIRROR
from . import microfacet
from .microfacet import Facets, Reflected, alpha_of
from .vectors import dot, unit


def folded(side: int, column: Integers, row: Integers) -> tuple[Integers, Integers]:
    """Return the texels that continue an octahedral map beyond its edges, where it goes on turned by half a turn about the
    middle of the edge."""
    for low in (True, False):
        beyond = (column < 0) if low else (column >= side)
        column, row = (
            np.where(beyond, (-1 if low else 2 * side - 1) - column, column),
            np.where(beyond, side - 1 - row, row),
        )
    for low in (True, False):
        beyond = (row < 0) if low else (row >= side)
        column, row = (
            np.where(beyond, side - 1 - column, column),
            np.where(beyond, (-1 if low else 2 * side - 1) - row, row),
        )
    return column, row


def octahedral_place(direction: Floats, side: int) -> tuple[Floats, Floats]:
    """Return where directions (..., 3) lie in an octahedral map, in texels, with texel i's center at i."""
    d = direction / np.abs(direction).sum(axis=-1, keepdims=True)
    sign = np.where(d[..., :2] < 0.0, -1.0, 1.0)
    outside = (1.0 - np.abs(d[..., 1::-1])) * sign
    place = np.where(d[..., 2:] < 0.0, outside, d[..., :2])
    x, y = np.moveaxis(place * (side / 2.0) + (side / 2.0 - 0.5), -1, 0)
    return x, y


def lookup(level: Floats, direction: Floats, reach: Floats) -> tuple[Floats, Floats]:
    """Return the bilinear means (..., 3) of a map, and how far they may be off if directions are within `reach` (...).

    A unit vector that turns by r moves by at most 1.4 S r texels in a map of S texels a side: |d|_1 is 1 to sqrt(3), and the
    place changes by at most (1 + sqrt(3)) r of the half side S/2. The middle of a lobe is at least sqrt(1/2) long, so that
    it turns by up to 1.4 times as much: 2 S r in all. Less than a texel away the mean changes by at most the
    range of the 4 x 4 texels around it times twice the distance in texels; else by the range of the whole map.
    """
    side = len(level)
    x, y = octahedral_place(direction, side)
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    part_x, part_y = x - column, y - row
    mean = np.zeros((*x.shape, 3))
    low, high = np.full_like(mean, np.inf), np.full_like(mean, -np.inf)
    for down in (-1, 0, 1, 2):
        for across in (-1, 0, 1, 2):
            at = folded(side, column + across, row + down)
            texel = level[at[1], at[0]]
            low, high = np.minimum(low, texel), np.maximum(high, texel)
            if down in (0, 1) and across in (0, 1):
                share = (part_x if across else 1.0 - part_x) * (part_y if down else 1.0 - part_y)
                mean += share[..., None] * texel
    moved = 2.0 * side * reach
    whole = level.max(axis=(0, 1)) - level.min(axis=(0, 1))
    return mean, np.where((moved < 1.0)[..., None], 2.0 * moved[..., None] * (high - low), whole)


def irradiance(factors: Floats, normal: Floats) -> tuple[Floats, Floats]:
    """Return E(n)/pi, (..., 3), at least 0, and the sum of its terms' magnitudes."""
    x, y, z = np.moveaxis(normal, -1, 0)
    terms = np.stack([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=-1)[..., None] * factors
    return np.maximum(terms.sum(axis=-2), 0.0), np.abs(terms).sum(axis=-2)


def shares(n_v: Floats, roughness: Floats) -> tuple[Floats, Floats]:
    """Return A, B and the diffuse term's 1 - C (..., 3) of `brdf_table`, bilinear, and their largest slopes nearby."""
    table = brdf_table() * (1.0, 1.0, -1.0) + (0.0, 0.0, 1.0)
    x, y = np.broadcast_arrays(n_v * (SIDE - 1), roughness * (SIDE - 1))
    column, row = (np.clip(np.floor(p).astype(np.int64), 0, SIDE - 2) for p in (x, y))
    across, down = (x - column)[..., None], (y - row)[..., None]
    top = table[row, column] * (1.0 - across) + table[row, column + 1] * across
    bottom = table[row + 1, column] * (1.0 - across) + table[row + 1, column + 1] * across
    around = np.stack(
        [
            table[np.clip(row + i, 0, SIDE - 1), np.clip(column + j, 0, SIDE - 1)]
            for i in (-1, 0, 1, 2)
            for j in (-1, 0, 1, 2)
        ]
    )
    slope: Floats = (around.max(axis=0) - around.min(axis=0)) * (SIDE - 1)
    return top * (1.0 - down) + bottom * down, slope


@dataclass(frozen=True, eq=False)
class Around:
    """Where an environment is reflected: unit normals (..., 3) or 0, unit directions to the eye or 0, parameters, the
    largest color that errors are relative to, and how far rounding may turn a direction, (...)."""

    normal: Floats
    view: Floats
    facets: Facets
    most: Floats
    reach: Floats


def reflected(environment: Environment, at: Around) -> Reflected:
    """Return what surfaces reflect of an environment by the split sum, as `microfacet.reflected` does of lights.

    Errors: the irradiance is a polynomial of degree 2 with slopes at most twice its terms' magnitudes; the maps are
    `lookup`'s; the shares of the BRDF have their slope. Each is divided by `reach`, the unit of errors, and counts besides
    as itself, for the roundings of its own sums and of its table.
    """
    light, facets, roughness = image_light(environment), at.facets, at.facets.roughness
    dielectric = (1.0 - facets.metallic)[..., None]
    metal, f90 = facets.metallic[..., None], dielectric * facets.f90[..., None]
    n_v = dot(at.normal, at.view)
    facing = np.clip(n_v, 0.0, 1.0)
    mirrored = 2.0 * at.normal * facing[..., None] - at.view
    alpha = (roughness**2)[..., None]
    share = (1.0 - alpha) * (1.0 + OFF_MIRROR * alpha)
    mirrored = share * mirrored + (1.0 - share) * at.normal  # the middle of a lobe that the horizon cuts off
    seen = (at.view != 0.0).any(axis=-1) & (at.normal != 0.0).any(axis=-1)
    mirrored = np.where(seen[..., None], mirrored, (0.0, 0.0, 1.0))
    share, slope = shares(facing, roughness)
    diffuse, terms = irradiance(light.irradiance, at.normal)
    blur, off = _blurred(light.levels, mirrored, roughness, at.reach)
    blur, off = (np.where(seen[..., None], value, 0.0) for value in (blur, off))
    a, b, grazing = (share[..., k, None] for k in range(3))
    most_f0 = facets.f0.max(axis=-1)[..., None]
    below = 1.0 - most_f0 + (most_f0 - facets.f90[..., None]) * grazing
    base = dielectric * facets.diffuse
    tinted = base * diffuse * below + metal * blur * a
    plain = (dielectric * facets.f0 * a + (f90 + metal) * b) * blur
    color = np.maximum(np.abs(at.most), 1.0)
    strength = dielectric * facets.f0 + f90 + metal * color
    per_reach = 1.0 / at.reach[..., None]
    steep = slope[..., :2].max(axis=-1)[..., None]
    spread = base * color * terms * (4.0 + slope[..., 2:]) + strength * (
        off * per_reach * (a + b) + blur * (a + b + 2.0 * steep)
    )
    return Reflected(tinted, plain, spread)


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


def true_reflection(environment: Environment, at: Around, points: int = 128) -> Reflected:
    """Return the integrals over the environment itself of diffuse and specular reflection, for K points, by quadrature with
    points^2 directions each: in equal shares of the cosine for the diffuse term and of GGX's normals for the lobe.

    spread is 0. Slow; rough where the environment has small bright spots.
    """
    facets = at.facets
    share = (np.arange(points) + 0.5) / points
    turn = 2.0 * np.pi * share
    total = [np.zeros(np.shape(at.normal)) for _ in range(2)]
    for k, (n, v) in enumerate(zip(at.normal, at.view, strict=True)):
        one = facets[k]
        alpha = float(alpha_of(one.roughness))
        side = unit(np.cross(n, np.eye(3)[np.abs(n).argmin()]))
        frame = np.stack([side, np.cross(n, side), n])
        dielectric = 1.0 - one.metallic
        # Diffuse: cos^2 of the angle to the normal is uniform.
        light = _around(np.sqrt(share), turn) @ frame
        v_h = np.sqrt((1.0 + light @ v) / 2.0)
        schlick = microfacet.schlick(np.full(3, one.f0.max()), one.f90, v_h)
        total[0][k] = dielectric * one.diffuse * (radiance(environment, light) * (1.0 - schlick)).mean(axis=(0, 1))
        # The lobe: normals in equal shares of D N.H.
        half = _around(1.0 / np.sqrt(1.0 + alpha * alpha * share / (1.0 - share)), turn) @ frame
        v_h, n_h = half @ v, half @ n
        light = 2.0 * v_h[..., None] * half - v
        n_l = light @ n
        lit = (v_h > 0.0) & (n_l > 0.0)
        passing = microfacet.passing(np.where(lit, n_l, 0.0), np.asarray(max(n @ v, 0.0)), np.asarray(alpha))
        weight = np.where(lit, 4.0 * passing * v_h / n_h, 0.0)[..., None] * radiance(environment, light)
        grazing = ((1.0 - np.clip(v_h, 0.0, 1.0)) ** 5)[..., None]
        total[0][k] += one.metallic * (weight * (1.0 - grazing)).mean(axis=(0, 1))
        edge = dielectric * one.f90 + one.metallic
        total[1][k] = (weight * (dielectric * one.f0 * (1.0 - grazing) + edge * grazing)).mean(axis=(0, 1))
    return Reflected(total[0], total[1], np.zeros_like(total[0]))


def _around(cosine: Floats, turn: Floats) -> Floats:
    """Return the directions (C, T, 3) at angles to z with these cosines, and at angles `turn` about it."""
    sine = np.sqrt(1.0 - cosine * cosine)[:, None]
    upward = np.broadcast_to(cosine[:, None], (len(cosine), len(turn)))
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), upward], axis=-1)
