"""A scene's meshes as flat arrays of vertices and faces: world positions, indices, normals, colors, texture
coordinates; all copies of each mesh, one after the other."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from itertools import groupby
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats, Integers, Reals
from ..scene.geometry import row_blocks, vertex_normals
from ..scene.model import Mesh, Scene, Texture
from ..scene.tangents import mesh_tangents
from .features import material_key, materials_of, replaces_colors, texture_applies
from .light_points import typical_intensities
from .placements import about_one, mirroring, placed_normals, placed_points, placed_tangents
from .scalar_tables import ScalarTables
from .shading_tables import Real, joined, light_unit, map_of, material_table, split, textures_of, to_real
from .struct_layout import MOST_POSITION, NAN_POSITION, WHITE_POSITION, Structs

WHITE = Texture(np.ones((1, 1, 3)))  # multiplying by its texel changes no bit of a color
MOST_BEND, THINNEST = 0.25, 2.0**-20
_MOST_BITS, _LEAST_BITS = math.frexp(MOST_POSITION)[1] - 1, 60  # of scalars that are as large, as small as they are


def _fits_float32(values: Array) -> bool:
    if values.dtype == np.float32:
        return True
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def _bends(normals: Array, index: Array, verts: Array, faces: Array) -> Floats:
    """Return the sine of the largest angle between each unit normal (K, 3) and the faces that have it, at most MOST_BEND,
    (K,). index: (F, 3), the normals at the corners of faces. Faces that are too thin to have a normal do not count."""
    found = np.zeros(len(normals))
    for block in row_blocks(len(faces)):
        a, b, c = np.moveaxis(np.asarray(verts[faces[block]], np.float64), 1, 0)
        across = np.cross(b - a, c - a)
        size, sides = (np.linalg.norm(across, axis=1), np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1))
        counts = size > THINNEST * sides
        unit = across[counts] / size[counts, None]
        for k in range(3):
            rows = index[block][counts, k]
            sine = np.linalg.norm(np.cross(np.asarray(normals[rows], np.float64), unit), axis=1)
            np.maximum.at(found, rows, np.minimum(sine, MOST_BEND))
    return found


def _four(vectors: Array, real: Real) -> Array:
    wide = np.zeros((len(vectors), 4), real)
    wide[:, : vectors.shape[1]] = vectors
    return wide


def own_normals(copies: Copies, scene: Scene) -> tuple[Array, Array, bool]:
    """Return the normals of meshes in object space, (K, 3), their indices (F, 3), and whether they are computed, and so
    unit vectors or 0."""
    mesh = copies.mesh
    if mesh.normals is None or scene.preset == "course":
        return vertex_normals(copies.verts, copies.faces), copies.faces, True
    if mesh.normal_faces is not None:
        return _concatenated(copies.meshes, "normals"), _joined_indices(copies.meshes, "normal_faces", "normals"), False
    return copies.of_vertices("normals"), copies.faces, False


_BATCH = 1 << 12  # vertices of a mesh that is gathered together with others


def _kind(mesh: Mesh, maps: bool) -> tuple[Any, ...] | None:
    """Return what consecutive meshes that are gathered together have in common; None for a mesh that is gathered alone."""
    if len(mesh.verts) > _BATCH or len(np.asarray(mesh.instances)) != 1 or mesh.scalars:
        return None
    if maps and map_of(mesh, "normal_texture") is not None:
        return None
    optional = (mesh.colors, mesh.normals, mesh.normal_faces, mesh.uvs, mesh.uv_faces, mesh.alphas)
    textured = mesh.uvs is not None and bool(textures_of(mesh, maps=maps))
    return mesh.verts.dtype, *(each is None for each in optional), len(mesh.more_uvs), textured, replaces_colors(mesh)


class Copies:
    """The K copies of a mesh that are gathered, or of K consecutive meshes one of each.

    numbers: of the meshes in their scene. mesh, number: the first mesh, which has the same fields as all, and its number.
    count: copies of each mesh. matrices: (K, 4, 4) placements. mirrored: (K,) bool, whether each mirrors. verts: (V, 3) of
    all meshes, without the vertices in no face, which are not uploaded; kept: which those are of the meshes' own, None for
    all. sizes: (2, M) vertices in use and faces of each mesh. faces: (F, 3).
    """

    def __init__(self, numbers: Sequence[int], meshes: Sequence[Mesh]) -> None:
        self.numbers, self.meshes, self.number, self.mesh = numbers, meshes, numbers[0], meshes[0]
        placements = [np.asarray(mesh.instances) for mesh in meshes]
        self.matrices: Floats = np.concatenate(placements) if meshes[1:] else placements[0]
        self.mirrored, self.count = mirroring(self.matrices), len(self.matrices) // len(meshes)
        self.verts: Array = _concatenated(meshes, "verts")
        self.faces: Array = _joined_indices(meshes, "faces", "verts")
        self.sizes: Integers = np.array([(len(mesh.verts), len(mesh.faces)) for mesh in meshes]).T
        self.kept: Array | None = None
        used = np.zeros(len(self.verts), bool)
        used[self.faces] = True
        if not used.all():
            self.kept = np.flatnonzero(used)
            self.verts, self.faces = self.verts[self.kept], (np.cumsum(used, dtype=np.int32) - np.int32(1))[self.faces]
            self.sizes[0] = np.diff(np.searchsorted(self.kept, np.cumsum(self.sizes[0])), prepend=0)

    def one(self, mirrored: bool) -> Copies:
        """Return the mesh itself, or with the winding of one that a placement mirrors."""
        found = copy(self)
        found.matrices, found.mirrored, found.count = np.eye(4)[None], np.array([mirrored]), 1
        return found

    def points(self) -> Array:
        """Return the placed vertices, (K V, 3)."""
        return placed_points(self.verts, self.matrices, self.sizes[0] if self.meshes[1:] else None)

    def directions(self, normals: Array, real: Real, *, is_unit: bool) -> Array:
        """Return the placed normals: of those of meshes with indices of their own, or of the vertices."""
        counts = self.sizes[0] if self.meshes[1:] else None
        if counts is not None and not is_unit and self.mesh.normal_faces is not None:
            counts = np.array([len(mesh.normals) for mesh in self.meshes])  # type: ignore[arg-type]
        return placed_normals(normals, self.matrices, self.mirrored, real, is_unit=is_unit, counts=counts)

    def repeated(self, rows: Array) -> Array:
        """Return rows once for each copy."""
        return rows if self.count == 1 else np.tile(rows, (self.count, *[1] * (rows.ndim - 1)))

    def turned(self, rows: Array) -> Array:
        """Return what belongs to the corners of faces, (F, 3, ...), once for each copy: (K, F, 3, ...), with two corners
        exchanged where a placement mirrors. The winding of its faces is then reversed, so that front stays front."""
        if not self.mirrored.any():
            return rows[None] if self.count == 1 else np.repeat(rows[None], self.count, axis=0)
        if self.meshes[1:]:
            mirrored = np.repeat(self.mirrored, self.sizes[1]).reshape(-1, *[1] * (rows.ndim - 1))
            return np.where(mirrored, rows[:, [0, 2, 1]], rows)[None]
        return np.stack([rows, rows[:, [0, 2, 1]]])[self.mirrored.astype(np.intp)]

    def indices(self, index: Array, rows: int, first: int) -> Array:
        """Return indices (F, 3) of a table's rows for all copies, (K F, 3) int32, each with `rows` of its own, from `first`
        on."""
        if self.count == 1 and not first and not self.mirrored.any():
            return index
        starts = first + rows * np.arange(self.count, dtype=np.int64)
        return (self.turned(index) + starts[:, None, None]).astype(np.int32).reshape(-1, 3)

    def of_vertices(self, name: str) -> Array:
        """Return the rows of the vertices in use, of a field of all meshes that may have more rows."""
        return self.own(_concatenated(self.meshes, name, of_vertices=True))

    def uv_sets(self) -> list[Array]:
        """Return the sets of texture coordinates: of the vertices in use, or all where faces have indices of their own."""
        every: list[tuple[Any, ...]] = [(mesh.uvs, *mesh.more_uvs) for mesh in self.meshes]
        if self.mesh.uv_faces is None:
            counts = [len(mesh.verts) for mesh in self.meshes]
            every = [tuple(rows[:count] for rows in own) for count, own in zip(counts, every, strict=True)]
        sets = [rows[0] if len(rows) == 1 else np.concatenate(rows) for rows in zip(*every, strict=True)]
        return [self.own(rows) for rows in sets] if self.mesh.uv_faces is None else sets

    def own(self, rows: Array) -> Array:
        """Return the rows of the vertices in use, of a table of all of the meshes'."""
        return rows if self.kept is None else rows[self.kept]

    def per_face(self, values: Sequence[Any], kind: Any) -> Array:
        """Return for each face of each copy the value of its mesh."""
        own = np.array([values[number] for number in self.numbers], kind)
        return np.repeat(own, self.sizes[1] * self.count)


