"""The textures that the materials of meshes look up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..scene.metallic_roughness import MAPS
from ..scene.model import Material, Mesh, Texture


def has_coordinates(mesh: Mesh, texture: Texture | None) -> bool:
    """Return whether there is a texture, and the mesh has its texture coordinates."""
    return texture is not None and mesh.uvs is not None and texture.coordinates <= len(mesh.more_uvs)


def map_of(mesh: Mesh, name: str) -> Texture | None:
    """Return a map of shader pbr, one of `metallic_roughness.MAPS`; None if the mesh cannot look it up."""
    texture: Texture | None = None if mesh.material.pbr is None else getattr(mesh.material.pbr, name)
    return texture if has_coordinates(mesh, texture) else None


def maps_of(mesh: Mesh) -> dict[str, Texture]:
    """Return the maps of a mesh by name."""
    if mesh.material.pbr is None or mesh.uvs is None:
        return {}
    found = {name: map_of(mesh, name) for name in MAPS}
    return {name: texture for name, texture in found.items() if texture is not None}


def textures_of(mesh: Mesh, *, maps: bool) -> list[Texture]:
    """Return the textures that a mesh looks up at the pixels. maps: whether the shader uses those of shader pbr."""
    own = mesh.material.texture
    found = [own] if own is not None and has_coordinates(mesh, own) else []
    return found + (list(maps_of(mesh).values()) if maps else [])


def usable(mesh: Mesh) -> Material:
    """Return the material of a mesh without the textures that it has no coordinates for."""
    material = mesh.material
    if material.texture is not None and not has_coordinates(mesh, material.texture):
        material = replace(material, texture=None)
    facets = mesh.material.pbr
    lost: dict[str, Any] = {name: None for name in MAPS if facets is not None and map_of(mesh, name) is None}
    if facets is not None and any(getattr(facets, name) is not None for name in lost):
        material = replace(material, pbr=replace(facets, **lost))
    return material
