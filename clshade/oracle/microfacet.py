"""The metallic-roughness model of glTF 2.0, appendix B: GGX's distribution, Smith's height-correlated visibility, Schlick's
Fresnel reflectance, and how far rounding may change them.

Functions broadcast over leading axes: points, directions and colors are (..., 3). Reflected light is pi times the
specification's: a white diffuse surface that faces a light of intensity 1 sends 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import LEAST_ROUGHNESS, Material
from . import lights
from .shade import conditioning, light_condition, most_arriving
from .vectors import dot, length, unit

# How far rounding may move a unit vector or a cosine, by precision: the roundings that `oracle_bounds.ALLOWED` allows.
REACH = {"float32": 32.0 * 2.0**-24, "float64": 1e-12}


@dataclass(frozen=True, eq=False)
class Facets:
    """Parameters of some surfaces. diffuse: (..., 3) factor of the color. f0: (..., 3) and f90 (...): the dielectric's
    reflectance at normal and grazing incidence. metallic, roughness: (...). emission: (..., 3)."""

    diffuse: Floats
    f0: Floats
    f90: Floats
    metallic: Floats
    roughness: Floats
    emission: Floats

    def __getitem__(self, index: object) -> Facets:
        return Facets(*(getattr(self, field.name)[index] for field in fields(Facets)))


def facets_of(materials: Sequence[Material]) -> Facets:
    """Return the parameters of materials, (U,)."""
    own = [material.microfacets for material in materials]
    return Facets(
        np.array([material.diffuse for material in materials], np.float64).reshape(-1, 3),
        np.array([each.dielectric_f0 for each in own], np.float64).reshape(-1, 3),
        np.array([each.specular for each in own], np.float64),
        np.array([each.metallic for each in own], np.float64),
        np.array([each.roughness for each in own], np.float64),
        np.array([each.emission for each in own], np.float64).reshape(-1, 3),
    )


def alpha_of(roughness: Floats) -> Floats:
    """Return GGX's alpha (...)."""
    alpha: Floats = np.maximum(roughness, LEAST_ROUGHNESS) ** 2
    return alpha


def distribution(beside: Floats, alpha: Floats) -> Floats:
    """Return pi times GGX's distribution of normals, at most 1/alpha^2. beside: |N x H|."""
    x2, a2 = beside * beside, alpha * alpha
    ratio: Floats = alpha / (x2 + a2 * (1.0 - x2))
    return ratio * ratio


def passing(n_l: Floats, n_v: Floats, alpha: Floats) -> Floats:
    """Return N.L times Smith's height-correlated visibility, G / (4 N.L N.V) N.L. It grows with N.L and falls with N.V, each
    at least 0; 0 where N.L is 0."""
    a2 = alpha * alpha
    shadowed, masked = (np.sqrt(a2 + (1.0 - a2) * x * x) for x in (n_l, n_v))
    lit = n_l > 0.0
    share: Floats = np.where(lit, 0.5 * n_l / np.where(lit, n_l * masked + n_v * shadowed, 1.0), 0.0)
    return share


def schlick(f0: Floats, f90: Floats, v_h: Floats) -> Floats:
    """Return the reflectance (..., 3) of f0 (..., 3) and f90, v_h (...)."""
    grazing = ((1.0 - v_h) ** 5)[..., None]
    reflectance: Floats = f0 * (1.0 - grazing) + np.asarray(f90)[..., None] * grazing
    return reflectance


@dataclass(frozen=True, eq=False)
class Angles:
    """Cosines at points, (...): N.L, N.V, V.H; beside: |N x H|, 1 where N.H < 0; mirrors: whether there is a direction to
    the eye."""

    n_l: Floats
    n_v: Floats
    v_h: Floats
    beside: Floats
    mirrors: Floats


