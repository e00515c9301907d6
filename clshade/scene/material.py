"""Materials: the coefficients of the reflection models, each declared once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..base.arrays import Floats, Vector
from ..base.declare import check_fields, checked, facts_of
from ..base.validation import choice, coefficient, flag, fraction, instance, number, text, value_error
from .metallic_roughness import MetallicRoughness, from_phong
from .texture import Texture

Sides: TypeAlias = Literal["both", "front"]
SIDES: tuple[Sides, ...] = get_args(Sides)


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


@dataclass(frozen=True, eq=False)
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
        ks and n (`scene.metallic_roughness.from_phong`). `ka` holds for both models.
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

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def microfacets(self) -> MetallicRoughness:
        """The parameters of shader `pbr`: the material's own, or derived from Phong's."""
        return _from_phong(tuple(self.ks.tolist()), self.n) if self.pbr is None else self.pbr

    @property
    def diffuse(self) -> Floats:
        """Factor of the color in the diffuse term of shader `pbr`, (3,).

        1, or Phong's kd where the parameters are derived.
        """
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
