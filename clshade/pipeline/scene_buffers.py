"""Everything that a scene's frames read on the device, as NumPy arrays."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import host_memory
from ..base.arrays import Array, Bools
from ..errors import DeviceError, InputError
from ..scene.geometry import half_diagonal
from ..scene.model import Scene, Settings
from ..scene.scalar_colors import without_colors
from . import struct_layout
from .features import Features, derive, looked_up_at_corners, looks_up
from .gather import Gatherer
from .instances import InstanceTables, draws_from_one_copy, instance_tables, placed_extent
from .layers import LayerTables, layer_tables
from .opencl.device import Device
from .scalar_tables import ScalarTables, color_table
from .shading_tables import backdrop_table, environment_tables, texture_tables
from .struct_layout import Structs


@dataclass(frozen=True)
class Packed:
    """The arrays that stay on the device between frames. Those that the features leave out are None.

    A real is float32, or float64 with precision float64. positions: (V, 3) world space, float32 or float64. faces: (F, 3)
    int32. normals: (K, 4) reals, unit or 0. normal_faces, uv_faces: (F, 3) int32. colors: (V, 4) or (3F, 4) reals, with
    positions in the color map. color_map: (N + 4, 4) reals. uvs: (T, 4) reals, u and v and their rounding errors, further
    sets after the first. tangents: (K, 4) reals, tangent_faces: (F, 3) int32. face_materials: (F,) int32.
    materials, textures: tables of `struct_layout`'s structs. texels: (X, 4) float32.
    environment, radiance: see `environment_tables`. backdrop: see `backdrop_table`. alphas: (V,) reals.
    corner_uvs, corner_textures: (3F, 4) and (3F,), the lookups of texture_at vertex.
    low, high: (3,) float64, bounding box of the vertices in use. light_unit: see `light_unit`; tinted ambient light is
    expressed in it too. layers: further inputs of layers.
    instances: where instances are drawn from one copy of their mesh. Then positions, normals and tangents are float64, in
    object space, and F and V count each mesh once.
    """

    features: Features
    positions: Array
    faces: Array
    low: Array
    high: Array
    normals: Array | None
    normal_faces: Array | None
    colors: Array | None
    color_map: Array | None
    uvs: Array | None
    uv_faces: Array | None
    face_materials: Array | None
    materials: Array
    textures: Array | None
    texels: Array | None
    tangents: Array | None
    tangent_faces: Array | None
    corner_uvs: Array | None
    corner_textures: Array | None
    environment: Array | None
    radiance: Array | None
    backdrop: Array | None
    alphas: Array | None
    light_unit: float
    layers: LayerTables
    instances: InstanceTables | None


def faces_with(packed: Packed, *members: str) -> Bools:
    """Return which faces have a material with any of some members set, (F,) bool."""
    rows = np.any([packed.materials[name] != 0 for name in members], axis=0)
    of_face = rows[0 if packed.face_materials is None else packed.face_materials]
    return np.broadcast_to(of_face, len(packed.faces))


def pack(scene: Scene, settings: Settings, *, forced: Collection[str] = frozenset(), has_fp64: bool = True) -> Packed:
    """Return the arrays that a render of `scene` under `settings` needs, and the features they imply. forced: see
    features.derive. has_fp64: whether the device has float64, without which instances are copies."""
    structs = struct_layout.DOUBLE if settings.precision == "float64" else struct_layout.SINGLE
    tables = None if settings.scalars is None else ScalarTables.of(scene, settings.scalars)
    given, scene = scene, without_colors(scene, settings.scalars)
    one_copy = has_fp64 and draws_from_one_copy(scene, settings, forced)
    gatherer = Gatherer(scene, structs, forced, tables, maps=settings.shader == "pbr", one_copy=one_copy)
    positions, faces = gatherer.positions()
    features = derive(
        scene,
        settings,
        double_positions=positions.dtype == np.float64,
        instanced=one_copy,
        scalars_at_corners=tables is not None and tables.at_corners,
        forced=forced,
    )
    at_corners = looked_up_at_corners(scene, settings)
    double = features["DOUBLE_POSITIONS"] or one_copy
    positions = positions.astype(np.float64 if double else np.float32, copy=False)
    low, high = (positions.min(axis=0), positions.max(axis=0)) if len(positions) else (np.zeros(3), np.zeros(3))
    if one_copy:
        low, high = placed_extent(gatherer.placed)
    found: dict[str, Any] = dict.fromkeys(Packed.__dataclass_fields__)
    if len(faces):
        if features.needs_any("TERMS"):
            indexed, bends = bool(features["NORMAL_INDICES"]), bool(features["SHADOWS"])
            found["normals"], found["normal_faces"] = gatherer.normals(indexed, bends=bends)
        if features["VERTEX_COLORS"] or features["CORNER_COLORS"]:
            found["colors"] = gatherer.colors(bool(features["CORNER_COLORS"]))
        if features["SCALARS"]:
            found["color_map"] = color_table(tables).astype(structs.real)
        if features["NORMAL_MAP"]:
            found["tangents"], found["tangent_faces"] = gatherer.tangents()
        if features["VERTEX_ALPHA"]:
            found["alphas"] = gatherer.alphas()
        if at_corners or (looks_up(features) and gatherer.textures):
            # The layer uv shows those of meshes without a texture too: with UV_SETS both tables have as many rows.
            untextured = bool(features["UV_SETS"]) and "uv" in settings.layers
            found["uvs"], found["uv_faces"] = gatherer.uvs(bool(features["UV_INDICES"]), untextured=untextured)
            if gatherer.textures:
                found["textures"], found["texels"] = texture_tables(
                    gatherer.textures,
                    mipmaps=settings.texture_filter == "trilinear",
                    uv_rows=len(found["uvs"]) // (1 + max(texture.coordinates for texture in gatherer.textures)),
                )
        if at_corners:
            index = found["uv_faces"] if found["uv_faces"] is not None else faces
            found["corner_uvs"] = np.ascontiguousarray(found["uvs"][index.reshape(-1)])
            found["corner_textures"] = np.repeat(gatherer.face_textures(), 3)
        if features["MATERIALS"] or features["SIDES"]:
            found["face_materials"] = gatherer.face_materials()
    radius = half_diagonal(low.astype(np.float64), high.astype(np.float64))
    unit = gatherer.light_unit(radius, pbr=settings.shader == "pbr")
    if features["ENVIRONMENT"]:
        found["environment"], found["radiance"] = environment_tables(scene.environment, unit, structs)
    if features["BACKDROP"] and scene.environment is not None:
        found["backdrop"] = backdrop_table(scene.environment, structs)
    materials = gatherer.material_table(unit if features["TINTED"] else 1.0, at_corners)
    found.update(positions=positions, faces=faces, materials=materials, light_unit=unit)
    found.update(instances=instance_tables(gatherer, structs) if one_copy else None)
    found.update(layers=layer_tables(gatherer, given, settings, features))
    found.update(features=features, low=low.astype(np.float64), high=high.astype(np.float64))
    return Packed(**found)


MOST_VERTICES = (1 << 31) - 1  # faces name them by int32
_LEAST_ROW = 12  # bytes: three float32 of a vertex, three int32 of a face


def check_host(scene: Scene) -> None:
    """Refuse a scene whose placed meshes have too many vertices, or do not fit into this machine's memory. Raises
    InputError."""
    placed = [(mesh, len(np.asarray(mesh.instances))) for mesh in scene.meshes]
    vertices = sum(len(mesh.verts) * count for mesh, count in placed)
    if vertices > MOST_VERTICES:
        limit = f"at most {MOST_VERTICES} vertices with instances"
        raise InputError(f"render: scene: expected {limit}, found {vertices}")
    copied = sum(_LEAST_ROW * (len(mesh.verts) + len(mesh.faces)) * count for mesh, count in placed if count > 1)
    host_memory.require("render", "scene", copied, f"{scene.face_count:,} triangles with instances")


def check_device(device: Device, packed: Packed, structs: Structs) -> None:
    """Refuse a scene that does not fit into a device's memory. Raises DeviceError.

    A CPU commits memory as it is written: there, buffers of which a frame may write little do not count.
    """
    faces, vertices = len(packed.faces), len(packed.positions)
    tables = {id(table): table for table in vars(packed).values() if isinstance(table, np.ndarray)}
    needed = sum(table.nbytes for table in tables.values())
    needed += 0 if packed.instances is None else packed.instances.rows.nbytes
    needed += vertices * (structs.Vertex.itemsize + 4 * np.dtype(structs.real).itemsize)
    if not device.is_cpu:
        needed += faces * (structs.Triangle.itemsize + structs.Bounds.itemsize + np.dtype(np.int32).itemsize)
    if needed > device.memory:
        what = f"{faces:,} triangles and {vertices:,} vertices take {needed / host_memory.GIB:.1f} GiB or more"
        raise DeviceError(f"{device.name}: {what}, the device has {device.memory / host_memory.GIB:.1f} GiB")