def angles(point: Floats, normal: Floats, eye: Floats, light_position: Floats) -> Angles:
    """Return the cosines at points; N.L and N.V below 0 count as 0."""
    n, towards_light, view = unit(normal), unit(light_position - point), unit(eye - point)
    both = towards_light + view
    size = length(both)
    half = both / np.where(size > 0.0, size, 1.0)[..., None]
    n_h = dot(n, half)
    beside = np.where(n_h > 0.0, length(half - n * n_h[..., None]), 1.0)
    mirrors = (view != 0.0).any(axis=-1) & (size > 0.0)
    v_h = np.where((view != 0.0).any(axis=-1), 0.5 * size, 1.0)
    return Angles(
        np.maximum(dot(n, towards_light), 0.0),
        np.maximum(dot(n, view), 0.0),
        np.minimum(v_h, 1.0),
        np.minimum(beside, 1.0),
        mirrors,
    )


@dataclass(frozen=True, eq=False)
class Reflected:
    """Light of white light sources summed over them, (..., 3): tinted by the color, and not. spread: (..., 3) how much light
    there is to be rounded, in units of which errors are counted; see `budget`."""

    tinted: Floats
    plain: Floats
    spread: Floats

    def times(self, factor: Floats) -> Reflected:
        """Return the light times factors (...) from 0 to 1."""
        return Reflected(self.tinted * factor[..., None], self.plain * factor[..., None], self.spread)

    def plus(self, other: Reflected) -> Reflected:
        return Reflected(self.tinted + other.tinted, self.plain + other.plain, self.spread + other.spread)


def reflected(
    point: Floats,
    normal: Floats,
    eye: Floats,
    facets: Facets,
    most: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    reach: float,
    extent: Floats,
    normal_length: Floats,
    parallel: bool = False,
    wear: Floats | float = 0.0,
    shapes: Sequence[lights.Shape] = (),
    reaching: Floats | None = None,
) -> Reflected:
    """Return what surfaces reflect, and how far rounding may change it.

    most: (..., 3) the largest color that errors are relative to. reach: see `REACH`. extent, normal_length, parallel: as of
    `shade.conditions`; shapes: as of `shade.reflected`. reaching: (L, ...) factors of the lights, which `spread` does not
    know. wear: (...) how far the roughness and the metallic part may be off, over `reach`.

    A cosine within r of its value, r being `reach` times the light's own condition number, bounds distribution, visibility
    and reflectance from above and below, since each is monotonic; so their product lies between two values. Their difference
    over r, and the larger one for the roundings of the product itself, are what the lobe adds to `spread`. Its relative
    change with alpha is at most 3/alpha, hence 6/roughness with the roughness; the reflectance changes with the metallic
    part by at most the larger one of color and 1.
    """
    alpha, dielectric = alpha_of(facets.roughness), 1.0 - facets.metallic
    f0, f90 = dielectric[..., None] * facets.f0, dielectric * facets.f90
    base = dielectric[..., None] * facets.diffuse
    metal = facets.metallic[..., None] * np.maximum(np.abs(most), 1.0)
    shape = np.broadcast_shapes(point.shape, normal.shape, f0.shape)
    tinted, plain, spread = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    has_normal = (np.asarray(normal) != 0.0).any(axis=-1)
    most_light = most_arriving(point, extent, eye, light_positions, light_intensities, shapes, parallel)
    common = conditioning(point, extent, normal_length, eye, np.zeros((0, 3)), parallel)
    each = lights.each(light_positions, light_intensities, shapes, point, extent)
    for k, ((position, intensity, kind), most_intensity) in enumerate(zip(each, most_light, strict=True)):
        at = angles(point, normal, eye, lights.place(point, position, kind))
        share = lights.share(point, position, kind) * (1.0 if reaching is None else reaching[k])
        arriving = intensity * share[..., None]
        lobe = np.where(at.mirrors, distribution(at.beside, alpha) * passing(at.n_l, at.n_v, alpha), 0.0)
        below = 1.0 - schlick(facets.f0.max(axis=-1, keepdims=True), facets.f90, at.v_h)
        grazing = (1.0 - at.v_h) ** 5
        tinted += arriving * (base * at.n_l[..., None] * below)
        tinted += arriving * (facets.metallic * lobe * (1.0 - grazing))[..., None]
        plain += (
            arriving
            * (f0 * (1.0 - grazing)[..., None] + (f90 + facets.metallic)[..., None] * grazing[..., None])
            * lobe[..., None]
        )
        own = np.fmax(common, light_condition(point, extent, eye, position, parallel, kind))
        r = reach * np.maximum(np.nan_to_num(own, nan=1e300, posinf=1e300), 1.0)
        low, high = _lobe_range(at, alpha, f0 + metal, f90 + facets.metallic, r)
        color = np.maximum(np.abs(most), 1.0)
        whole = _lobe_range(at, alpha, np.ones_like(color), np.ones_like(facets.f90), r)[1]
        worn = np.asarray(wear)[..., None] * (6.0 / np.sqrt(alpha)[..., None] * high + color * whole)
        lobes = np.where((has_normal & at.mirrors)[..., None], (high - low) / r[..., None] + high + worn, 0.0)
        diffuse = 2.0 * base + np.asarray(wear)[..., None] * facets.diffuse
        spread += np.abs(most_intensity) * (diffuse * color + lobes)
    return Reflected(tinted, plain, spread)


