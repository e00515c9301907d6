"""Parameters of the metallic-roughness model of glTF 2.0, appendix B."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..base.arrays import Floats, Vector
from ..base.declare import check_fields, checked, facts_of
from ..base.validation import color_from_zero, fraction, instance, number, value_error
from .texture import Texture

# Smaller roughness counts as this. Its highlights are 2^-10 radians wide, less than a pixel of 800 across 45 degrees, and
# reflect 2^18 times as much as a white surface at their brightest; float32 has three digits of them.
LEAST_ROUGHNESS = 2.0**-5

_USUAL_IOR = 1.5
MOST_SCALE = 1e6  # of normal maps


@dataclass(frozen=True)
class Map:
    """A texture of MetallicRoughness.

    name: as features (NAME_MAP) and kernels (MAP_NAME) know it. words: for people. changes: features of the light that it
    changes. factor: the field that scales it, "" for none.
    """

    name: str
    words: str
    changes: tuple[str, ...]
    factor: str = ""


def _map(facts: Map, most: float = 1.0) -> Any:
    """Return the field of a texture of numbers from 0 to `most`."""

    def check(owner: str, name: str, value: Any) -> Texture:
        texture: Texture = instance(owner, name, value, Texture)
        if texture.lookup != "standard":
            raise value_error(owner, name, "a Texture with lookup standard", texture.lookup)
        least, largest = texture.extremes
        if not (least >= 0.0 and largest <= most):
            found = [least, largest]
            raise value_error(owner, name, f"a Texture of numbers from 0 {'on' if most > 1.0 else 'to 1'}", found)
        return texture

    return checked(None, check, map=facts)


def _ior(owner: str, name: str, value: Any) -> float:
    ior = number(owner, name, value, least=0.0, expected="a number from 1 on, or 0")
    if 0.0 < ior < 1.0:
        raise value_error(owner, name, "a number from 1 on, or 0", value)
    return ior


@dataclass(frozen=True, eq=False)
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
    metallic_roughness_texture: Texture | None = _map(
        Map("ROUGHNESS", "metallic-roughness map", ("DIFFUSE", "SPECULAR"))
    )
    ior: float = checked(_USUAL_IOR, _ior)
    specular: float = checked(1.0, fraction)
    specular_color: Vector = checked(1.0, color_from_zero)
    emission: Vector = checked(0.0, color_from_zero)
    normal_texture: Texture | None = _map(Map("NORMAL", "normal map", ("DIFFUSE", "SPECULAR"), "normal_scale"))
    normal_scale: float = checked(1.0, partial(number, least=-MOST_SCALE, most=MOST_SCALE))
    occlusion_texture: Texture | None = _map(
        Map("OCCLUSION", "occlusion map", ("ENVIRONMENT", "AMBIENT"), "occlusion_strength")
    )
    occlusion_strength: float = checked(1.0, fraction)
    emission_texture: Texture | None = _map(Map("EMISSION", "emission map", ("EMISSION",)), np.inf)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def dielectric_f0(self) -> Floats:
        """Reflectance of the dielectric at normal incidence, (3,).

        It includes the strength `specular`, which is the reflectance at grazing incidence.
        """
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
