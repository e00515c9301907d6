"""Meshes of a glTF file: primitives with their attributes, morphed by weights and moved by joints (section 3.7.3)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array, Floats, Integers
from ...images.decode import srgb_to_linear
from ..geometry import crease_normals, flat_normals
from ..model import MAX_FACES, Mesh, with_fields
from ..triangulate import single_fan, strips
from .gltf_data import GltfData, Item
from .gltf_materials import Materials, Surface, transform_uvs, with_coordinates
from .gltf_nodes import MAX_NODES, Placed, Placement
from .reading import Options, name_of, repair_normals

_FEW = 1 << 12  # faces of a mesh whose flat normals are computed in a batch
MAX_SCALARS = 64  # of a primitive
TOLERANCE = 0.01  # of the sum of a vertex's weights: four of 8 bits, rounded each by itself, are 0.0078 off
_AFFINE = 1e-4  # of the last row of an inverse bind matrix, which exporters compute in float32
_BLOCK = 1 << 15  # vertices that are blended at a time, 12 MiB of matrices
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
    """Converts the meshes of a file, in any pose; arrays, and meshes that do not change their shape, are made once."""

    def __init__(self, file: GltfData, options: Options) -> None:
        self.document, self.file, self.ignored = file.document, file, file.ignored
        self.options, self.materials = options, Materials(file, options.texture)
        self.faces = self.placements = 0
        self._checked: dict[tuple[int, bool], Array] = {}
        self._shapes: dict[str, _Shape | None] = {}
        self._plain: dict[str, Mesh] = {}
        self._influences: dict[tuple[str, int], Influences] = {}

    def meshes(self, nodes: Placed) -> tuple[Mesh, ...]:
        """Return all primitives of the placed meshes, in file order; primitives of one mesh are parts of one object.

        A primitive with all its placements is one Mesh, except for placements with a skin or their own weights.
        """
        self.faces = self.placements = 0
        meshes: list[Mesh] = []
        joints: dict[int, Floats] = {}
        for index in sorted(nodes.meshes):
            for primitive in self.document.entry("meshes", index).items("primitives"):
                self._count(primitive, len(nodes.meshes[index]))
        for index in sorted(nodes.meshes):
            item = self.document.entry("meshes", index)
            primitives = list(item.items("primitives"))
            by_shape: dict[int | None, list[Placement]] = {}  # those of one shape, whatever the pose
            for placement in nodes.meshes[index]:
                by_shape.setdefault(placement.node, []).append(placement)
            groups = [(group, _weights(item, primitives, group[0])) for group in by_shape.values()]
            # The name of the mesh, else of a node that has it, else of the file, with its number if there are several.
            names_of_nodes = (placement.name for placement in nodes.meshes[index] if placement.name)
            suffix = f" {index}" if self.document.count("meshes") > 1 else ""
            name = item.text("name") or next(names_of_nodes, "") or name_of(self.file.path) + suffix
            for primitive in primitives:
                if primitive.where not in self._shapes:
                    self._shapes[primitive.where] = self._shape(primitive)
                shape = self._shapes[primitive.where]
                if shape is None:
                    continue
                for number, (group, weights) in enumerate(groups):
                    skin = group[0].skin
                    if skin is not None and skin not in joints:
                        joints[skin] = joint_matrices(self.document, skin, nodes.worlds)
                    mesh, matrix = self._mesh(shape, weights, None if skin is None else joints[skin])
                    matrices = np.array([placement.matrix for placement in group]) if matrix is None else matrix[None]
                    matrices.flags.writeable = False
                    names = tuple(placement.name for placement in (group if matrix is None else group[:1]))
                    part_of = f"{name}, meshes[{index}].{number}" if len(primitives) > 1 else ""
                    naming = {"name": name, "instance_names": names if any(names) else (), "part_of": part_of}
                    meshes.append(with_fields(mesh, instances=matrices, **naming))
        return _with_flat_normals(meshes)

    def _count(self, item: Item, placements: int) -> None:
        """Count triangles and placements before any is created. Raises InputError for too many."""
        attributes = item.item("attributes")
        index = item.reference("indices", "accessors")
        if index is None and attributes is not None:
            index = attributes.reference("POSITION", "accessors")
        if index is None:
            return
        corners = self.document.entry("accessors", index).integer("count", minimum=1)
        self.faces += placements * (corners // 3 if item.integer("mode", 4) == 4 else max(corners - 2, 0))
        self.placements += placements
        if self.faces > MAX_FACES or self.placements > MAX_NODES:
            expected = f"a scene of at most {MAX_FACES} triangles and {MAX_NODES} placements"
            raise item.error("", expected, "more")

    def _shape(self, item: Item) -> _Shape | None:
        """Read a primitive's triangles; None if it has no visible ones."""
        attributes = item.item("attributes")
        if attributes is None:
            raise item.error("attributes", "an object", "none")
        if item.integer("mode", 4) in (0, 1, 2, 3):
            self.ignored.append("points and lines")
            return None
        for index in (attributes.reference("POSITION", "accessors"), item.reference("indices", "accessors")):
            self.file.check_data(item, index)
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
        if targets or (joints is not None and has_joints):
            return self._assembled(shape, targets, joints if has_joints else None)
        if shape.item.where not in self._plain:
            self._plain[shape.item.where] = self._assembled(shape, [], None)[0]
        return self._plain[shape.item.where], None

    def _assembled(
        self, shape: _Shape, targets: list[tuple[float, Item]], joints: Floats | None
    ) -> tuple[Mesh, Array | None]:
        """Assemble a Mesh: first morphed, then skinned. targets: morph targets with their weights."""
        faces, surface = shape.faces, shape.surface

        def rows(name: str, *widths: int) -> Array | None:
            values = self._rows(shape, name, *widths)
            if values is not None and name == "NORMAL":
                values = self._repair_normals(shape, values)
            return self._morphed(name, values, shape, targets) if targets and values is not None else values

        vectors = {"POSITION": rows("POSITION", 3), "NORMAL": rows("NORMAL", 3)}
        colors = rows("COLOR_0", 3, 4)
        uvs = [transform_uvs(rows(f"TEXCOORD_{number}", 2), transform) for number, transform in surface.coordinates]
        if any(table is None for table in uvs):
            self.ignored.append("textures of meshes without their texture coordinates")
        if colors is not None and not surface.alpha_counts:
            colors = colors[:, :3]
        if colors is not None and self.options.vertex_colors == "srgb":
            linear = srgb_to_linear(np.maximum(colors[:, :3], 0.0))
            colors = np.hstack([linear.astype(np.float32), colors[:, 3:]])
        material = self.options.lit(with_coordinates(surface.material, uvs))
        any_uvs = next((table for table in uvs if table is not None), None)
        all_uvs = [] if any_uvs is None else [np.zeros_like(any_uvs) if table is None else table for table in uvs]
        if vectors["NORMAL"] is not None and material.microfacets.normal_texture is not None:
            vectors["TANGENT"] = rows("TANGENT", 4)
        present, placement = self._skinned(shape, vectors, joints)
        if (targets or joints is not None) and not all(np.isfinite(values).all() for values in present.values()):
            raise shape.item.error("attributes", "finite positions and directions in every pose", "an overflow")
        verts = present["POSITION"]
        arrays = {"verts": verts, "faces": faces, "normals": present.get("NORMAL"), "tangents": present.get("TANGENT")}
        if "NORMAL" not in present and (self.options.crease or verts.dtype != np.float32 or len(faces) > _FEW):
            arrays["normals"], arrays["normal_faces"] = crease_normals(verts, faces, self.options.crease or 0.0)
        arrays["uvs"] = all_uvs[0] if all_uvs else None
        fields: dict[str, Any] = {**arrays, "more_uvs": tuple(all_uvs[1:]), "material": material}
        scalars = dict(self._scalars(shape))
        if colors is not None or scalars:
            return Mesh(**fields, colors=colors, scalars=scalars), placement
        for array in (*arrays.values(), *all_uvs):
            if array is not None:
                array.flags.writeable = False
        return with_fields(_BARE, **fields), placement  # accessors have been checked

    def _skinned(
        self, shape: _Shape, vectors: dict[str, Array | None], joints: Floats | None
    ) -> tuple[dict[str, Array], Array | None]:
        """Return the attributes that are there, moved by joints if there are any, and the placement that they then need."""
        present = {name: values for name, values in vectors.items() if values is not None}
        if joints is None:
            return present, None
        key = shape.item.where, len(joints)
        if key not in self._influences:
            self._influences[key] = read_influences(shape.attributes, shape.count, shape.used, len(joints))
        posed, placement = deform(present, self._influences[key], joints)
        return {name: _float32(values) for name, values in posed.items()}, placement

    def _rows(self, shape: _Shape, name: str, *widths: int, target: Item | None = None) -> Array | None:
        """Return an attribute of the vertices in use, or how a morph target moves it, see `_attribute`."""
        values = self._attribute(target or shape.attributes, name, *widths, count=shape.count)
        return values if values is None or shape.used is None else values[shape.used]

    def _repair_normals(self, shape: _Shape, normals: Array) -> Array:
        """Return normals (V, 3); invalid ones, 0 or not finite, are recomputed from the faces."""
        verts, count = self._rows(shape, "POSITION", 3), len(normals)
        assert verts is not None
        where = f"{self.file.owner}: {shape.attributes.where}.NORMAL"
        normals, corners = repair_normals(verts, shape.faces, normals, shape.faces, where)
        if corners is not shape.faces:
            normals[shape.faces] = normals[corners]
        return normals[:count]

    def _morphed(self, name: str, values: Array, shape: _Shape, targets: list[tuple[float, Item]]) -> Array:
        """Return an attribute with the displacements of morph targets, computed in float64 and rounded to float32."""
        width, sums = 3 if name == "TANGENT" else values.shape[1], values.astype(np.float64)
        for weight, target in targets:
            displacements = self._rows(shape, name, width, target=target)
            if displacements is not None:
                with np.errstate(over="ignore", invalid="ignore"):  # refused afterwards
                    sums[:, :width] += weight * displacements.astype(np.float64)
        return _float32(np.clip(sums, 0.0, 1.0) if name.startswith("COLOR") else sums)

    def _scalars(self, shape: _Shape) -> Iterator[tuple[str, Array]]:
        """Yield the application's own attributes with one number per vertex, (V,), by name without the underscore."""
        names = [name for name in shape.attributes.value if name.startswith("_") and len(name) > 1]
        for number, name in enumerate(names):
            index = shape.attributes.reference(name, "accessors")
            if number >= MAX_SCALARS or index is None or self.file.array(index).shape[1] != 1:
                self.ignored.append(f"attribute {name[:32]}")
                continue
            values = self._rows(shape, name, 1)
            if values is not None:
                yield name[1:], values[:, 0]

    def _attribute(self, attributes: Item, name: str, *widths: int, count: int | None = None) -> Array | None:
        """Return (V, width) float32 values of an attribute, finite except for normals, texture coordinates and the
        application's own; None if missing."""
        index = attributes.reference(name, "accessors")
        if index is None:
            return None
        expected = f"{count or 'rows'} of {' or '.join(map(str, widths))} numbers"
        values = attributes.accessor(
            name, expected, lambda rows: rows.shape[1] in widths and (count is None or len(rows) == count)
        )
        any_value = name.startswith(("TEXCOORD", "NORMAL", "_"))
        if (index, any_value) not in self._checked:
            values = values.astype(np.float32, copy=False)
            if not any_value:
                attributes.check_rows(name, np.isfinite(values), "finite numbers", values)
            self._checked[index, any_value] = values
        return self._checked[index, any_value]

    def _triangles(self, item: Item, count: int) -> Array:
        """Return (F, 3) int32 indices below `count`. Raises InputError for others, and for an incomplete triangle."""
        mode = item.integer("mode", 4)
        if mode not in (4, 5, 6):
            raise item.error("mode", "a number from 0 to 6", str(mode))
        if "indices" not in item.value:
            flat = np.arange(count, dtype=np.int32)
        else:
            expected = "whole numbers of type SCALAR"
            values = item.accessor(
                "indices", expected, lambda rows: rows.shape[1] == 1 and rows.dtype.kind == "u", normalized=False
            )
            flat, restart = values.reshape(-1), np.iinfo(values.dtype).max
            if int(flat.max()) >= min(count, restart):
                restarts = int(flat.max()) == restart  # glTF 2.0, section 3.7.2.1: it would restart a strip or fan
                expected = (
                    f"indices below {restart}, the largest of their type" if restarts else f"indices below {count}"
                )
                place = int(np.argmax(flat == restart if restarts else flat >= count))
                wrong = f"{flat[place]} at place {place} of accessors[{item.value['indices']}]"
                raise item.error("indices", expected, wrong)
            flat = flat.astype(np.int32)
        if mode != 4:
            return strips(flat) if mode == 5 else single_fan(flat)
        if len(flat) % 3:
            raise item.error("indices", "a multiple of 3", str(len(flat)))
        return flat.reshape(-1, 3)