def _lobe_range(at: Angles, alpha: Floats, f0: Floats, f90: Floats, r: Floats) -> tuple[Floats, Floats]:
    """Return the least and the largest reflected light, (..., 3) each, with cosines within r (...). The half vector, which
    is divided by |L + V| = 2 V.H, moves by r/V.H."""
    turned = r / np.maximum(at.v_h, 1e-300)
    peak = (
        distribution(np.maximum(at.beside - turned, 0.0), alpha),
        distribution(np.minimum(at.beside + turned, 1.0), alpha),
    )
    share = (
        passing(np.minimum(at.n_l + r, 1.0), np.maximum(at.n_v - r, 0.0), alpha),
        passing(np.maximum(at.n_l - r, 0.0), np.minimum(at.n_v + r, 1.0), alpha),
    )
    most_h, least_h = np.minimum(at.v_h + r, 1.0), np.maximum(at.v_h - r, 0.0)
    far, near = ((1.0 - least_h) ** 5)[..., None], ((1.0 - most_h) ** 5)[..., None]
    high = (peak[0] * share[0])[..., None] * (f0 * (1.0 - near) + f90[..., None] * far)
    low = (peak[1] * share[1])[..., None] * (f0 * (1.0 - far) + f90[..., None] * near)
    return low, high


def budget(ka_Ia: Floats, most: Floats, facets: Facets, spread: Floats, tinted: bool) -> Floats:
    """Return what errors are counted against, B (..., 3): the ambient and emitted light, and `Reflected.spread`."""
    total: Floats = np.abs(ka_Ia) * (np.maximum(np.abs(most), 1.0) if tinted else 1.0) + facets.emission + spread
    return total


def light(reflection: Reflected, color: Floats, ka_Ia: Floats, facets: Facets, tinted: bool) -> Floats:
    """Return the light that points send, (..., 3): reflected, ambient (times the color if `tinted`) and emitted."""
    factor = reflection.tinted + ka_Ia if tinted else reflection.tinted
    total: Floats = color * factor + reflection.plain + facets.emission
    return total if tinted else total + ka_Ia


def lost_energy(alpha: float, n_v: Array, steps: int = 400) -> Floats:
    """Return the share of light that single scattering of a perfect reflector (F = 1) loses, (...), by quadrature: 1 minus
    the integral of its BRDF times N.L over directions to the light.

    Half vectors are taken with equal shares of D (N.H): tan^2 of their angle to N is alpha^2 u/(1 - u), u uniform.
    """
    u = (np.arange(steps) + 0.5) / steps
    phi = (np.arange(steps) + 0.5) / steps * np.pi
    cosine = 1.0 / np.sqrt(1.0 + alpha * alpha * u / (1.0 - u))
    sine = np.sqrt(1.0 - cosine * cosine)
    kept = []
    for c in np.ravel(n_v):
        s = np.sqrt(1.0 - c * c)
        v_h = cosine[:, None] * c + (sine[:, None] * s) * np.cos(phi)
        n_l = 2.0 * v_h * cosine[:, None] - c
        mirrored = (v_h > 0.0) & (n_l > 0.0)
        visible = 4.0 * passing(np.where(mirrored, n_l, 0.0), np.asarray(c), np.asarray(alpha))
        kept.append(np.where(mirrored, visible * v_h / cosine[:, None], 0.0).mean())
    lost: Floats = 1.0 - np.reshape(kept, np.shape(n_v))
    return lost
