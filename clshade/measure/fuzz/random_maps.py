"""Random maps of shader pbr for the meshes of a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...scene.metallic_roughness import MAPS, MetallicRoughness
from ...scene.model import WRAPS, Filter, Material, Mesh, Scene, Texture, with_materials
from .random_shapes import Random


def with_nearest(rng: Random, scene: Scene) -> Scene:
    """Return the scene with the filter nearest for the first mesh's texture, and some others."""
    first = scene.meshes[0].material

    def changed(material: Material) -> Material:
        texture = material.texture
        if texture is None or texture.lookup == "course" or (material is not first and rng.random() < 0.5):
            return material
        return replace(material, texture=replace(texture, filter="nearest"))

    return with_materials(scene, changed)


def with_maps(rng: Random, scene: Scene, nearest: bool) -> Scene:
    """Return the scene with maps on the first mesh, and some of them on others that have texture coordinates. nearest:
    whether textures may have that filter."""
    made: dict[int, Material] = {}
    for mesh in scene.meshes:
        if id(mesh.material) not in made:
            made[id(mesh.material)] = replace(mesh.material, pbr=_parameters(rng, nearest, all_of_it=not made))
    return replace(scene, meshes=tuple(_mesh(rng, mesh, made[id(mesh.material)]) for mesh in scene.meshes))


def _mesh(rng: Random, mesh: Mesh, material: Material) -> Mesh:
    if mesh.uvs is None:
        return replace(mesh, material=material)
    fields: dict[str, Any] = {"more_uvs": (rng.uniform(-1.5, 2.5, mesh.uvs.shape),)}
    if rng.random() < 0.5:
        fields["tangents"] = _tangents(rng, len(mesh.verts) + 3)
        fields["tangent_faces"] = rng.integers(0, len(mesh.verts) + 3, mesh.faces.shape)
    return replace(mesh, material=material, **fields)


def _tangents(rng: Random, count: int) -> Array:
    tangents = rng.normal(size=(count, 4))
    if rng.random() < 0.3:
        tangents *= 10.0 ** rng.uniform(-20, 20, (count, 1))
    if rng.random() < 0.3:
        tangents[rng.random(count) < 0.5] = 0.0
    return tangents


def _parameters(rng: Random, nearest: bool, all_of_it: bool) -> MetallicRoughness:
    def wanted() -> bool:
        return all_of_it or bool(rng.random() < 0.5)

    found = MetallicRoughness(
        metallic=float(rng.choice((0.0, 1.0, 0.5))) if not all_of_it and rng.random() < 0.5 else rng.uniform(0.1, 0.9),
        roughness=float(rng.choice((0.0, 1e-4, 0.05))) if rng.random() < 0.2 else rng.uniform(0.05, 1.0),
        emission=rng.uniform(0.1, 1.0, 3) * (1e30 if rng.random() < 0.05 else 1.0),
        normal_texture=_texture(rng, nearest) if wanted() else None,
        normal_scale=float(rng.choice((0.0, -1.0, 1.0, 5.0))) if rng.random() < 0.5 else rng.uniform(-2, 2),
        occlusion_texture=_texture(rng, nearest) if wanted() else None,
        occlusion_strength=rng.uniform(0.0, 1.0),
        emission_texture=_texture(rng, nearest, 1) if wanted() else None,
        metallic_roughness_texture=_texture(rng, nearest) if wanted() else None,
    )
    more: dict[str, Any] = {name: _texture(rng, nearest) if wanted() else None for name in list(MAPS)[4:]}
    return replace(found, **more)


def _texture(rng: Random, nearest: bool, coordinates: int | None = None) -> Texture:
    height, width = (int(size) for size in rng.choice((1, 2, 3, 4, 7, 16, 33), 2))
    image = rng.uniform(0, 1, (height, width, 3)).astype(np.float32)
    if rng.random() < 0.1:
        image[:] = rng.choice((0.0, 0.5, 1.0))
    wraps = (WRAPS[rng.choice(len(WRAPS))], WRAPS[rng.choice(len(WRAPS))])
    filter: Filter = "nearest" if nearest and rng.random() < 0.5 else "linear"
    chosen = int(rng.integers(0, 2)) if coordinates is None else coordinates
    return Texture(image, wraps, filter=filter, coordinates=chosen)
