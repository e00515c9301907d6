"""A scene's meshes as flat arrays of vertices and faces, by the names of the kernels' parameters: all copies of each mesh,
one after the other."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from itertools import chain, groupby
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats, Integers
from ..scene.geometry import row_blocks, vertex_normals
from ..scene.model import Mesh, Scalars, Scene, Settings, Texture
from ..scene.scalar_colors import ColorMap, at_corners, at_vertices, color_map_of, without_colors
from ..scene.tangents import mesh_tangents
from .features import material_key, materials_of, replaces_colors, texture_applies
from .light_points import typical_intensities
from .placements import about_one, mirroring, placed_normals, placed_points, placed_tangents
from .shading_tables import Real, joined, light_unit, map_of, material_table, split_uvs, textures_of, to_real
from .struct_layout import DOUBLE, MOST_POSITION, NAN_POSITION, SINGLE, WHITE_POSITION

WHITE = Texture(np.ones((1, 1, 3)))  # multiplying by its texel changes no bit of a color
MOST_BEND, THINNEST = 0.25, 2.0**-20
_MOST_BITS, _LEAST_BITS = math.frexp(MOST_POSITION)[1] - 1, 60  # of scalars that are as large, as small as they are
_LEAST_WIDTH = 2.0**-1000  # of a color map, relative to the numbers of a face
_BATCH = 1 << 12  # vertices of a mesh that is gathered together with others


def map_positions(values: Array, color_map: ColorMap) -> Floats:
    """Return positions (K, C) in a map of numbers (K, C): 0 at its low end, N at its high one, of any size; NaN stays.

    Where the map is so narrow, or a row so large, that the quotient could overflow, the row is a multiple of that.
    """
    ends = np.broadcast_to((color_map.low, color_map.high), (len(values), 2))
    every = np.concatenate([ends, np.nan_to_num(values.astype(np.float64))], axis=1)
    exponent = -np.frexp(np.abs(every).max(axis=1, keepdims=True))[1] - 1  # to at most 1/2: no difference overflows
    ends, scaled = np.ldexp(ends, exponent), np.ldexp(values.astype(np.float64), exponent)
    apart, width = scaled - ends[:, :1], ends[:, 1:] - ends[:, :1]
    largest = np.fmax.reduce(np.abs(apart), axis=1, keepdims=True, initial=0.0)
    narrow = width < _LEAST_WIDTH
    width = np.where(narrow, np.where(largest > 0.0, largest, 1.0), width)
    # The product first: where the quotient is a whole number, it is exact.
    return np.asarray(apart * np.where(narrow, 1.0 / _LEAST_WIDTH, color_map.count) / width)


class ScalarTables:
    """The scalars that a scene shows. at_corners: whether each corner of a face has a position in the color map, else each
    vertex: scalars per vertex, none of a face NaN, none too far beyond the map's ends."""

    def __init__(self, scene: Scene, scalars: Scalars) -> None:
        """Raises InputError if the scene has no such scalars."""
        self._name, self.color_map = scalars.name, color_map_of(scene, scalars)
        meshes = [mesh for mesh in scene.meshes if self._name in mesh.scalars]
        self.at_corners = not all(
            at_vertices(mesh, self._name) and (np.abs(self._of_vertices(mesh)[mesh.faces]) <= MOST_POSITION).all()
            for mesh in meshes
        )

    def _of_vertices(self, mesh: Mesh) -> Floats:
        return map_positions(mesh.scalars[self._name][:, None], self.color_map)[:, 0]

    def positions(self, mesh: Mesh) -> Floats:
        """Return the positions of a mesh's vertices, (V,), or of its faces' corners, (F, 3): of at most MOST_POSITION, in
        proportion; of faces with a NaN NAN_POSITION."""
        if self._name not in mesh.scalars:
            return np.full((len(mesh.faces), 3) if self.at_corners else len(mesh.verts), WHITE_POSITION)
        if not self.at_corners:
            return self._of_vertices(mesh)
        positions = map_positions(at_corners(mesh, self._name), self.color_map)
        missing = np.isnan(positions).any(axis=1, keepdims=True)
        largest = np.where(missing, 0.0, np.abs(positions)).max(axis=1, keepdims=True)
        too_large = np.maximum(np.frexp(largest)[1] - _MOST_BITS, 0)
        return np.asarray(np.where(missing, NAN_POSITION, np.ldexp(positions, -too_large)))

    def values(self, mesh: Mesh) -> Floats:
        """Return the scalars at the corners of a mesh's faces, (F, 3); NaN at all corners of faces that lack one."""
        if self._name not in mesh.scalars:
            return np.full((len(mesh.faces), 3), np.nan)
        values = at_corners(mesh, self._name)
        return np.where(np.isnan(values).any(axis=1, keepdims=True), np.nan, values)