def _concatenated(meshes: Sequence[Mesh], name: str, *, of_vertices: bool = False) -> Array:
    rows = [getattr(mesh, name)[: len(mesh.verts)] if of_vertices else getattr(mesh, name) for mesh in meshes]
    return rows[0] if len(rows) == 1 else np.concatenate(rows)


def _joined_indices(meshes: Sequence[Mesh], name: str, rows: str) -> Array:
    if len(meshes) == 1:
        return getattr(meshes[0], name)  # type: ignore[no-any-return]
    counts = [len(getattr(mesh, rows)) for mesh in meshes]
    starts = (np.cumsum(counts) - counts).astype(np.int32)
    found: Array = np.concatenate([getattr(mesh, name) for mesh in meshes])
    found += np.repeat(starts, [len(mesh.faces) for mesh in meshes])[:, None]
    return found


class Gatherer:
    """The arrays of the placed meshes, concatenated in order."""

    def __init__(
        self,
        scene: Scene,
        structs: Structs,
        forced: Collection[str],
        scalars: ScalarTables | None = None,
        *,
        maps: bool = False,
        one_copy: bool = False,
    ) -> None:
        """maps: whether the shader uses the maps of shader pbr. one_copy: whether to gather one copy of each mesh in object
        space, and another one with the winding reversed if some placement mirrors."""
        self.maps, self.one_copy = maps, one_copy
        self.scene, self._structs, self._forced, self.scalars = scene, structs, forced, scalars
        self.materials = materials_of(scene)
        meshes = [(number, mesh) for number, mesh in enumerate(scene.meshes) if len(mesh.faces)]
        table = {id(texture): texture for _, mesh in meshes for texture in textures_of(mesh, maps=maps)}
        self.textures: list[Texture] = list(table.values())
        self._white = len(self.textures)
        if "TEXTURED" in forced or "ALPHA_TEST" in forced:
            self.textures.append(WHITE)
        self.placed: list[Copies] = []
        alone = one_copy or scalars is not None
        for kind, alike in groupby(meshes, key=lambda pair: None if alone else _kind(pair[1], maps)):
            for some in [list(alike)] if kind is not None else ([pair] for pair in alike):
                self.placed.append(Copies(*zip(*some, strict=True)))
        self.copies = self.placed
        if one_copy:
            self.copies = [each.one(side) for each in self.placed for side in np.unique(each.mirrored)]

    def positions(self) -> tuple[Array, Array]:
        if not self.copies:
            return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
        points = [each.points() for each in self.copies]
        fits = all(map(_fits_float32, points))
        faces = self._indices([(each.faces, len(each.verts)) for each in self.copies])
        return joined(points, np.float32 if fits else np.float64), faces

    def _indices(self, own: Sequence[tuple[Array, int]]) -> Array:
        """Return indices, (F, 3) int32, into a table whose rows are gathered copies by copies. own: of each, its indices and
        its number of rows."""
        parts, first = [], 0
        for each, (index, rows) in zip(self.copies, own, strict=True):
            parts.append(each.indices(index, rows, first))
            first += rows * each.count
        return joined(parts, np.int32)

    def normals(self, indexed: bool, *, bends: bool = False) -> tuple[Array, Array | None]:
        """Return the normals, (K, 4), and their indices, (F, 3), if they have their own. bends: the fourth component is as
        of `_bends`. Of one copy they are float64 in object space, of any length, and the fourth is 1 if they are units."""
        parts, index = [], list[tuple[Array, int]]()
        precision = np.float64 if bends else self._structs.real
        for each in self.copies:
            normals, faces, is_unit = own_normals(each, self.scene)
            index.append((faces, len(normals)))
            if self.one_copy:
                rows = _four(normals if is_unit else about_one(normals), np.float64)
                rows[:, 3] = is_unit
                parts.append(rows)
                continue
            own = each.directions(normals, precision, is_unit=is_unit)
            rows = _four(own, self._structs.real)
            if bends:
                own_faces = each.indices(faces, len(normals), 0)
                rows[:, 3] = _bends(own, own_faces, each.points(), each.indices(each.faces, len(each.verts), 0))
            parts.append(rows)
        return joined(parts), self._indices(index) if indexed else None

    def tangents(self) -> tuple[Array, Array]:
        """Return the tangents of meshes with a normal map, (K, 4), unit or 0, with the side of the bitangent, and their
        indices (F, 3). Row 0 is that of all others. Of one copy they are float64 in object space, of any length."""
        real = np.float64 if self.one_copy else self._structs.real
        parts, index = [np.zeros((1, 4), real)], []
        count = 1
        for each in self.copies:
            texture = map_of(each.mesh, "normal_texture")
            if texture is None:
                index.append(each.repeated(np.zeros_like(each.faces)))
                continue
            own, faces = mesh_tangents(each.mesh, texture.coordinates)
            if self.one_copy:
                parts.append(np.column_stack([about_one(own[:, :3]), own[:, 3]]))
            else:
                parts.append(placed_tangents(own, each.matrices, each.mirrored).astype(real))
            index.append(each.indices(faces, len(own), count))
            count += len(own) * each.count
        return joined(parts), joined(index, np.int32)

    def colors(self, at_corners: bool) -> Array:
        """Return colors and positions in the color map of the vertices, (V, 4), or of the faces' corners, (3F, 4)."""
        parts = []
        for each in self.copies:
            mesh, faces = each.mesh, each.faces
            white = mesh.colors is None or replaces_colors(mesh)
            own = np.broadcast_to(1.0, (len(each.verts), 3)) if white else each.of_vertices("colors")
            factors = np.array([mesh.material.color for mesh in each.meshes])
            factors = factors if len(factors) == 1 else np.repeat(factors, each.sizes[0], axis=0)
            rows = np.full((len(own), 4), WHITE_POSITION, self._structs.real)
            for block in row_blocks(len(own)):
                factor = factors if len(factors) == 1 else factors[block]
                rows[block, :3] = to_real(own[block] * factor, self._structs.real)
            positions = None if self.scalars is None else to_real(self.scalars.positions(mesh), self._structs.real)
            if positions is not None and positions.ndim == 1:
                rows[:, 3] = each.own(positions)
            if not at_corners:
                parts.append(each.repeated(rows))
                continue
            rows = rows[faces]
            if positions is not None and positions.ndim == 2:
                rows[:, :, 3] = positions
            parts.append(each.turned(rows).reshape(-1, 4))
        return joined(parts)

    def alphas(self) -> Array:
        """Return the alphas of the vertices, (V,)."""
        parts = []
        for each in self.copies:
            own = np.ones(len(each.verts)) if each.mesh.alphas is None else each.of_vertices("alphas")
            parts.append(each.repeated(to_real(own, self._structs.real)))
        return joined(parts)

    def corner_scalars(self) -> tuple[Array, int]:
        """Return the scalars at the corners of faces, (3F,), over a power of two, NAN_POSITION for none, and the power's
        exponent: 0 unless they are very large or very small."""
        parts = []
        for each in self.copies:
            own = np.full(each.faces.shape, np.nan) if self.scalars is None else self.scalars.values(each.mesh)
            parts.append(each.turned(own).reshape(-1))
        values = np.concatenate(parts)
        own_exponent = int(np.frexp(np.abs(values[np.isfinite(values)]).max(initial=0.0))[1])
        most = np.finfo(self._structs.real).maxexp - _MOST_BITS  # what is beyond a real's range saturates
        large = own_exponent > _MOST_BITS
        exponent = min(own_exponent - _MOST_BITS, most) if large else min(own_exponent + _LEAST_BITS, 0)
        held = np.clip(np.ldexp(values, -exponent), -2.0 * MOST_POSITION, 2.0 * MOST_POSITION)
        return to_real(np.where(np.isnan(values), NAN_POSITION, held), self._structs.real), exponent

    def uvs(self, indexed: bool, *, untextured: bool = False) -> tuple[Array, Array | None]:
        """Return texture coordinates and their indices, each set's after the other's. untextured: include those of meshes
        without a texture, which are 0 otherwise."""
        sets = 1 + max((texture.coordinates for texture in self.textures), default=0)
        parts: list[list[Array]] = [[] for _ in range(sets)]
        index: list[tuple[Array, int]] = []
        for each in self.copies:
            mesh, own_faces = each.mesh, each.faces
            if mesh.uvs is None or not (untextured or textures_of(mesh, maps=self.maps)):
                own: list[Reals] = [np.zeros((len(each.verts), 2))] * sets
            else:
                own = each.uv_sets()[:sets]
                own += [np.zeros_like(own[0])] * (sets - len(own))
                if mesh.uv_faces is not None:
                    own_faces = _joined_indices(each.meshes, "uv_faces", "uvs")
            for part, rows in zip(parts, own, strict=True):
                part.append(each.repeated(split(rows, self._structs.real)))
            index.append((own_faces, len(own[0])))
        return joined([part for each in parts for part in each]), self._indices(index) if indexed else None

    def mirrored(self) -> Array:
        """Return for each face whether its placement mirrors, (F,) int32."""
        return joined([np.repeat(each.mirrored, each.sizes[1]) for each in self.copies], np.int32)

    def per_face(self, values: Sequence[int], kind: type[np.integer[Any]] = np.int32) -> Array:
        """Return for each face the value of its mesh, of `values` for all of the scene's: (F,)."""
        return joined([each.per_face(values, kind) for each in self.copies], kind)

    def per_copy(self, first: Sequence[int]) -> Array:
        """Return for each face the number of its copy, counted from that of its mesh's first one: (F,) uint32."""
        counted = [(each, np.repeat(np.arange(each.count), len(each.faces))) for each in self.copies]
        return joined([each.per_face(first, np.uint32) + own for each, own in counted], np.uint32)

    def face_materials(self) -> Array:
        numbers = {key: i for i, key in enumerate(self.materials)}
        return self.per_face([numbers.get(material_key(mesh), 0) for mesh in self.scene.meshes])

    def light_unit(self, radius: float, *, pbr: bool = False) -> float:
        """Return `shading_tables.light_unit`. radius: of the scene."""
        intensities = typical_intensities(self.scene.lights, radius)
        brightest = 0.0
        meshes = (mesh for each in self.copies for mesh in each.meshes)
        for mesh in {(id(mesh.material), id(mesh.colors)): mesh for mesh in meshes}.values():
            color = mesh.material.color.max() * (1.0 if mesh.colors is None else mesh.colors.max(initial=0.0))
            texel = 1.0 if mesh.material.texture is None else mesh.material.texture.extremes[1]
            brightest = max(brightest, float(color) * max(texel, 1.0))
        around = self.scene.environment if pbr else None
        radiance = 0.0 if around is None else float(around.image.max()) * around.intensity
        lit = self.materials.values(), intensities, self.scene.ambient, brightest
        return light_unit(*lit, pbr=pbr, radiance=radiance)

    def material_table(self, ambient_unit: float, at_corners: bool) -> Array:
        """Return the material table. at_corners: whether the texels are in the corners' colors and need no lookup at
        the pixels.

        If a lookup is forced, materials without a texture (or an alpha test) look up white (or its alpha).
        """
        materials, ambient = list(self.materials.values()), self.scene.ambient / ambient_unit
        table = material_table(materials, self.textures, ambient, self._structs)
        table["texture"][(table["texture"] < 0) | at_corners] = self._white if "TEXTURED" in self._forced else -1
        if "ALPHA_TEST" in self._forced:
            table["alpha_texture"][table["alpha_texture"] < 0] = self._white
            table["alpha_cutoff"][table["alpha_tested"] == 0] = -1.0  # rounding may give an alpha below 0
            table["alpha_tested"] = 1
        return table

    def face_textures(self) -> Array:
        numbers = {id(texture): i for i, texture in enumerate(self.textures)}
        return self.per_face(
            [numbers[id(m.material.texture)] if len(m.faces) and texture_applies(m) else -1 for m in self.scene.meshes]
        )
