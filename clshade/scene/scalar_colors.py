"""The scalars of a scene's meshes, and the color map that shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ..base.arrays import Floats, Floats32
from ..base.spelling import hint
from ..errors import InputError
from ..images.colors import map_colors
from ..images.decode import srgb_to_linear
from .model import Material, Mesh, Scene
from .settings import Scalars


def at_vertices(mesh: Mesh, name: str) -> bool:
    """Return whether these scalars of a mesh are given per vertex: of as many vertices as faces they are."""
    return mesh.scalars[name].shape == (len(mesh.verts),)


def at_corners(mesh: Mesh, name: str) -> Floats:
    """Return the scalars at the corners of a mesh's faces, (F, 3)."""
    values = mesh.scalars[name].astype(np.float64)
    if at_vertices(mesh, name):
        return values[mesh.faces]
    return values if values.ndim == 2 else np.repeat(values[:, None], 3, axis=1)


def scalar_range(scene: Scene, name: str) -> tuple[float, float] | None:
    """Return the least and the largest finite value of these scalars in a scene; None if there is none."""
    scalars = [mesh.scalars[name] for mesh in scene.meshes if name in mesh.scalars]
    finite = [values[np.isfinite(values)] for values in scalars]
    ends = [(float(values.min()), float(values.max())) for values in finite if len(values)]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def scalar_names(scene: Scene) -> tuple[str, ...]:
    """Return the names of all scalars in a scene, in the order of its meshes."""
    return tuple(dict.fromkeys(name for mesh in scene.meshes for name in mesh.scalars))


@dataclass(frozen=True, eq=False)
class ColorMap:
    """A map of numbers to colors.

    table: (N + 3, 3) float32, linear RGB: below low, N colors from low to high, above high, of NaN. Of values from low
    to high, N equal intervals have a color each; high itself belongs to the last.
    """

    table: Floats32
    low: float
    high: float

    @property
    def count(self) -> int:
        return len(self.table) - 3


def color_map_of(scene: Scene, scalars: Scalars) -> ColorMap:
    """Return the color map of scalars in a scene. Raises InputError if no mesh has scalars of that name.

    The colors of a map are sRGB. Scenes whose images are shown with the sRGB curve get them decoded, so that the unlit
    image shows them again; course scenes, which are shown without a curve, as they are, as their textures.
    """
    names = scalar_names(scene)
    if scalars.name not in names:
        expected = f"one of the scene's ({', '.join(names)})" if names else "a scene with scalars"
        near = hint(scalars.name, names)
        raise InputError(f"render: scalars: expected {expected}, found {scalars.name!r}{near}")
    colors = np.vstack([map_colors(scalars.colormap), scalars.nan_color])
    table = colors if scene.preset == "course" else srgb_to_linear(colors)
    low, high = scalars.clim or scalar_range(scene, scalars.name) or (0.0, 1.0)
    return ColorMap(table.astype(np.float32), low, high)


def without_colors(scene: Scene, scalars: Scalars | None) -> Scene:
    """Return the scene with the meshes that scalars color in white, so that the map's color is the surface's. What an
    alpha test or blending reads of a texture stays."""
    if scalars is None or scalars.name not in scalar_names(scene):
        return scene

    @cache  # meshes that share a material go on sharing it
    def bare(material: Material) -> Material:
        texture = material.texture
        if texture is not None:
            tests_or_blends = material.blend or material.alpha_cutoff is not None
            keep = tests_or_blends and texture.texels.shape[2] == 4
            white = np.array([True, True, True, False])
            texture = replace(texture, image=np.where(white, np.float32(1.0), texture.image)) if keep else None
        return replace(material, color=1.0, texture=texture)

    meshes = (
        replace(mesh, colors=None, material=bare(mesh.material)) if scalars.name in mesh.scalars else mesh
        for mesh in scene.meshes
    )
    return replace(scene, meshes=tuple(meshes))
