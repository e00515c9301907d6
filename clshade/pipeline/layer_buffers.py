"""Inputs of a scene's layers beyond those of its lighting: the macros of their program, and tables by face."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array
from ..base.validation import value_error
from ..scene.model import Material, Scene, Settings, Texture
from .features import Features, casts_alpha, uses_normal_indices
from .gather import Gatherer

# The layers of kernels/surface_layers.cl -> the macro that says whether each is asked for.
MACROS = {
    "N": "LAYER_N",
    "P": "LAYER_P",
    "albedo": "LAYER_ALBEDO",
    "uv": "LAYER_UV",
    "barycentrics": "LAYER_BARYCENTRICS",
    "scalar": "LAYER_SCALAR",
    "AO": "LAYER_AO",
}


class LayerTables(NamedTuple):
    """Arrays that only layers read; None if no layer does, or if the array of the lighting serves.

    features: of the program of the layers in MACROS. normals, uvs: as in scene_buffers.Packed, with their indices. mirrored:
    (F,) int32, whether a face's placement mirrors. objects, materials, instances: (F,) uint32. scalars: (3F,) reals, at the
    corners of faces, times 2^-scalar_exponent; NAN_POSITION for none. Where instances are drawn from one copy of their mesh,
    object_normals are in place of normals, and there are no numbers of instances by face.
    """

    features: Features | None
    normals: Array | None = None
    object_normals: Array | None = None
    normal_faces: Array | None = None
    uvs: Array | None = None
    uv_faces: Array | None = None
    mirrored: Array | None = None
    objects: Array | None = None
    materials: Array | None = None
    instances: Array | None = None
    scalars: Array | None = None
    scalar_exponent: int = 0


def _fields(material: Material) -> tuple[Any, ...]:
    """Return a hashable key of a material: every field, but not the texels of its texture."""
    values = [getattr(material, field.name) for field in fields(Material) if field.name != "texture"]
    texture = material.texture
    described = None if texture is None else (texture.image.shape, texture.wrap, texture.lookup, texture.filter)
    return (*(tuple(value) if isinstance(value, np.ndarray) else value for value in values), described)


def _same_texels(a: Texture | None, b: Texture | None) -> bool:
    return a is b or (a is not None and b is not None and np.array_equal(a.image, b.image))


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


def first_instances(scene: Scene) -> list[int]:
    """Return the number of each mesh's first instance; instances are counted from 1, mesh by mesh. Raises InputError for
    more than a uint32 counts."""
    ends: list[int] = np.cumsum([1, *(len(np.asarray(mesh.instances)) for mesh in scene.meshes)]).tolist()
    if ends[-1] > 1 << 32:
        limit = f"at most {(1 << 32) - 1} instances with the layer instance_id"
        raise value_error("render", "scene", limit, ends[-1] - 1)
    return ends[:-1]


def _program(scene: Scene, settings: Settings, light: Features, mirrored: bool) -> Features | None:
    """Return the features of the layers' program. light: those of the image's program, whose colors the layers show
    too."""
    asked = set(MACROS) & set(settings.layers)
    if not asked:
        return None
    meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
    kept = {"DOUBLE", "FAST", "SAMPLES", "PERSPECTIVE", "ORTHOGRAPHIC", "INSTANCES"}
    if "albedo" in asked:
        kept |= {"VERTEX_COLORS", "CORNER_COLORS", "SCALARS", "TEXTURED", "NEAREST", "MIPMAPS", "UV_INDICES"}
    values = dict(light.only(kept).values)
    if "N" in asked and light["NORMAL_MAP"]:
        kept_too = (
            "PBR",
            "DIFFUSE",
            "SPECULAR",
            "NORMAL_MAP",
            "NEAREST",
            "MIPMAPS",
            "UV_SETS",
            "UV_INDICES",
            "MATERIALS",
        )
        values |= {name: light[name] for name in kept_too}
    if "N" in asked:
        values["NORMAL_INDICES"] = int(any(uses_normal_indices(scene, mesh) for mesh in meshes))
        values["TWO_SIDED"] = int(any(mesh.material.two_sided for mesh in meshes))
    if "uv" in asked:
        values["UV_INDICES"] = int(any(mesh.uv_faces is not None for mesh in meshes))
        values["ALPHA_TEST"] = int(not values["TEXTURED"])  # either macro provides texture coordinates
    if "AO" in asked:
        values |= {"AMBIENT_OCCLUSION": 1, "SHADOW_ALPHA": int(casts_alpha(scene))}
        if values["SHADOW_ALPHA"]:
            of_alpha = ("ALPHA_TEST", "BLEND", "VERTEX_ALPHA", "NEAREST", "UV_SETS", "UV_INDICES", "MATERIALS")
            values |= {name: values[name] or light[name] for name in of_alpha}
    if values["TEXTURED"] or values["TWO_SIDED"]:
        values["MATERIALS"] = light["MATERIALS"]
    values |= {macro: int(name in asked) for name, macro in MACROS.items()}
    return Features((*values.items(), ("MIRRORED", int(mirrored and "barycentrics" in asked))))


def layer_tables(gatherer: Gatherer, scene: Scene, settings: Settings, light: Features) -> LayerTables:
    """Return the tables of the layers asked for. scene: with its own materials. light: the features of the image's
    program."""
    asked = settings.layers
    turned = any(each.mirrored.any() for each in gatherer.copies)
    features = _program(scene, settings, light, turned)
    found: dict[str, Any] = {}
    if not gatherer.copies:
        return LayerTables(features)
    if features is not None:
        if "N" in asked and not (light["DIFFUSE"] or light["SPECULAR"]):
            normals, found["normal_faces"] = gatherer.normals(bool(features["NORMAL_INDICES"]))
            found["object_normals" if light["INSTANCES"] else "normals"] = normals
        if "uv" in asked:
            found["uvs"], found["uv_faces"] = gatherer.uvs(bool(features["UV_INDICES"]), untextured=True)
        if features["MIRRORED"]:
            found["mirrored"] = gatherer.mirrored()
        if "scalar" in asked:
            found["scalars"], found["scalar_exponent"] = gatherer.corner_scalars()
    if "object_id" in asked:
        found["objects"] = gatherer.per_face(range(1, len(scene.meshes) + 1), np.uint32)
    if "material_id" in asked:
        found["materials"] = gatherer.per_face(material_numbers(scene), np.uint32)
    if "instance_id" in asked and not light["INSTANCES"]:
        found["instances"] = gatherer.per_copy(first_instances(scene))
    return LayerTables(features, **found)
