"""Materials: the coefficients of Phong's model, and of the metallic-roughness model of glTF 2.0, appendix B."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Floats, Vector
from ..base.declare import checked, facts_of, record
from ..base.validation import choice, coefficient, flag, fraction, instance, number, text, value_error
from .texture import Texture

Sides: TypeAlias = Literal["both", "front"]
SIDES: tuple[Sides, ...] = get_args(Sides)

# Smaller roughness counts as this. Its highlights are 2^-10 radians wide, less than a pixel of 800 across 45 degrees, and
# reflect 2^18 times as much as a white surface at their brightest; float32 has three digits of them.
MIN_ROUGHNESS = 2.0**-5

_USUAL_IOR = 1.5
MAX_NORMAL_SCALE = 1e6  # of normal maps


@dataclass(frozen=True)
class Map:
    """A texture of MetallicRoughness.

    name: in features (NAME_MAP) and kernels (MAP_NAME). words: for people. changes: features of the light that it changes.
    factor: the field that scales it, "" for none.
    """

    name: str
    words: str
    changes: tuple[str, ...]
    factor: str = ""


def _map(owner: str, name: str, value: Any, limit: float = 1.0) -> Texture:
    """Return a texture of numbers from 0 to `limit`."""
    texture: Texture = instance(owner, name, value, Texture)
    if texture.lookup != "standard":
        raise value_error(owner, name, "a Texture with lookup standard", texture.lookup)
    low, high = texture.extremes
    if not (low >= 0.0 and high <= limit):
        raise value_error(owner, name, f"a Texture of numbers from 0 {'on' if limit > 1.0 else 'to 1'}", [low, high])
    return texture


def _ior(owner: str, name: str, value: Any) -> float:
    ior = number(owner, name, value, least=0.0, expected="a number from 1 on, or 0")
    if 0.0 < ior < 1.0:
        raise value_error(owner, name, "a number from 1 on, or 0", value)
    return ior


def _color(owner: str, name: str, value: Any) -> Floats:
    color = coefficient(owner, name, value)
    if (color < 0.0).any():
        raise value_error(owner, name, "numbers from 0 on", color.tolist())
    return color


@record
class MetallicRoughness:
    """Parameters of shader `pbr`; the base color is the material's color times its texture.

    Attributes
    ----------
    metallic : float, default 1
        From dielectric, 0, to metal, 1.
    roughness : float, default 1
        Perceptual roughness, 0 to 1: the square root of GGX's alpha. Below 1/32 it counts as 1/32.
    metallic_roughness_texture : Texture or None, default None
        Linear; G multiplies the roughness, B the metallic part. Looked up as the material's texture is.
    ior : float, default 1.5
        Index of refraction of the dielectric, at least 1; 0 stands for infinity (KHR_materials_ior).
    specular : float, default 1
        Strength of the dielectric's reflection, 0 to 1 (KHR_materials_specular).
    specular_color : float or array_like, default 1
        Factor of the dielectric's reflectance at normal incidence, linear RGB, at least 0; beyond a
        reflectance of 1 it has no effect. Kept as (3,) float64.
    emission : float or array_like, default 0
        Light that the surface sends by itself, linear RGB, at least 0. Kept as (3,) float64.
    normal_texture : Texture or None, default None
        Numbers from 0 to 1; 2 RGB - 1 is the normal in the system of tangent, bitangent and normal of
        the surface (`Mesh.tangents`).
    normal_scale : float, default 1
        Factor of the first two components of that normal.
    occlusion_texture : Texture or None, default None
        Numbers from 0 to 1; R is the part of the ambient light that reaches the surface.
    occlusion_strength : float, default 1
        From 0, R counts as 1, to 1.
    emission_texture : Texture or None, default None
        Linear, numbers from 0 on; RGB multiplies `emission`.
    """

    metallic: float = checked(1.0, fraction)
    roughness: float = checked(1.0, fraction)
    metallic_roughness_texture: Texture | None = checked(
        None, _map, map=Map("ROUGHNESS", "metallic-roughness map", ("DIFFUSE", "SPECULAR"))
    )
    ior: float = checked(_USUAL_IOR, _ior)
    specular: float = checked(1.0, fraction)
    specular_color: Vector = checked(1.0, _color)
    emission: Vector = checked(0.0, _color)
    normal_texture: Texture | None = checked(
        None, _map, map=Map("NORMAL", "normal map", ("DIFFUSE", "SPECULAR"), "normal_scale")
    )
    normal_scale: float = checked(1.0, partial(number, least=-MAX_NORMAL_SCALE, most=MAX_NORMAL_SCALE))
    occlusion_texture: Texture | None = checked(
        None, _map, map=Map("OCCLUSION", "occlusion map", ("ENVIRONMENT", "AMBIENT"), "occlusion_strength")
    )
    occlusion_strength: float = checked(1.0, fraction)
    emission_texture: Texture | None = checked(
        None, partial(_map, limit=np.inf), map=Map("EMISSION", "emission map", ("EMISSION",))
    )

    @property
    def dielectric_f0(self) -> Floats:
        """Reflectance of the dielectric at normal incidence, (3,), which includes the strength `specular`."""
        plain = 1.0 if self.ior == 0.0 else ((self.ior - 1.0) / (self.ior + 1.0)) ** 2
        return self.specular * np.minimum(plain * np.asarray(self.specular_color), 1.0)


MAPS: dict[str, Map] = facts_of(MetallicRoughness, "map")  # by field


def from_phong(ks: Floats, n: float) -> MetallicRoughness:
    """Return parameters whose highlight has about the width and the brightness of Phong's.

    It is the inverse of `formats.gltf_materials.phong`: n = (1/alpha^2 - 1)/2 gives alpha = roughness^2, and a lobe whose
    peak is F0 * (n+2)/2 gives F0 = 2 ks/(n+2), which lies between 0 and 1. F0 below that of ior 1.5, 0.04, is that of a
    weaker reflection, so that ks = 0 reflects nothing at any angle. The metallic part is 0.
    """
    f0 = np.clip(2.0 * np.asarray(ks) / (n + 2.0), 0.0, 1.0)
    usual = ((_USUAL_IOR - 1.0) / (_USUAL_IOR + 1.0)) ** 2
    strength = min(float(f0.max()) / usual, 1.0)
    color = f0 / (usual * strength) if strength > 0.0 else np.ones(3)
    return MetallicRoughness(0.0, math.sqrt(1.0 / math.sqrt(2.0 * n + 1.0)), specular=strength, specular_color=color)


@dataclass(frozen=True)
class Term:
    """A term of Phong's model: what a surface reflects of each light, by a coefficient of Material.

    feature: as features.py and kernels know it. work: what leaving it out saves, in a few words. powered: whether it is a
    power with the exponent n.
    """

    feature: str
    work: str
    powered: bool = False


def _texture(owner: str, name: str, value: Any) -> Texture:
    texture: Texture = instance(owner, name, value, Texture)
    if texture.coordinates:
        raise value_error(owner, name, "a Texture with coordinates 0", texture.coordinates)
    return texture


@record
class Material:
    """Coefficients of the reflection models, and how a surface is drawn.

    Attributes
    ----------
    ka, kd, ks : float or array_like, default 0.1, 0.8 and 0.5
        Ambient, diffuse and specular coefficient. Kept as (3,) float64.
    n : float, default 20
        Specular exponent, 0 to 1e9.
    texture : Texture or None, default None
        Texture of the surface.
    name : str, default ""
        Name of the material.
    color : float or array_like, default 1
        Factor of vertex color and texel, linear RGB. Kept as (3,) float64.
    sides : {"both", "front"}
        Draw triangles seen from either side, or only those seen from the front (counter-clockwise).
    two_sided : bool, default False
        Light back faces with their normals reversed.
    alpha_cutoff : float or None, default None
        Discard pixels whose alpha is below this value (alpha test); None, and values up to 0: none.
    pbr : MetallicRoughness or None, default None
        Parameters of shader `pbr`, whose base color is color times texture; None: derived from kd,
        ks and n (`scene.material.from_phong`). `ka` holds for both models.
    blend : bool, default False
        Composite by alpha over what lies behind, in exact order of depth; False: where it is drawn
        the surface is opaque. The alpha is straight: the light that the surface sends, highlights
        included, counts by it.
    opacity : float, default 1
        Factor of alpha, 0 to 1. Alpha is opacity times the texture's alpha times that of the
        vertices, clamped to [0, 1].
    """

    # A coefficient's component is its name for `--components`.
    ka: Vector = checked(0.1, coefficient, component="ambient")
    kd: Vector = checked(0.8, coefficient, component="diffuse", term=Term("DIFFUSE", "diffuse light"))
    ks: Vector = checked(0.5, coefficient, component="specular", term=Term("SPECULAR", "highlights", powered=True))
    n: float = checked(20.0, partial(number, least=0.0, most=1e9, expected="a number from 0 to 1e9"))
    texture: Texture | None = checked(None, _texture)
    name: str = checked("", text)
    color: Vector = checked(1.0, coefficient)
    sides: Sides = checked("both", partial(choice, allowed=SIDES))
    two_sided: bool = checked(False, flag)
    alpha_cutoff: float | None = checked(None, number)
    pbr: MetallicRoughness | None = checked(None, partial(instance, kind=MetallicRoughness))
    blend: bool = checked(False, flag)
    opacity: float = checked(1.0, fraction)

    @property
    def microfacets(self) -> MetallicRoughness:
        """The parameters of shader `pbr`: the material's own, or derived from Phong's."""
        return _from_phong(tuple(self.ks.tolist()), self.n) if self.pbr is None else self.pbr

    @property
    def diffuse(self) -> Floats:
        """Factor of the color in the diffuse term of shader `pbr`, (3,): 1, or kd where parameters are derived."""
        return np.asarray(self.kd) if self.pbr is None else np.ones(3)


@lru_cache(1 << 12)  # most materials of a file share ks and n
def _from_phong(ks: tuple[float, ...], n: float) -> MetallicRoughness:
    return from_phong(np.array(ks), n)


TERMS: dict[str, Term] = facts_of(Material, "term")  # by the field with the coefficient
POWERED = [name for name, term in TERMS.items() if term.powered]
COMPONENTS: dict[str, str] = {name: field for field, name in facts_of(Material, "component").items()}


def is_unlit(material: Material) -> bool:
    """Return whether a material shows its color by ambient light alone, as glTF's unlit ones do."""
    return material.pbr is None and not any(getattr(material, name).any() for name in TERMS)
