"""Meshes of a glTF file: primitives with their attributes, morphed by weights and moved by joints."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.input_files import file_error
from ...images.decode import srgb_to_linear
from ..model import MAX_FACES, Mesh, with_fields
from ..normals import crease_normals, flat_normals
from ..triangulate import single_fan, strips
from .gltf_accessors import Buffers
from .gltf_json import Item
from .gltf_materials import Materials, Surface, transformed, with_coordinates
from .gltf_nodes import MAX_NODES, Placed, Placement
from .gltf_skins import Influences, influences_of, joint_matrices, skinned
from .options import Options, mended_normals

_FEW = 1 << 12  # faces of a mesh whose flat normals are computed together with those of others
MAX_SCALARS = 64  # of a primitive


_BARE = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


@dataclass(frozen=True, eq=False)
class _Shape:
    """A primitive that has triangles. faces: (F, 3) indices into the rows `used` (V,) of its attributes, None for all of
    them. count: rows of its attributes. targets: its morph targets."""

    item: Item
    attributes: Item
    surface: Surface
    faces: Array
    used: Array | None
    count: int
    targets: tuple[Item, ...]


class MeshBuilder:
    """Converts the meshes of a document, in any pose; arrays, and meshes that do not change their shape, are made once.

    ignored: collects a few words for each feature that is not rendered.
    """

    def __init__(
        self, document: Item, buffers: Buffers, materials: Materials, options: Options, ignored: list[str]
    ) -> None:
        self.document, self.buffers, self.materials = document, buffers, materials
        self.options, self.ignored = options, ignored
        self.faces = self.placements = 0
        self._checked: dict[tuple[int, bool], Array] = {}
        self._shapes: dict[str, _Shape | None] = {}
        self._plain: dict[str, Mesh] = {}
        self._influences: dict[tuple[str, int], Influences] = {}

    def meshes(self, nodes: Placed) -> tuple[Mesh, ...]:
        """Return all primitives of the placed meshes, in the order of the file; those of one mesh are parts of one object.

        The placements of a primitive are those of one Mesh, but for each that has a skin or weights of its own.
        """
        self.faces = self.placements = 0
        found: list[Mesh] = []
        joints: dict[int, Floats] = {}
        for index in sorted(nodes.meshes):
            for primitive in self.document.entry("meshes", index).items("primitives"):
                self._count(primitive, len(nodes.meshes[index]))
        for index in sorted(nodes.meshes):
            item = self.document.entry("meshes", index)
            primitives = list(item.items("primitives"))
            groups = [(group, _weights(item, primitives, group[0])) for group in _groups(nodes.meshes[index])]
            # That of the mesh, else of a node that has it, else of the file, with its number if there are several.
            name = item.text("name") or next((each.name for each in nodes.meshes[index] if each.name), "")
            stem = os.path.splitext(os.path.basename(self.document.owner))[0]
            name = name or (stem if self.document.count("meshes") == 1 else f"{stem} {index}")
            for primitive in primitives:
                if primitive.where not in self._shapes:
                    self._shapes[primitive.where] = self._shape(primitive)
                shape = self._shapes[primitive.where]
                if shape is None:
                    continue
                for number, (group, weights) in enumerate(groups):
                    skin = group[0].skin
                    if skin is not None and skin not in joints:
                        joints[skin] = joint_matrices(self.document, self.buffers, skin, nodes.worlds)
                    mesh, placement = self._mesh(shape, weights, None if skin is None else joints[skin])
                    own = np.array([each.matrix for each in group]) if placement is None else placement[None]
                    own.flags.writeable = False
                    names = [each.name for each in (group if placement is None else group[:1])]
                    part_of = f"{name}, meshes[{index}].{number}" if len(primitives) > 1 else ""
                    named = {"name": name, "instance_names": tuple(names) if any(names) else (), "part_of": part_of}
                    found.append(with_fields(mesh, instances=own, **named))
        return _with_flat_normals(found)

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

    def _shape(self, item: Item) -> _Shape | None:
        """Read a primitive's triangles; None if it has no visible ones."""
        attributes = item.item("attributes")
        if attributes is None:
            raise item.error("attributes", "an object", "none")
        if item.integer("mode", 4) in (0, 1, 2, 3):
            self.ignored.append("points and lines")
            return None
        for index in (attributes.reference("POSITION", "accessors"), item.reference("indices", "accessors")):
            self.buffers.check_data(item, index)
        verts = self._attribute(attributes, "POSITION", 3)
        surface = self.materials.surface(item.reference("material", "materials"))
        if verts is None:
            return None
        faces = self._triangles(item, len(verts))
        if not len(faces):
            return None
        used = None
        if len(verts) > 6 * len(faces):  # a small part of a large array
            used, inverse = np.unique(faces, return_inverse=True)
            faces = inverse.reshape(faces.shape).astype(np.int32)
        return _Shape(item, attributes, surface, faces, used, len(verts), tuple(item.items("targets")))

    def _mesh(self, shape: _Shape, weights: Floats, joints: Floats | None) -> tuple[Mesh, Array | None]:
        """Return a primitive, and its placement in the world if its vertices are skinned.

        weights: of its morph targets. joints: what moves vertices with each joint, (J, 3, 4), None without a skin.
        """
        has_joints = "JOINTS_0" in shape.attributes.value
        if has_joints != (joints is not None):
            self.ignored.append("joints of meshes without a skin" if has_joints else "skins of meshes without joints")
        targets = [(w, target) for w, target in zip(weights.tolist(), shape.targets, strict=True) if w]
        if joints is not None and has_joints:
            return self._assembled(shape, targets, joints)
        if targets:
            return self._assembled(shape, targets, None)
        if shape.item.where not in self._plain:
            self._plain[shape.item.where] = self._assembled(shape, [], None)[0]
        return self._plain[shape.item.where], None

    def _assembled(
        self, shape: _Shape, targets: list[tuple[float, Item]], joints: Floats | None
    ) -> tuple[Mesh, Array | None]:
        """Assemble a Mesh: first morphed, then skinned. targets: morph targets with their weights."""
        attributes, faces, used, surface = shape.attributes, shape.faces, shape.used, shape.surface

        def rows(name: str, *widths: int) -> Array | None:
            values = self._attribute(attributes, name, *widths, count=shape.count)
            if values is None:
                return None
            values = values if used is None else values[used]
            values = self._mended(shape, values) if name == "NORMAL" else values
            return self._morphed(name, values, shape, targets) if targets else values

        normals, colors = rows("NORMAL", 3), rows("COLOR_0", 3, 4)
        uvs = [transformed(rows(f"TEXCOORD_{number}", 2), transform) for number, transform in surface.coordinates]
        if any(each is None for each in uvs):
            self.ignored.append("textures of meshes without their texture coordinates")
        if colors is not None and not surface.alpha_counts:
            colors = colors[:, :3]
        if colors is not None and self.options.vertex_colors == "srgb":
            linear = srgb_to_linear(np.maximum(colors[:, :3], 0.0))
            colors = np.hstack([linear.astype(np.float32), colors[:, 3:]])
        material = self.options.lit(with_coordinates(surface.material, uvs))
        any_uvs = next((each for each in uvs if each is not None), None)
        all_uvs = [] if any_uvs is None else [np.zeros_like(any_uvs) if each is None else each for each in uvs]
        tangents = None
        if normals is not None and material.microfacets.normal_texture is not None:
            tangents = rows("TANGENT", 4)
        vectors = {"POSITION": rows("POSITION", 3), "NORMAL": normals, "TANGENT": tangents}
        placement, found = self._placed(shape, vectors, joints)
        own, normals, tangents = found["POSITION"], found.get("NORMAL"), found.get("TANGENT")
        if (targets or joints is not None) and not all(np.isfinite(values).all() for values in found.values()):
            raise shape.item.error("attributes", "finite positions and directions in every pose", "an overflow")
        normal_faces = None
        if normals is None and (self.options.crease or own.dtype != np.float32 or len(faces) > _FEW):
            normals, normal_faces = crease_normals(own, faces, self.options.crease or 0.0)
        scalars = {
            name: values if used is None else values[used] for name, values in self._scalars(attributes, shape.count)
        }
        arrays: dict[str, Any] = {
            "verts": own,
            "faces": faces,
            "normals": normals,
            "normal_faces": normal_faces,
            "tangents": tangents,
        }
        fields: dict[str, Any] = {
            "uvs": all_uvs[0] if all_uvs else None,
            "more_uvs": tuple(all_uvs[1:]),
            "material": material,
        }
        if colors is not None or scalars:
            return Mesh(**arrays, **fields, colors=colors, scalars=scalars), placement
        for array in (*arrays.values(), *all_uvs):
            if array is not None:
                array.flags.writeable = False
        return with_fields(_BARE, **arrays, **fields), placement  # accessors have been checked

    def _mended(self, shape: _Shape, normals: Array) -> Array:
        """Return normals (V, 3), computed from the faces where those of the file are 0 or not finite."""
        verts, count = self._attribute(shape.attributes, "POSITION", 3), len(normals)
        assert verts is not None
        verts = verts if shape.used is None else verts[shape.used]
        where = f"{shape.item.owner}: {shape.attributes.where}.NORMAL"
        normals, corners = mended_normals(verts, shape.faces, normals, shape.faces, where)
        if corners is not shape.faces:
            normals[shape.faces] = normals[corners]
        return normals[:count]

    def _morphed(self, name: str, values: Array, shape: _Shape, targets: list[tuple[float, Item]]) -> Array:
        """Return an attribute with the displacements of morph targets, computed in float64 and rounded to float32."""
        width, sums = 3 if name == "TANGENT" else values.shape[1], values.astype(np.float64)
        for weight, target in targets:
            moved = self._attribute(target, name, width, count=shape.count)
            if moved is not None:
                moved = moved if shape.used is None else moved[shape.used]
                with np.errstate(over="ignore", invalid="ignore"):  # refused afterwards
                    sums[:, :width] += weight * moved.astype(np.float64)
        if name.startswith("COLOR"):
            sums = np.clip(sums, 0.0, 1.0)
        return _float32(sums)

    def _placed(
        self, shape: _Shape, vectors: dict[str, Array | None], joints: Floats | None
    ) -> tuple[Array | None, dict[str, Array]]:
        """Return placement and attributes as `skinned` makes them; without joints None and those that are there."""
        there = {name: values for name, values in vectors.items() if values is not None}
        if joints is None:
            return None, there
        key = shape.item.where, len(joints)
        if key not in self._influences:
            self._influences[key] = influences_of(shape.attributes, self.buffers, shape.count, shape.used, len(joints))
        moved, placement = skinned(there, self._influences[key], joints)
        return placement, {name: _float32(values) for name, values in moved.items()}

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
        """Return (V, width) float32 values of an attribute, finite except for normals, texture coordinates and the
        application's own; None if missing."""
        index = attributes.reference(name, "accessors")
        if index is None:
            return None
        values = self.buffers.array(index)
        if values.shape[1] not in widths or (count is not None and len(values) != count):
            expected = f"{count or 'rows'} of {' or '.join(map(str, widths))} numbers"
            raise attributes.error(name, expected, f"{values.shape[0]} of {values.shape[1]} in accessors[{index}]")
        any_value = name.startswith(("TEXCOORD", "NORMAL", "_"))
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