def _with_flat_normals(meshes: Sequence[Mesh]) -> tuple[Mesh, ...]:
    """Compute flat normals of the small meshes that lack normals, all at once.

    Products of float32 positions are in the range of float64, so no mesh needs a scale.
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


class Influences(NamedTuple):
    """Which joints move each vertex: joints and weights, (V, K) each; weights add up to 1."""

    joints: Integers
    weights: Floats


def joint_matrices(document: Item, index: int, worlds: Mapping[int, Floats]) -> Floats:
    """Return what moves a vertex with each joint of a skin from the bind pose to the world, (J, 3, 4).

    worlds: the (4, 4) matrix of each node in the world. Raises InputError for a broken skin.
    """
    skin = document.entry("skins", index)
    joints = skin.references("joints", "nodes")
    if not joints:
        raise skin.error("joints", "a skeleton of one node or more", "none")
    skin.reference("skeleton", "nodes")  # a hint for editors
    for joint in joints:
        if joint not in worlds:  # then it is reached from no root
            raise document.error(f"nodes[{joint}]", "a tree of nodes", "a cycle")
    placements: Floats = np.stack([worlds[joint] for joint in joints])
    key, expected, count = "inverseBindMatrices", f"{len(joints)} matrices of 16 float32", len(joints)
    if key not in skin.value:
        return placements[:, :3]
    rows = skin.accessor(
        key, expected, lambda rows: rows.dtype == np.float32 and rows.shape[1] == 16 and len(rows) >= count
    )
    inverse: Floats = rows[:count].reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    last = np.abs(inverse[:, 3] - [0.0, 0.0, 0.0, 1.0]) <= _AFFINE
    good = np.column_stack([np.isfinite(inverse).all(axis=(1, 2)), last])
    skin.check_rows(key, good, "finite matrices with a last row of 0 0 0 1", rows)
    inverse[:, 3] = 0.0, 0.0, 0.0, 1.0
    with np.errstate(over="ignore", invalid="ignore"):
        matrices: Floats = (placements @ inverse)[:, :3]
    if not np.isfinite(matrices).all():
        raise skin.error("joints", "joints at finite places in the world", "an overflow")
    return matrices


def read_influences(attributes: Item, count: int, used: Array | None, joint_count: int) -> Influences:
    """Return the influences on the vertices of a primitive, from all its sets of joints and weights.

    count: rows of its attributes. used: (V,) those that are vertices, None for all.

    Weights are scaled to a sum of 1, with a warning if one is off by more than TOLERANCE; without any, a vertex follows
    the first joint. Raises InputError for other shapes, and joints or weights out of range.
    """

    def table(name: str, kind: str, expected: str) -> Array:
        """Return (V, 4 for each set) numbers of the attributes JOINTS_0, JOINTS_1, ... or WEIGHTS_0, ..."""
        expected, is_index = f"{count} of 4 {expected}", kind == "u"
        sets = [number for number in range(len(attributes.value)) if f"JOINTS_{number}" in attributes.value]

        def fits(rows: Array) -> bool:
            return rows.shape == (count, 4) and rows.dtype.kind == kind

        parts = [attributes.accessor(f"{name}_{number}", expected, fits, normalized=not is_index) for number in sets]
        rows = np.concatenate(parts, axis=1)
        return rows if used is None else rows[used]

    joints = table("JOINTS", "u", "whole numbers")
    weights = table("WEIGHTS", "f", "float32 or normalized integers").astype(np.float64)
    good = np.isfinite(weights) & (weights >= 0.0)
    attributes.check_rows("WEIGHTS", good, "finite numbers of at least 0", weights)
    sums = weights.sum(axis=1)
    off = np.abs(sums - 1.0)
    if off.max() > TOLERANCE:
        row = int(np.argmax(off))
        line = f"WEIGHTS: expected a sum of 1 for each vertex, found {sums[row]:g} in row {row}: scaled"
        warnings.warn(f"{attributes.file.owner}: {attributes.where}.{line}", stacklevel=2)
    weights[sums == 0.0, 0] = 1.0
    weights /= weights.sum(axis=1)[:, None]
    joints = np.where(weights > 0.0, joints, 0)  # what has no weight may have any number
    attributes.check_rows("JOINTS", joints < joint_count, f"indices below {joint_count}", joints)
    return Influences(joints.astype(np.int64), weights)


def deform(vectors: Mapping[str, Array], influences: Influences, matrices: Floats) -> tuple[dict[str, Floats], Floats]:
    """Return positions, normals and tangents, by attribute, in the world, and the placement (4, 4) that they then need.

    vectors: POSITION and NORMAL (V, 3), TANGENT (V, 4), of those that are there. matrices: see `joint_matrices`. Positions
    and tangents are moved by the blended matrix of each vertex, normals by the cofactors of its linear part, which are
    parallel to its inverse transpose and exist for singular ones too; normals then have length 1, or 0 where they vanish.
    What overflows is infinite or NaN.
    The placement is the identity. But if most of the matrices mirror, the result is mirrored in x, and so is the placement:
    by it the renderer knows which sides are front.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses an overflow
        mirror = bool((np.sign(np.linalg.det(matrices[:, :, :3]))[influences.joints] * influences.weights).sum() < 0.0)
        if mirror:
            matrices = matrices * np.array([-1.0, 1.0, 1.0])[:, None]
        posed = {name: np.array(values, np.float64) for name, values in vectors.items()}
        for start in range(0, len(influences.joints), _BLOCK):
            part = slice(start, start + _BLOCK)
            joints, weights = influences.joints[part], influences.weights[part]
            blended = np.zeros((len(joints), 3, 4))
            for joint, weight in zip(joints.T, weights.T, strict=True):
                if weight.any():
                    blended += weight[:, None, None] * matrices[joint]
            linear = blended[:, :, :3]
            for name, values in posed.items():
                if name == "NORMAL":
                    rows = np.moveaxis(_scaled(linear, (1, 2)), 1, 0)
                    cofactors = np.stack([np.cross(rows[k - 2], rows[k - 1]) for k in range(3)], axis=1)
                    normals = _scaled(_products(cofactors, values[part]), 1)
                    x, y, z = normals.T
                    lengths = np.sqrt(x * x + y * y + z * z)
                    values[part] = normals / np.where(lengths == 0.0, 1.0, lengths)[:, None]
                    continue
                directions = _products(linear, values[part, :3])
                values[part, :3] = directions + blended[:, :, 3] if name == "POSITION" else directions
    return posed, np.diag([-1.0 if mirror else 1.0, 1.0, 1.0, 1.0])


def _products(matrices: Floats, vectors: Floats) -> Floats:
    """Return matrices (V, 3, 3) times vectors (V, 3), summed in a fixed order, with equal bits on every machine."""
    x, y, z = (matrices[:, :, column] * vectors[:, column, None] for column in range(3))
    return x + y + z


def _scaled(values: Floats, axes: int | tuple[int, ...]) -> Floats:
    """Return values divided by their largest magnitude over these axes: products of them neither overflow nor vanish."""
    largest = np.abs(values).max(axis=axes, keepdims=True)
    return values / np.where(largest == 0.0, 1.0, largest)