def _bends(normals: Array, index: Array, verts: Array, faces: Array) -> Floats:
    """Return the sine of the largest angle between each unit normal (K, 3) and the faces that have it, at most MOST_BEND,
    (K,). index: (F, 3), the normals at the corners of faces. Faces that are too thin to have a normal do not count."""
    bends = np.zeros(len(normals))
    for block in row_blocks(len(faces)):
        a, b, c = np.moveaxis(np.asarray(verts[faces[block]], np.float64), 1, 0)
        across = np.cross(b - a, c - a)
        size, sides = np.linalg.norm(across, axis=1), np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
        counts = size > THINNEST * sides
        unit = across[counts] / size[counts, None]
        for k in range(3):
            rows = index[block][counts, k]
            sine = np.linalg.norm(np.cross(np.asarray(normals[rows], np.float64), unit), axis=1)
            np.maximum.at(bends, rows, np.minimum(sine, MOST_BEND))
    return bends


def _kind(mesh: Mesh, maps: bool) -> tuple[Any, ...] | None:
    """Return what consecutive meshes that are gathered together have in common; None for a mesh that is gathered alone."""
    if len(mesh.verts) > _BATCH or len(np.asarray(mesh.instances)) != 1 or mesh.scalars:
        return None
    if maps and map_of(mesh, "normal_texture") is not None:
        return None
    optional = (mesh.colors, mesh.normals, mesh.normal_faces, mesh.uvs, mesh.uv_faces, mesh.alphas)
    textured = mesh.uvs is not None and bool(textures_of(mesh, maps=maps))
    return mesh.verts.dtype, *(array is None for array in optional), len(mesh.more_uvs), textured, replaces_colors(mesh)


