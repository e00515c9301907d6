"""The metallic-roughness model of glTF 2.0, appendix B: GGX's distribution, Smith's height-correlated visibility, Schlick's
Fresnel reflectance, its maps, and how far rounding may change them.

Functions broadcast over leading axes: points, directions and colors are (..., 3). Reflected light is pi times the
specification's: a white diffuse surface that faces a light of intensity 1 sends 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..base.arrays import Bools, Floats
from ..scene.model import MIN_ROUGHNESS, Material
from .corners import blend
from .lights import Directions, Interaction, LightSample
from .shot import Hits
from .texture import Texels, texels
from .transform import cross, dot, length

# How far rounding may move a unit vector or a cosine, by precision: the roundings that `oracle_bounds.ALLOWED` allows.
REACH = {"float32": 32.0 * 2.0**-24, "float64": 1e-12}


@dataclass(frozen=True, eq=False)
class Facets:
    """Parameters of some surfaces."""

    diffuse: Floats  # (..., 3) factor of the color
    f0: Floats  # (..., 3), the dielectric's reflectance at normal incidence
    f90: Floats  # (...), at grazing incidence
    metallic: Floats
    roughness: Floats
    emission: Floats  # (..., 3)

    def __getitem__(self, index: object) -> Facets:
        return Facets(*(getattr(self, field.name)[index] for field in fields(Facets)))

    @property
    def of_dielectric(self) -> tuple[Floats, Floats, Floats, Floats]:
        """GGX's alpha, the dielectric's part of the surface, and its f0 and f90 times that."""
        part = 1.0 - self.metallic
        return alpha_of(self.roughness), part, part[..., None] * self.f0, part * self.f90


def facets_of(materials: Sequence[Material]) -> Facets:
    """Return the parameters of materials, (U,); of none, those of one."""
    rows = []
    for material in materials or [Material()]:
        facet = material.microfacets
        parameters = facet.dielectric_f0, facet.specular, facet.metallic, facet.roughness, facet.emission
        rows.append((material.diffuse, *parameters))
    return Facets(*(np.array(column, np.float64) for column in zip(*rows, strict=True)))


def alpha_of(roughness: Floats) -> Floats:
    """Return GGX's alpha (...)."""
    return np.asarray(np.maximum(roughness, MIN_ROUGHNESS) ** 2)


def distribution(beside: Floats, alpha: Floats) -> Floats:
    """Return pi times GGX's distribution of normals, at most 1/alpha^2. beside: |N x H|."""
    x2, a2 = beside * beside, alpha * alpha
    ratio = alpha / (x2 + a2 * (1.0 - x2))
    return np.asarray(ratio * ratio)


def passing(n_l: Floats, n_v: Floats, alpha: Floats) -> Floats:
    """Return N.L times Smith's height-correlated visibility, G / (4 N.L N.V) N.L. It grows with N.L and falls with N.V,
    each at least 0; 0 where N.L is 0."""
    a2 = alpha * alpha
    shadowed, masked = (np.sqrt(a2 + (1.0 - a2) * x * x) for x in (n_l, n_v))
    lit = n_l > 0.0
    return np.where(lit, 0.5 * n_l / np.where(lit, n_l * masked + n_v * shadowed, 1.0), 0.0)


def schlick(f0: Floats, f90: Floats, v_h: Floats) -> Floats:
    """Return the reflectance (..., 3) of f0 (..., 3) and f90, v_h (...)."""
    grazing = ((1.0 - v_h) ** 5)[..., None]
    return np.asarray(f0 * (1.0 - grazing) + np.asarray(f90)[..., None] * grazing)


@dataclass(frozen=True, eq=False)
class Angles:
    """Cosines at points, (...)."""

    n_l: Floats  # N.L
    n_v: Floats  # N.V
    v_h: Floats  # V.H
    beside: Floats  # |N x H|, 1 where N.H < 0
    mirrors: Floats  # whether there is a direction to the eye


def angles(directions: Directions) -> Angles:
    """Return the cosines between directions; N.L and N.V below 0 count as 0."""
    n, towards_light, view = directions
    both = towards_light + view
    size = length(both)
    half = both / np.where(size > 0.0, size, 1.0)[..., None]
    n_h = dot(n, half)
    beside = np.where(n_h > 0.0, length(half - n * n_h[..., None]), 1.0)
    mirrors = (view != 0.0).any(axis=-1) & (size > 0.0)
    v_h = np.where((view != 0.0).any(axis=-1), 0.5 * size, 1.0)
    n_l, n_v = np.maximum(dot(n, towards_light), 0.0), np.maximum(dot(n, view), 0.0)
    return Angles(n_l, n_v, np.minimum(v_h, 1.0), np.minimum(beside, 1.0), mirrors)


@dataclass(frozen=True, eq=False)
class Reflected:
    """Light of white light sources summed over them, (..., 3)."""

    tinted: Floats  # by the color
    plain: Floats
    spread: Floats  # how much light there is to be rounded, in units of which errors are counted


