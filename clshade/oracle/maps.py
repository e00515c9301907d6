"""The maps of shader pbr at pixels: normals turned by them, the ambient light that arrives, factors of the emission."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Scene, Settings, Texture
from .corners import Corners, Texels, texels
from .microfacet import Facets
from .vectors import cross, length


@dataclass(frozen=True, eq=False)
class Maps:
    """What the maps give at K pixels.

    normal: texels (K, 3) of normal maps, scale: (K,) factor of their first two components, turned: (K,) bool where there is
    one. slack: (K,) texels that their place may be off by. open: (K,) the part of the ambient light that arrives.
    open_spread: (K,) how much rounding may change it. glow: (K, 3) factors of the emission. wear: (K, 3) whose second and
    third component are factors of the roughness and of the metallic part.
    """

    normal: Texels
    scale: Floats
    turned: Bools
    slack: Floats
    open: Floats
    open_spread: Floats
    glow: Texels
    wear: Texels

    def changed(self, facets: Facets) -> Facets:
        """Return the parameters at the pixels."""
        return replace(
            facets,
            roughness=facets.roughness * self.wear.color[:, 1],
            metallic=facets.metallic * self.wear.color[:, 2],
            emission=facets.emission * self.glow.color,
        )

    def brightest(self, facets: Facets) -> Facets:
        """Return the parameters with the emission that the budget counts."""
        return replace(facets, emission=facets.emission * np.maximum(self.glow.most, 1.0))

    def error(self, reach: float) -> Floats:
        """Return how far roughness and metallic part may be off, relative to them and in `reach`, (K,): a texel is right to
        8 roundings, a quarter of `reach`, and its place to `slack` texels."""
        return np.where(self.wear.found, 0.25 + self.wear.slack / reach, 0.0)

    def jump(self, facets: Facets) -> Floats:
        """Return by how much the light changes if rounding exchanges nearest texels, (K, 3)."""
        exchanged = np.maximum(self.normal.spread.max(axis=1), self.wear.spread.max(axis=1)) > 0.0
        return np.where(exchanged[:, None], np.inf, facets.emission * self.glow.spread)


def maps(
    scene: Scene,
    settings: Settings,
    corners: Corners,
    face: Integers,
    weights: Floats,
    steps: tuple[Floats, Floats] | None,
    condition: Floats,
) -> Maps:
    """Return the maps at pixels; arguments as of `corners.texels`. Without shader pbr there are none."""
    materials = [mesh.material for mesh in scene.meshes]
    facets = [material.microfacets for material in materials]
    mesh = corners.mesh[face]
    used = settings.shader == "pbr"

    def look_up(name: str) -> Texels:
        textures: list[Texture | None] = [getattr(each, name) if used else None for each in facets]
        return texels(scene, settings, corners, face, weights, steps, condition, textures)

    normal, occlusion = look_up("normal_texture"), look_up("occlusion_texture")
    strength = np.array([each.occlusion_strength for each in facets])[mesh]
    return Maps(
        normal=normal,
        scale=np.array([each.normal_scale for each in facets])[mesh],
        turned=normal.found & (corners.tangents[face] != 0.0).any(axis=(1, 2)),
        slack=normal.slack,
        open=1.0 + strength * (occlusion.color[:, 0] - 1.0),
        open_spread=strength * occlusion.spread[:, 0],
        glow=look_up("emission_texture"),
        wear=look_up("metallic_roughness_texture"),
    )


def turned_normals(normal: Floats, tangents: Floats, weights: Floats, behind: Bools, found: Maps) -> Floats:
    """Return normals (K, 3) turned by normal maps.

    normal: (K, 3) interpolated, already turned round where `behind` (K,) is. tangents: (K, 3, 4) at the faces' corners.
    weights: (K, 3). With the texel's x, y, z = 2 RGB - 1 it is x T + y B + z N, B = w N x T, where none of the interpolated
    vectors is normalized (as MikkTSpace asks). On a side seen from behind all of it is turned round.
    """
    side = np.where(behind, -1.0, 1.0)[:, None]
    tangent = (weights[..., None] * tangents[..., :3]).sum(axis=1)
    w = np.where(tangents[..., 3].sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    x, y, z = (component[:, None] for component in (2.0 * found.normal.color - 1.0).T)
    x, y = x * found.scale[:, None], y * found.scale[:, None]
    front = side * normal
    turned = side * (x * tangent + y * w * cross(front, tangent) + z * front)
    return np.where(found.turned[:, None], turned, normal)


def turned_length(turned: Floats, found: Maps, reach: float) -> Floats:
    """Return what stands for the length of turned normals before normalizing, (K,): their length over how much larger their
    error is than that of interpolated vectors, which is 1 here.

    T and N have an error of 1 each, B of 2, so x T + y B + z N has at most 2 (|x| + |y| + |z|) and 1 for its own roundings.
    A texel is right to 8 roundings, a quarter of `reach`, and its place to `slack` texels; either changes x and y by up to
    twice the scale and z by 2, thus the sum by up to 4 (scale + 1).
    """
    x, y, z = np.abs(2.0 * found.normal.color - 1.0).T
    scale = np.abs(found.scale)
    error = 1.0 + 2.0 * (scale * (x + y) + z) + 4.0 * (scale + 1.0) * (0.25 + found.slack / reach)
    effective: Floats = length(turned) / error
    return effective
