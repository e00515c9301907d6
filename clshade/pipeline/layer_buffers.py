"""Inputs of a scene's layers beyond those of its lighting: which are asked for, and tables by face."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array
from ..images.layers import LAYER_TABLE, Layer
from ..scene.model import Material, Scene, Settings, Texture
from ..scene.objects import first_instances, instance_names, object_names, object_numbers
from .features import Features, uses_normal_indices
from .gather import Gatherer
from .layer_outputs import LAYER_BITS, MIRRORED


class LayerTables(NamedTuple):
    """What only layers read.

    asked: bits of LAYER_BITS and MIRRORED, 0 without any of SURFACE_LAYERS. arrays: those of object_id, material_id and
    instance_id, (F,) uint32; and by the names of the kernel's parameters, normals and uvs with their indices as in
    scene_buffers.Packed, unless those of the lighting serve; mirrored, (F,) int32, whether a face's placement mirrors;
    scalars, (3F,) reals, at the corners of faces, times 2^-scalar_exponent; NAN_POSITION for none. Where instances are drawn
    from one copy of their mesh, object_normals are in place of normals, and there is no instance_id by face.
    """

    asked: int
    arrays: Mapping[str, Array]
    scalar_exponent: int = 0


def _fields(material: Material) -> tuple[Any, ...]:
    """Return a hashable key of a material: every field, but not the texels of its texture."""
    values = [getattr(material, field.name) for field in fields(Material) if field.name != "texture"]
    texture = material.texture
    described = None if texture is None else (texture.texels.shape, texture.wrap, texture.lookup, texture.filter)
    return (*(tuple(value) if isinstance(value, np.ndarray) else value for value in values), described)


def _same_texels(a: Texture | None, b: Texture | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a.texels, b.texels))


def material_numbers(scene: Scene) -> tuple[int, ...]:
    """Return the number of each mesh's material, from 1 in the order of the meshes; equal materials, name and texels
    included, share one."""
    numbers: dict[int, int] = {}  # by id
    # Scenes may have thousands of materials: few pairs are compared.
    alike: dict[tuple[Any, ...], list[tuple[Texture | None, int]]] = {}
    count = 0
    for mesh in scene.meshes:
        material = mesh.material
        if id(material) in numbers:
            continue
        known = alike.setdefault(_fields(material), [])
        number = next((number for texture, number in known if _same_texels(texture, material.texture)), 0)
        if not number:
            number = count = count + 1
            known.append((material.texture, number))
        numbers[id(material)] = number
    return tuple(numbers[id(mesh.material)] for mesh in scene.meshes)


def number_names(scene: Scene, layer: Layer) -> Iterator[tuple[int, str]]:
    """Yield the numbers of object_id, material_id or instance_id with their names, "" for none."""
    if layer == "object_id":
        yield from enumerate(object_names(scene), 1)
    elif layer == "material_id":
        yield from zip(material_numbers(scene), (mesh.material.name for mesh in scene.meshes), strict=True)
    elif layer == "instance_id":
        yield from enumerate(instance_names(scene), 1)


def layer_features(light: Features, asked: int) -> Features | None:
    """Return the features of the layers' program; None if none of SURFACE_LAYERS is asked for. light: those of the image's.
    asked: see LayerTables."""
    if not asked:
        return None
    casts = any(asked & bit for name, bit in LAYER_BITS.items() if "casters" in LAYER_TABLE[name].reads)
    return light.including("CASTERS") if casts else light


def layer_tables(gatherer: Gatherer, scene: Scene, settings: Settings, light: Features) -> LayerTables:
    """Return the tables of the layers asked for. scene: with its own materials. light: the features of the image's
    program."""
    asked = settings.layers
    bits = sum(bit for name, bit in LAYER_BITS.items() if name in asked)
    if not gatherer.copies:
        return LayerTables(bits, {})
    reads = {table for name in asked for table in LAYER_TABLE[name].reads}
    exponent, found = 0, dict[str, "Array | None"]()
    if "normals" in reads and not light.needs_any("TERMS"):
        indexed = any(uses_normal_indices(scene, mesh) for mesh in scene.meshes if len(mesh.faces))
        normals, found["normal_faces"] = gatherer.normals(indexed)
        found["object_normals" if light["INSTANCES"] else "normals"] = normals
    if "uvs" in reads:
        indexed = any(mesh.uv_faces is not None for mesh in scene.meshes if len(mesh.faces))
        found["uvs"], found["uv_faces"] = gatherer.uvs(indexed, untextured=True)
    if "mirrored" in reads and any(each.mirrored.any() for each in gatherer.copies):
        bits |= MIRRORED
        found["mirrored"] = gatherer.mirrored()
    if "scalars" in reads:
        found["scalars"], exponent = gatherer.corner_scalars()
    if "object_id" in asked:
        found["object_id"] = gatherer.per_face(object_numbers(scene), np.uint32)
    if "material_id" in asked:
        found["material_id"] = gatherer.per_face(material_numbers(scene), np.uint32)
    if "instance_id" in asked and not light["INSTANCES"]:
        found["instance_id"] = gatherer.per_copy(first_instances(scene))
    return LayerTables(bits, {name: array for name, array in found.items() if array is not None}, exponent)