def reflected(
    at: Interaction,
    facets: Facets,
    max_color: Floats,
    reach: float,
    wear: Floats | float = 0.0,
    reaching: Floats | None = None,
) -> Reflected:
    """Return the light that surfaces reflect, and how far rounding may change it.

    max_color: (..., 3) the largest color that errors are relative to. reach: see `REACH`. wear: (...) how far the roughness
    and the metallic part may be off, over `reach`. reaching: factors of `at.samples`, (L, ...), which `spread` does not
    know.

    A cosine within r of its value, r being `reach` times the light's own condition number, bounds distribution, visibility
    and reflectance from above and below, since each is monotonic; so their product lies between two values. Their
    difference over r, and the larger one for the roundings of the product itself, are what the lobe adds to `spread`. Its
    relative change with alpha is at most 3/alpha, hence 6/roughness with the roughness; the reflectance changes with the
    metallic part by at most the larger one of color and 1.
    """
    shape = np.broadcast_shapes(at.point.shape, at.normal.shape, facets.f0.shape)
    tinted, plain, spread = np.zeros((3, *shape))
    for k, sample in enumerate(at.samples):
        share = sample.share * (1.0 if reaching is None else reaching[k])
        parts = _reflected_of(sample.intensity * share[..., None], angles(sample.directions), facets)
        for part in parts[:2]:
            tinted += part
        plain += parts[2]
        spread += np.abs(sample.max_arriving) * _spread_of(sample, facets, max_color, reach, np.asarray(wear))
    return Reflected(tinted, plain, spread)


def _reflected_of(arriving: Floats, at: Angles, facets: Facets) -> tuple[Floats, Floats, Floats]:
    """Return the light that surfaces reflect, (..., 3) each: diffuse, in the metal's lobe, both tinted by the color, and in
    the dielectric's."""
    alpha, dielectric, f0, f90 = facets.of_dielectric
    lobe = np.where(at.mirrors, distribution(at.beside, alpha) * passing(at.n_l, at.n_v, alpha), 0.0)
    below = 1.0 - schlick(facets.f0.max(axis=-1, keepdims=True), facets.f90, at.v_h)
    grazing = (1.0 - at.v_h) ** 5
    plain = f0 * (1.0 - grazing)[..., None] + (f90 + facets.metallic)[..., None] * grazing[..., None]
    return (
        arriving * (dielectric[..., None] * facets.diffuse * at.n_l[..., None] * below),
        arriving * (facets.metallic * lobe * (1.0 - grazing))[..., None],
        arriving * plain * lobe[..., None],
    )


def _spread_of(sample: LightSample, facets: Facets, max_color: Floats, reach: float, wear: Floats) -> Floats:
    """Return the contribution of a light of intensity 1 to `Reflected.spread`."""
    alpha, dielectric, f0, f90 = facets.of_dielectric
    at, color = angles(sample.directions), np.maximum(np.abs(max_color), 1.0)
    r = reach * np.maximum(np.nan_to_num(sample.kappa, nan=1e300, posinf=1e300), 1.0)
    low, high = _lobe_range(at, alpha, f0 + facets.metallic[..., None] * color, f90 + facets.metallic, r)
    brightest = _lobe_range(at, alpha, np.ones_like(color), np.ones_like(facets.f90), r)[1]
    worn = wear[..., None] * (6.0 / np.sqrt(alpha)[..., None] * high + color * brightest)
    mirrors = (sample.at.has_normal & at.mirrors)[..., None]
    lobes = np.where(mirrors, (high - low) / r[..., None] + high + worn, 0.0)
    diffuse = 2.0 * (dielectric[..., None] * facets.diffuse) + wear[..., None] * facets.diffuse
    return np.asarray(diffuse * color + lobes)


def _lobe_range(at: Angles, alpha: Floats, f0: Floats, f90: Floats, r: Floats) -> tuple[Floats, Floats]:
    """Return the minimum and maximum of the reflected light, (..., 3) each, with cosines within r (...). The half vector,
    which is divided by |L + V| = 2 V.H, moves by r/V.H."""
    turned = r / np.maximum(at.v_h, 1e-300)
    less_l, less_v, less_h = (np.maximum(cosine - r, 0.0) for cosine in (at.n_l, at.n_v, at.v_h))
    more_l, more_v, more_h = (np.minimum(cosine + r, 1.0) for cosine in (at.n_l, at.n_v, at.v_h))
    far, near = ((1.0 - less_h) ** 5)[..., None], ((1.0 - more_h) ** 5)[..., None]
    low = distribution(np.minimum(at.beside + turned, 1.0), alpha) * passing(less_l, more_v, alpha)
    high = distribution(np.maximum(at.beside - turned, 0.0), alpha) * passing(more_l, less_v, alpha)
    low = low[..., None] * (f0 * (1.0 - far) + f90[..., None] * near)
    return low, high[..., None] * (f0 * (1.0 - near) + f90[..., None] * far)