def _with_flat_normals(meshes: Sequence[Mesh]) -> tuple[Mesh, ...]:
    """Return meshes in which those of a few faces without normals have one for each face, computed together.

    Products of float32 positions are in the range of float64, so that no face needs a scale of its mesh's.
    """
    bare = [mesh for mesh in meshes if mesh.normals is None]
    if not bare:
        return tuple(meshes)
    a, b, c = np.concatenate([mesh.verts[mesh.faces] for mesh in bare]).astype(np.float64).transpose(1, 2, 0) * 0.5
    normals, indices = flat_normals(b - a, c - a), np.repeat(np.arange(_FEW, dtype=np.int32), 3).reshape(-1, 3)
    normals.flags.writeable = indices.flags.writeable = False
    ends = iter(np.cumsum([len(mesh.faces) for mesh in bare]).tolist())

    def completed(mesh: Mesh) -> Mesh:
        count, end = len(mesh.faces), next(ends)
        return with_fields(mesh, normals=normals[end - count : end], normal_faces=indices[:count])

    return tuple(completed(mesh) if mesh.normals is None else mesh for mesh in meshes)


def _groups(placements: Sequence[Placement]) -> list[list[Placement]]:
    """Group the placements of a mesh that have one shape, whatever the pose."""
    groups: dict[int | None, list[Placement]] = {}
    for placement in placements:
        groups.setdefault(placement.node, []).append(placement)
    return list(groups.values())


def _weights(item: Item, primitives: Sequence[Item], placement: Placement) -> Floats:
    """Return the weights of the morph targets of a mesh where it is placed."""
    if placement.weights is None and not any("targets" in primitive.value for primitive in primitives):
        return np.zeros(0)
    counts = [len(list(primitive.items("targets"))) for primitive in primitives]
    for primitive, count in zip(primitives, counts, strict=True):
        if count != counts[0]:
            raise primitive.error("targets", f"{counts[0]}, as many as the mesh's first primitive has", str(count))
    if placement.weights is not None:
        return placement.weights
    count = counts[0] if counts else 0
    return item.numbers("weights", count) if count and "weights" in item.value else np.zeros(count)


def _float32(values: Floats) -> Array:
    with np.errstate(over="ignore"):  # refused afterwards
        return values.astype(np.float32)
