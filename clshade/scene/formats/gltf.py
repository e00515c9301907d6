"""Scenes from glTF 2.0 files, .gltf and .glb.

Own code on NumPy, because trimesh 5.2 loses wrap modes, texture transforms, alpha masks, blending, double-sidedness, vertex
colors next to a texture, cameras and lights, and the order of the file; and it accepts indices out of range and
infinite positions.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted
from .. import fitting, framing
from ..model import MAX_FACES, Mesh, Scene
from ..normals import crease_normals
from ..triangulate import single_fan, strips
from .gltf_accessors import Buffers, open_gltf
from .gltf_json import Item
from .gltf_lights import lights_of
from .gltf_materials import Materials, Surface, transformed, with_coordinates
from .gltf_nodes import MAX_NODES, Placed, camera_of, placed
from .options import Options, warn_ignored

# Extensions that are rendered, and those that a renderer may ignore.
RENDERED = (
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
)
MAX_SCALARS = 64  # of a primitive
_SILENT = ("KHR_xmp_json_ld", "KHR_xmp")


def read_gltf(path: Path, options: Options) -> Scene:
    """Read a glTF file, a scene of preset pbr. Every triangle primitive of a mesh becomes a Mesh with all its placements.

    Rendered: node transforms, base color (factor, texture, vertex colors, which are linear), metallic and roughness
    factors (for Phong's model see gltf_materials.phong), with shader pbr also metallic-roughness maps, normal maps,
    occlusion, emission, KHR_materials_ior and _specular; KHR_materials_unlit, alpha masks, double-sidedness (two-sided
    materials are lit on both sides), wrap modes and filters, KHR_texture_transform, strips, fans and sparse accessors, the
    first camera, lights (see gltf_lights.lights_of). Attributes of the application's own with one number per vertex,
    `_NAME`, become Mesh.scalars, NAME. Faces without normals are flat, as glTF specifies, unless options.crease is given.
    Other features of the file are listed in Scene.ignored and in one warning.

    Raises InputError, one line that names the file and the field, see clshade.scene.formats.load.load.
    """
    owner = shown(path)
    document, buffers = open_gltf(path)
    ignored = _check_asset(document)
    nodes = placed(document, ignored)
    materials = Materials(document, buffers, options.texture, ignored)
    meshes = _Builder(document, buffers, materials, options, ignored).meshes(nodes)
    if not meshes:
        raise file_error(owner, "meshes", "at least one triangle in the scene", "none")
    if options.texture is not None and all(mesh.uvs is None for mesh in meshes):
        raise file_error(owner, "TEXCOORD_0", "texture coordinates for the texture", "none")
    sphere = fitting.bounding_sphere(meshes)
    camera = None if options.fit else camera_of(document, nodes, sphere, options.resolution)
    if len(nodes.cameras) > 1 and not options.fit:
        ignored.append("cameras but the first")
    lights, light_scale = lights_of(nodes.lights, sphere, ignored)
    scene = framing.framed(
        meshes,
        os.path.splitext(os.path.basename(os.fspath(path)))[0],
        options.resolution,
        up=options.up or "y",
        camera=camera,
        lights=lights,
        sphere=sphere,
    )
    return warn_ignored(replace(scene, preset="pbr", light_scale=light_scale), owner, ignored)


def _check_asset(document: Item) -> list[str]:
    """Return the extensions and contents of the file that are not rendered.

    Raises InputError for another version, and for an extension that is required and unknown.
    """
    asset = document.item("asset")
    version = "" if asset is None else asset.text("version")
    if version.split(".")[0] != "2":
        raise document.error("asset.version", "2.0", quoted(version) if version else "none")
    for name in _names(document, "extensionsRequired"):
        if name not in RENDERED and name not in _SILENT:
            raise document.error("extensionsRequired", "known ones (" + ", ".join(RENDERED) + ")", quoted(name))
    used = _names(document, "extensionsUsed")
    ignored = [name for name in used if name not in RENDERED and name not in _SILENT]
    return ignored + (["animations"] if document.count("animations") else [])


def _names(document: Item, key: str) -> list[str]:
    names = document.value.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) and name.isprintable() for name in names):
        raise document.error(key, "a list of names", quoted(repr(names)))
    return [name if len(name) <= 64 else name[:64] + "..." for name in names[:64]]


class _Builder:
    """Converts the meshes of a document; the arrays of an accessor are shared between them."""

    def __init__(
        self, document: Item, buffers: Buffers, materials: Materials, options: Options, ignored: list[str]
    ) -> None:
        self.document, self.buffers, self.materials = document, buffers, materials
        self.options, self.ignored = options, ignored
        self.faces = self.placements = 0
        self._checked: dict[tuple[int, bool], Array] = {}

    def meshes(self, nodes: Placed) -> tuple[Mesh, ...]:
        """Return all primitives of the placed meshes, in the order of the file."""
        found = []
        for index in sorted(nodes.meshes):
            for primitive in self.document.entry("meshes", index).items("primitives"):
                self._count(primitive, len(nodes.meshes[index]))
        for index in sorted(nodes.meshes):
            item, matrices = self.document.entry("meshes", index), np.stack(nodes.meshes[index])
            primitives = list(item.items("primitives"))
            for number, primitive in enumerate(primitives):
                mesh = self._mesh(primitive)
                if mesh is not None:
                    name = item.text("name") + (f".{number}" if len(primitives) > 1 else "")
                    found.append(replace(mesh, name=name, instances=matrices))
        return tuple(found)

    def _count(self, item: Item, placements: int) -> None:
        """Count triangles and placements before any is created. Raises InputError for too many."""
        attributes = item.item("attributes")
        index = item.reference("indices", "accessors")
        if index is None and attributes is not None:
            index = attributes.reference("POSITION", "accessors")
        if index is None:
            return
        corners = self.document.entry("accessors", index).integer("count", least=1)
        self.faces += placements * (corners // 3 if item.integer("mode", 4) == 4 else max(corners - 2, 0))
        self.placements += placements
        if self.faces > MAX_FACES or self.placements > MAX_NODES:
            expected = f"a scene of at most {MAX_FACES} triangles and {MAX_NODES} placements"
            raise file_error(item.owner, item.where, expected, "more")

    def _mesh(self, item: Item) -> Mesh | None:
        """Return a primitive without its placements, or None if it has no visible triangles."""
        attributes = item.item("attributes")
        if attributes is None:
            raise item.error("attributes", "an object", "none")
        if "targets" in item.value:
            self.ignored.append("morph targets")
        if item.integer("mode", 4) in (0, 1, 2, 3):
            self.ignored.append("points and lines")
            return None
        verts = self._attribute(attributes, "POSITION", 3)
        surface = self.materials.surface(item.reference("material", "materials"))
        if verts is None:
            return None
        faces = self._triangles(item, len(verts))
        if not len(faces):
            return None
        if len(verts) > 6 * len(faces):  # a small part of a large array
            used, inverse = np.unique(faces, return_inverse=True)
            return self._assembled(attributes, surface, verts, inverse.reshape(faces.shape).astype(np.int32), used)
        return self._assembled(attributes, surface, verts, faces, None)

    def _assembled(self, attributes: Item, surface: Surface, verts: Array, faces: Array, used: Array | None) -> Mesh:
        """Assemble a Mesh. used: (V,) the rows that are kept of each attribute, None for all."""

        def rows(name: str, *widths: int) -> Array | None:
            values = self._attribute(attributes, name, *widths, count=len(verts))
            return values if used is None or values is None else values[used]

        normals, colors = rows("NORMAL", 3), rows("COLOR_0", 3, 4)
        uvs = [transformed(rows(f"TEXCOORD_{number}", 2), transform) for number, transform in surface.coordinates]
        if any(each is None for each in uvs):
            self.ignored.append("textures of meshes without their texture coordinates")
        if colors is not None and not surface.alpha_counts:
            colors = colors[:, :3]
        own = verts if used is None else verts[used]
        normal_faces = None
        if normals is None:
            normals, normal_faces = crease_normals(own, faces, self.options.crease or 0.0)
        material = self.options.lit(with_coordinates(surface.material, uvs), by_file=True)
        any_uvs = next((each for each in uvs if each is not None), None)
        all_uvs = [] if any_uvs is None else [np.zeros_like(any_uvs) if each is None else each for each in uvs]
        tangents = None
        if normal_faces is None and material.microfacets.normal_texture is not None:
            tangents = rows("TANGENT", 4)
        scalars = {
            name: values if used is None else values[used] for name, values in self._scalars(attributes, len(verts))
        }
        return Mesh(
            own,
            faces,
            colors,
            normals,
            normal_faces,
            all_uvs[0] if all_uvs else None,
            material=material,
            scalars=scalars,
            tangents=tangents,
            more_uvs=all_uvs[1:],
        )

    def _scalars(self, attributes: Item, count: int) -> Iterator[tuple[str, Array]]:
        """Yield the application's own attributes with one number per vertex, (V,), by name without the underscore."""
        names = [name for name in attributes.value if name.startswith("_") and len(name) > 1]
        for number, name in enumerate(names):
            index = attributes.reference(name, "accessors")
            if number >= MAX_SCALARS or index is None or self.buffers.array(index).shape[1] != 1:
                self.ignored.append(f"attribute {name[:32]}")
                continue
            values = self._attribute(attributes, name, 1, count=count)
            if values is not None:
                yield name[1:], values[:, 0]

    def _attribute(self, attributes: Item, name: str, *widths: int, count: int | None = None) -> Array | None:
        """Return (V, width) float32 values of an attribute, finite except for texture coordinates and the application's
        own; None if missing."""
        index = attributes.reference(name, "accessors")
        if index is None:
            return None
        values = self.buffers.array(index)
        if values.shape[1] not in widths or (count is not None and len(values) != count):
            expected = f"{count or 'rows'} of {' or '.join(map(str, widths))} numbers"
            raise attributes.error(name, expected, f"{values.shape[0]} of {values.shape[1]} in accessors[{index}]")
        any_value = name.startswith(("TEXCOORD", "_"))
        if (index, any_value) not in self._checked:
            values = values.astype(np.float32, copy=False)
            if not any_value and not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
                found = f"{values[row].tolist()} in row {row} of accessors[{index}]"
                raise attributes.error(name, "finite numbers", found)
            self._checked[index, any_value] = values
        return self._checked[index, any_value]

    def _triangles(self, item: Item, count: int) -> Array:
        """Return (F, 3) int32 indices below `count`. Raises InputError for others, and for an incomplete triangle."""
        index, mode = item.reference("indices", "accessors"), item.integer("mode", 4)
        if mode not in (4, 5, 6):
            raise item.error("mode", "a number from 0 to 6", str(mode))
        if index is None:
            flat = np.arange(count, dtype=np.int32)
        else:
            values = self.buffers.array(index, normalized=False)
            if values.shape[1] != 1 or values.dtype.kind != "u":
                raise item.error("indices", "whole numbers of type SCALAR", f"another type in accessors[{index}]")
            flat, most = values.reshape(-1), np.iinfo(values.dtype).max
            if int(flat.max()) == most:  # glTF 2.0, section 3.7.2.1: it would restart a strip or fan
                place = int(np.argmax(flat == most))
                expected = f"indices below {most}, the largest of their type"
                raise item.error("indices", expected, f"{most} at place {place} of accessors[{index}]")
            if int(flat.max()) >= count:
                place = int(np.argmax(flat >= count))
                found = f"{flat[place]} at place {place} of accessors[{index}]"
                raise item.error("indices", f"indices below {count}", found)
            flat = flat.astype(np.int32)
        if mode == 4 and len(flat) % 3:
            raise item.error("indices", "a multiple of 3", str(len(flat)))
        if mode == 4:
            return flat.reshape(-1, 3)
        return strips(flat) if mode == 5 else single_fan(flat)