# Maps


@dataclass(frozen=True, eq=False)
class Maps:
    """What the maps give at K pixels."""

    normal: Texels  # (K, 3) of normal maps
    scale: Floats  # (K,) factor of their first two components
    turned: Bools  # (K,) where there is one
    open: Floats  # (K,) the part of the ambient light that arrives
    open_spread: Floats  # (K,) how much rounding may change it
    facets: Facets  # (K,)
    emission: Floats  # (K, 3) that the budget counts
    # (K,) how far roughness and metallic part may be off, relative to them and in `REACH`: a texel is right to 8 roundings,
    # a quarter of that, and its place to `slack` texels
    wear: Floats
    jump: Floats  # (K, 3) by how much the light changes if rounding exchanges nearest texels


def maps(hits: Hits) -> Maps:
    """Return the maps at pixels; none without shader pbr."""
    settings, materials = hits.shot.settings, [mesh.material for mesh in hits.shot.scene.meshes]
    pbr, plain = settings.shader == "pbr", facets_of(materials)[hits.mesh]

    def look_up(name: str) -> Texels:
        return texels(hits, lambda mesh: getattr(mesh.material.microfacets, name) if pbr else None)

    normal, occlusion = look_up("normal_texture"), look_up("occlusion_texture")
    glow, worn = look_up("emission_texture"), look_up("metallic_roughness_texture")
    strength, scale = (
        np.array([getattr(material.microfacets, name) for material in materials])[hits.mesh]
        for name in ("occlusion_strength", "normal_scale")
    )
    exchanged = np.maximum(normal.spread.max(axis=1), worn.spread.max(axis=1)) > 0.0
    return Maps(
        normal=normal,
        scale=scale,
        turned=normal.looked_up & (hits.shot.corners.tangents[hits.face] != 0.0).any(axis=(1, 2)),
        open=1.0 + strength * (occlusion.color[:, 0] - 1.0),
        open_spread=strength * occlusion.spread[:, 0],
        facets=replace(
            plain,
            roughness=plain.roughness * worn.color[:, 1],
            metallic=plain.metallic * worn.color[:, 2],
            emission=plain.emission * glow.color,
        ),
        emission=plain.emission * np.maximum(glow.magnitude, 1.0),
        wear=np.where(worn.looked_up, 0.25 + worn.slack / REACH[settings.precision], 0.0),
        jump=np.where(exchanged[:, None], np.inf, plain.emission * glow.spread),
    )


def shading_normals(hits: Hits, mapped: Maps) -> tuple[Floats, Floats, Floats]:
    """Return normals (K, 3) as corners give them and as normal maps turn these, and their lengths before normalizing (K,),
    1 where the corners' normals are all 0: nothing cancels there.

    With the texel's x, y, z = 2 RGB - 1 a turned one is x T + y B + z N, B = w N x T, where none of the interpolated
    vectors is normalized (as MikkTSpace asks). On a side seen from behind all of it is turned round.

    Its length is divided by how much larger its error is than that of interpolated vectors, which is 1 here. T and N have
    an error of 1 each, B of 2, so x T + y B + z N has at most 2 (|x| + |y| + |z|) and 1 for its own roundings. A texel is
    right to 8 roundings, a quarter of `REACH`, and its place to `slack` texels; either changes x and y by up to twice the
    scale and z by 2, thus the sum by up to 4 (scale + 1).
    """
    corners, face = hits.shot.corners, hits.face
    smooth = blend(hits.weights, corners.normals[face])
    smooth = np.where(hits.turned[:, None], -smooth, smooth)
    smooth_length = np.where((corners.normals[face] != 0.0).any(axis=(1, 2)), length(smooth), 1.0)
    if not mapped.turned.any():
        return smooth, smooth, smooth_length
    side, tangents = np.where(hits.turned, -1.0, 1.0)[:, None], corners.tangents[face]
    tangent = (hits.weights[..., None] * tangents[..., :3]).sum(axis=1)
    w = np.where(tangents[..., 3].sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    x, y, z = (2.0 * mapped.normal.color - 1.0).T[..., None]
    scale, front = mapped.scale[:, None], side * smooth
    turned = side * ((x * scale) * tangent + (y * scale) * w * cross(front, tangent) + z * front)
    turned = np.where(mapped.turned[:, None], turned, smooth)
    x, y, z, scale = np.abs(x[:, 0]), np.abs(y[:, 0]), np.abs(z[:, 0]), np.abs(mapped.scale)
    error = 1.0 + 2.0 * (scale * (x + y) + z)
    error += 4.0 * (scale + 1.0) * (0.25 + mapped.normal.slack / REACH[hits.shot.settings.precision])
    return smooth, turned, np.where(mapped.turned, length(turned) / error, smooth_length)