class Copies:
    """The K copies of a mesh that are gathered, or of K consecutive meshes one of each.

    numbers: of the meshes in their scene. mesh: the first, which has the fields that all have. count: copies of each mesh.
    matrices: (K, 4, 4) placements. mirrored: (K,) bool. verts: (V, 3) of all meshes, without those in no face, which are not
    uploaded. sizes: (2, M) vertices in use and faces of each mesh. faces: (F, 3).
    """

    def __init__(self, numbers: Sequence[int], meshes: Sequence[Mesh]) -> None:
        self.numbers, self._meshes, self.mesh = numbers, meshes, meshes[0]
        self.matrices: Floats = joined([np.asarray(mesh.instances) for mesh in meshes])
        self.mirrored, self.count = mirroring(self.matrices), len(self.matrices) // len(meshes)
        self.verts: Array = self._all("verts")
        self.faces: Array = self._all_indices("faces", "verts")
        self.sizes: Integers = np.array([(len(mesh.verts), len(mesh.faces)) for mesh in meshes]).T
        self._kept: Array | None = None  # vertices in use
        used = np.zeros(len(self.verts), bool)
        used[self.faces] = True
        if not used.all():
            self._kept = np.flatnonzero(used)
            self.verts, self.faces = self.verts[self._kept], (np.cumsum(used, dtype=np.int32) - np.int32(1))[self.faces]
            self.sizes[0] = np.diff(np.searchsorted(self._kept, np.cumsum(self.sizes[0])), prepend=0)

    def _all(self, name: str) -> Array:
        """Return the rows of all meshes."""
        return joined([getattr(mesh, name) for mesh in self._meshes])

    def _all_indices(self, name: str, rows: str) -> Array:
        """Return indices of all meshes into the rows of all."""
        index = self._all(name)
        if self._meshes[1:]:
            counts = [len(getattr(mesh, rows)) for mesh in self._meshes]
            starts = (np.cumsum(counts) - counts).astype(np.int32)
            index += np.repeat(starts, [len(mesh.faces) for mesh in self._meshes])[:, None]
        return index

    def one(self, mirrored: bool) -> Copies:
        """Return the mesh itself, or with the winding of one that a placement mirrors."""
        first = copy(self)
        first.matrices, first.mirrored, first.count = np.eye(4)[None], np.array([mirrored]), 1
        return first

    def points(self) -> Array:
        """Return the placed vertices, (K V, 3)."""
        return placed_points(self.verts, self.matrices, self.sizes[0] if self._meshes[1:] else None)

    def normals(self, *, computed: bool) -> tuple[Array, Array, Integers]:
        """Return normals in object space, (K, 3), their indices (F, 3), and how many each mesh has. computed: whether they
        are computed, and so unit vectors or 0."""
        if computed:
            return vertex_normals(self.verts, self.faces), self.faces, self.sizes[0]
        if self.mesh.normal_faces is None:
            return self.of_vertices("normals"), self.faces, self.sizes[0]
        counts = np.array([len(mesh.normals) for mesh in self._meshes])  # type: ignore[arg-type]
        return self._all("normals"), self._all_indices("normal_faces", "normals"), counts

    def repeated(self, rows: Array) -> Array:
        """Return rows once for each copy."""
        return rows if self.count == 1 else np.tile(rows, (self.count, *[1] * (rows.ndim - 1)))

    def turned(self, rows: Array) -> Array:
        """Return what belongs to the corners of faces, (F, 3, ...), once for each copy: (K, F, 3, ...), with two corners
        exchanged where a placement mirrors. The winding of its faces is then reversed, so that front stays front."""
        if not self.mirrored.any():
            return rows[None] if self.count == 1 else np.repeat(rows[None], self.count, axis=0)
        if self._meshes[1:]:
            mirrored = np.repeat(self.mirrored, self.sizes[1]).reshape(-1, *[1] * (rows.ndim - 1))
            return np.where(mirrored, rows[:, [0, 2, 1]], rows)[None]
        return np.stack([rows, rows[:, [0, 2, 1]]])[self.mirrored.astype(np.intp)]

    def indices(self, index: Array, rows: int, first: int = 0) -> Array:
        """Return indices (F, 3) of a table's rows for all copies, (K F, 3) int32, each with `rows` of its own, from `first`
        on."""
        if self.count == 1 and not first and not self.mirrored.any():
            return index
        starts = first + rows * np.arange(self.count, dtype=np.int64)
        return (self.turned(index) + starts[:, None, None]).astype(np.int32).reshape(-1, 3)

    def of_vertices(self, name: str) -> Array:
        """Return the rows of the vertices in use, of a field of all meshes that may have more rows, or is missing: 1."""
        if getattr(self.mesh, name) is None:
            return np.ones(len(self.verts))
        return self.own(joined([getattr(mesh, name)[: len(mesh.verts)] for mesh in self._meshes]))

    def uvs(self) -> tuple[list[Array], Array]:
        """Return the sets of texture coordinates, of the vertices in use, or all where faces have indices of their own; and
        their indices, (F, 3)."""
        every: list[tuple[Any, ...]] = [(mesh.uvs, *mesh.more_uvs) for mesh in self._meshes]
        if self.mesh.uv_faces is not None:
            return [joined(list(rows)) for rows in zip(*every, strict=True)], self._all_indices("uv_faces", "uvs")
        counts = [len(mesh.verts) for mesh in self._meshes]
        every = [tuple(rows[:count] for rows in rows_of_set) for count, rows_of_set in zip(counts, every, strict=True)]
        return [self.own(joined(list(rows))) for rows in zip(*every, strict=True)], self.faces

    def colors(self, real: Real) -> Array:
        """Return the colors of the vertices in use, (V, 4), but for the fourth component."""
        white = self.mesh.colors is None or replaces_colors(self.mesh)
        colors = np.broadcast_to(1.0, (len(self.verts), 3)) if white else self.of_vertices("colors")
        factors = np.array([mesh.material.color for mesh in self._meshes])
        factors = factors if len(factors) == 1 else np.repeat(factors, self.sizes[0], axis=0)
        rows = np.full((len(colors), 4), WHITE_POSITION, real)
        for block in row_blocks(len(colors)):
            rows[block, :3] = to_real(colors[block] * (factors if len(factors) == 1 else factors[block]), real)
        return rows

    def own(self, rows: Array) -> Array:
        """Return the rows of the vertices in use, of a table of all of the meshes'."""
        return rows if self._kept is None else rows[self._kept]


class Gatherer:
    """The arrays of the placed meshes, concatenated in order.

    scene: without the colors that scalars replace. placed: what is gathered together. copies: the same; with one_copy one of
    each mesh in object space, and another one with the winding reversed if some placement mirrors.
    """

    def __init__(self, scene: Scene, settings: Settings, forced: Collection[str], *, one_copy: bool) -> None:
        maps, self._prefix, self._forced = settings.shader == "pbr", "object_" if one_copy else "", forced
        self.structs, self._maps = DOUBLE if settings.precision == "float64" else SINGLE, maps
        self._real: Real = self.structs.real
        self.scalars = None if settings.scalars is None else ScalarTables(scene, settings.scalars)
        self.scene = scene = without_colors(scene, settings.scalars)
        self._materials = materials_of(scene)
        meshes = [(number, mesh) for number, mesh in enumerate(scene.meshes) if len(mesh.faces)]
        looked_up = chain.from_iterable(textures_of(mesh, maps=maps) for _, mesh in meshes)
        self.textures = list({id(texture): texture for texture in looked_up}.values())
        self._white = len(self.textures)
        if "TEXTURED" in forced or "ALPHA_TEST" in forced:
            self.textures.append(WHITE)
        self.placed: list[Copies] = []
        alone = one_copy or self.scalars is not None
        for kind, alike in groupby(meshes, key=lambda pair: None if alone else _kind(pair[1], maps)):
            for some in [list(alike)] if kind is not None else ([pair] for pair in alike):
                self.placed.append(Copies(*zip(*some, strict=True)))
        self.copies = self.placed
        if one_copy:
            self.copies = [copies.one(side) for copies in self.placed for side in np.unique(copies.mirrored)]

    def positions(self) -> tuple[Array, Array]:
        """Return the vertices, (V, 3), float32 if that holds them, and the faces."""
        if not self.copies:
            return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
        points = [one.points() for one in self.copies]
        with np.errstate(over="ignore"):
            fits = all(rows.dtype == np.float32 or (rows.astype(np.float32) == rows).all() for rows in points)
        faces = self._indices([(one.faces, len(one.verts)) for one in self.copies])
        return joined(points, np.float32 if fits else np.float64), faces

    def _indices(self, tables: Sequence[tuple[Array, int]]) -> Array:
        """Return indices, (F, 3) int32, into a table whose rows are gathered copies by copies. tables: the indices and
        the number of rows of each."""
        parts, first = [], 0
        for copies, (index, rows) in zip(self.copies, tables, strict=True):
            parts.append(copies.indices(index, rows, first))
            first += rows * copies.count
        return joined(parts, np.int32)

    def normals(self, indexed: bool, *, bends: bool = False) -> dict[str, Array]:
        """Return the normals, (K, 4), and their indices if they have their own. bends: the fourth component is as of
        `_bends`. Of one copy they are float64 in object space, of any length, and the fourth is 1 if they are units."""
        parts, index = [], list[tuple[Array, int]]()
        for copies in self.copies:
            is_unit = copies.mesh.normals is None or self.scene.preset == "course"
            normals, faces, counts = copies.normals(computed=is_unit)
            index.append((faces, len(normals)))
            if self._prefix:
                directions = normals if is_unit else about_one(normals)
            else:
                how = copies.matrices, copies.mirrored, np.float64 if bends else self._real
                directions = placed_normals(normals, *how, is_unit=is_unit, counts=counts if len(counts) > 1 else None)
            rows = np.zeros((len(directions), 4), np.float64 if self._prefix else self._real)
            rows[:, :3] = directions
            if self._prefix:
                rows[:, 3] = is_unit
            elif bends:
                corners = copies.indices(copies.faces, len(copies.verts))
                rows[:, 3] = _bends(directions, copies.indices(faces, len(normals)), copies.points(), corners)
            parts.append(rows)
        tables = {f"{self._prefix}normals": joined(parts)}
        return {**tables, "normal_faces": self._indices(index)} if indexed else tables

    def tangents(self) -> dict[str, Array]:
        """Return the tangents of meshes with a normal map, (K, 4), unit or 0, with the side of the bitangent, and their
        indices. Row 0 is that of all others. Of one copy they are float64 in object space, of any length."""
        real = np.float64 if self._prefix else self._real
        parts, index, count = [np.zeros((1, 4), real)], [], 1
        for copies in self.copies:
            texture = map_of(copies.mesh, "normal_texture")
            if texture is None:
                index.append(copies.repeated(np.zeros_like(copies.faces)))
                continue
            tangents, faces = mesh_tangents(copies.mesh, texture.coordinates)
            if self._prefix:
                parts.append(np.column_stack([about_one(tangents[:, :3]), tangents[:, 3]]))
            else:
                parts.append(placed_tangents(tangents, copies.matrices, copies.mirrored).astype(real))
            index.append(copies.indices(faces, len(tangents), count))
            count += len(tangents) * copies.count
        return {f"{self._prefix}tangents": joined(parts), "tangent_faces": joined(index, np.int32)}

    def colors(self, at_corners: bool) -> Array:
        """Return colors and positions in the color map of the vertices, (V, 4), or of the faces' corners, (3F, 4)."""
        parts = []
        for copies in self.copies:
            rows = copies.colors(self._real)
            positions = None if self.scalars is None else to_real(self.scalars.positions(copies.mesh), self._real)
            if positions is not None and positions.ndim == 1:
                rows[:, 3] = copies.own(positions)
            if not at_corners:
                parts.append(copies.repeated(rows))
                continue
            rows = rows[copies.faces]
            if positions is not None and positions.ndim == 2:
                rows[:, :, 3] = positions
            parts.append(copies.turned(rows).reshape(-1, 4))
        return joined(parts)

    def color_map(self) -> Array:
        """Return the rows that kernels look up, (N + 4, 4): those of the map, and white."""
        colors = np.ones((3, 3)) if self.scalars is None else self.scalars.color_map.table
        table = np.ones((len(colors) + 1, 4), np.float32)
        table[:-1, :3] = colors
        return table.astype(self._real)

    def alphas(self) -> Array:
        """Return the alphas of the vertices, (V,)."""
        return joined([copies.repeated(to_real(copies.of_vertices("alphas"), self._real)) for copies in self.copies])

    def corner_scalars(self) -> tuple[Array, int]:
        """Return the scalars at the corners of faces, (3F,), over a power of two, NAN_POSITION for none, and the power's
        exponent: 0 unless they are very large or very small."""

        def own(copies: Copies) -> Array:
            return np.full(copies.faces.shape, np.nan) if self.scalars is None else self.scalars.values(copies.mesh)

        values = np.concatenate([copies.turned(own(copies)).reshape(-1) for copies in self.copies])
        own_exponent = int(np.frexp(np.abs(values[np.isfinite(values)]).max(initial=0.0))[1])
        exponent_limit = np.finfo(self._real).maxexp - _MOST_BITS  # what is beyond a real's range saturates
        large = own_exponent > _MOST_BITS
        exponent = min(own_exponent - _MOST_BITS, exponent_limit) if large else min(own_exponent + _LEAST_BITS, 0)
        held = np.clip(np.ldexp(values, -exponent), -2.0 * MOST_POSITION, 2.0 * MOST_POSITION)
        return to_real(np.where(np.isnan(values), NAN_POSITION, held), self._real), exponent

    @property
    def uv_sets(self) -> int:
        """Number of sets of texture coordinates that textures look up."""
        return 1 + max((texture.coordinates for texture in self.textures), default=0)

    def uvs(self, indexed: bool, *, untextured: bool = False) -> dict[str, Array]:
        """Return texture coordinates, each set's after the other's, and their indices if they have their own. untextured:
        include those of meshes without a texture, which are 0 otherwise."""
        sets, index = self.uv_sets, list[tuple[Array, int]]()
        parts: list[list[Array]] = [[] for _ in range(sets)]
        for copies in self.copies:
            if copies.mesh.uvs is None or not (untextured or textures_of(copies.mesh, maps=self._maps)):
                coordinates, faces = [np.zeros((len(copies.verts), 2))] * sets, copies.faces
            else:
                coordinates, faces = copies.uvs()
                coordinates = [*coordinates, *[np.zeros_like(coordinates[0])] * sets][:sets]
            for part, rows in zip(parts, coordinates, strict=True):
                part.append(copies.repeated(split_uvs(rows, self._real)))
            index.append((faces, len(coordinates[0])))
        tables = {"uvs": joined([part for copies in parts for part in copies])}
        return {**tables, "uv_faces": self._indices(index)} if indexed else tables

    def mirrored(self) -> Array:
        """Return for each face whether its placement mirrors, (F,) int32."""
        return joined([np.repeat(copies.mirrored, copies.sizes[1]) for copies in self.copies], np.int32)

    def per_face(self, values: Sequence[int], kind: type[np.integer[Any]] = np.int32) -> Array:
        """Return for each face the value of its mesh, of `values` for all of the scene's: (F,)."""
        table = np.array(values, kind)
        parts = (np.repeat(table[list(one.numbers)], one.sizes[1] * one.count) for one in self.copies)
        return joined(list(parts), kind)

    def per_copy(self, first: Sequence[int]) -> Array:
        """Return for each face the number of its copy, counted from that of its mesh's first one: (F,) uint32."""
        numbers = [np.repeat(np.arange(copies.count, dtype=np.uint32), len(copies.faces)) for copies in self.copies]
        return self.per_face(first, np.uint32) + joined(numbers, np.uint32)

    def face_materials(self) -> Array:
        """Return each face's row of the material table, (F,) int32."""
        numbers = {key: i for i, key in enumerate(self._materials)}
        return self.per_face([numbers.get(material_key(mesh), 0) for mesh in self.scene.meshes])

    def face_textures(self) -> Array:
        """Return each face's row of the texture table, -1 for none, (F,) int32."""
        numbers = {id(texture): i for i, texture in enumerate(self.textures)}
        meshes = self.scene.meshes
        return self.per_face(
            [numbers[id(m.material.texture)] if len(m.faces) and texture_applies(m) else -1 for m in meshes]
        )

    def light_unit(self, radius: float) -> float:
        """Return `shading_tables.light_unit`. radius: of the scene."""
        brightest = 0.0
        meshes = (mesh for mesh in self.scene.meshes if len(mesh.faces))
        for mesh in {(id(mesh.material), id(mesh.colors)): mesh for mesh in meshes}.values():
            color = mesh.material.color.max() * (1.0 if mesh.colors is None else mesh.colors.max(initial=0.0))
            texel = 1.0 if mesh.material.texture is None else mesh.material.texture.extremes[1]
            brightest = max(brightest, float(color) * max(texel, 1.0))
        around = self.scene.environment if self._maps else None
        radiance = 0.0 if around is None else float(around.image.max()) * around.intensity
        lit = self._materials.values(), typical_intensities(self.scene.lights, radius), self.scene.ambient, brightest
        return light_unit(*lit, pbr=self._maps, radiance=radiance)

    def material_table(self, ambient_unit: float, at_corners: bool) -> Array:
        """Return the material table. at_corners: whether the texels are in the corners' colors and need no lookup at
        the pixels.

        If a lookup is forced, materials without a texture (or an alpha test) look up white (or its alpha).
        """
        ambient = self.scene.ambient / ambient_unit
        table = material_table(list(self._materials.values()), self.textures, ambient, self.structs)
        table["texture"][(table["texture"] < 0) | at_corners] = self._white if "TEXTURED" in self._forced else -1
        if "ALPHA_TEST" in self._forced:
            table["alpha_texture"][table["alpha_texture"] < 0] = self._white
            table["alpha_cutoff"][table["alpha_tested"] == 0] = -1.0  # rounding may give an alpha below 0
            table["alpha_tested"] = 1
        return table
