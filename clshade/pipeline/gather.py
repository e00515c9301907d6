"""A scene's meshes as flat arrays of vertices and faces: world positions, indices, normals, colors, texture
coordinates."""

from __future__ import annotations

import math
from collections.abc import Collection
from fractions import Fraction
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats, Reals
from ..scene.geometry import vertex_normals
from ..scene.model import Mesh, Scene, Texture
from ..scene.tangents import mesh_tangents
from .features import material_key, materials_of, replaces_colors, texture_applies
from .light_table import typical_intensities
from .maps import map_of, textures_of
from .scalar_tables import ScalarTables
from .shading_tables import Real, joined, light_unit, material_table, split, to_real
from .struct_layout import MOST_POSITION, NAN_POSITION, WHITE_POSITION, Structs

WHITE = Texture(np.ones((1, 1, 3)))  # multiplying by its texel changes no bit of a color
MOST_BEND, THINNEST = 0.25, 2.0**-20
_MOST_BITS, _LEAST_BITS = math.frexp(MOST_POSITION)[1] - 1, 60  # of scalars that are as large, as small as they are


def _fits_float32(values: Array) -> bool:
    if values.dtype == np.float32:
        return True
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def _placements(mesh: Mesh) -> list[Array | None]:
    """Return one matrix per instance; None for an identity, whose vertices are used as they are."""
    return [None if (matrix == np.eye(4)).all() else matrix for matrix in np.asarray(mesh.instances)]


def _placed(points: Array, matrix: Array | None) -> Floats:
    if matrix is None:
        return points
    placed: Floats = points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return placed


def _unit(vectors: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
        unit = scaled / np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    return np.where(np.isfinite(unit), unit, 0.0)


def _own_normals(mesh: Mesh, matrix: Array | None) -> Array:
    normals = np.asarray(mesh.normals, np.float64)
    if matrix is not None:
        # Scale by powers of two to about 1: products neither overflow nor underflow.
        m = np.ldexp(matrix[:3, :3], -np.frexp(np.abs(matrix[:3, :3]).max())[1])
        normals = np.ldexp(normals, -np.frexp(np.abs(normals).max(axis=1, keepdims=True, initial=0.0))[1])
        # The cofactor matrix transforms normals, even for a singular matrix.
        cofactor = np.array([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
        normals = (normals @ cofactor.T) * (-1.0 if mirrors(matrix) else 1.0)
    return _unit(normals)


def _bends(normals: Array, index: Array, corners: Array) -> Floats:
    """Return the sine of the largest angle between each unit normal (K, 3) and the faces that have it, at most MOST_BEND,
    (K,). index: (F, 3), the normals at corners (F, 3, 3). Faces that are too thin to have a normal do not count."""
    a, b, c = np.moveaxis(np.asarray(corners, np.float64), 1, 0)
    across = np.cross(b - a, c - a)
    size, sides = (np.linalg.norm(across, axis=1), np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1))
    counts = size > THINNEST * sides
    found = np.zeros(len(normals))
    unit = across[counts] / size[counts, None]
    for k in range(3):
        rows = index[counts, k]
        sine = np.linalg.norm(np.cross(np.asarray(normals, np.float64)[rows], unit), axis=1)
        np.maximum.at(found, rows, np.minimum(sine, MOST_BEND))
    return found


def _placed_tangents(tangents: Array, matrix: Array | None) -> Array:
    """Place tangents (K, 4). A placement that mirrors turns the bitangent round: it goes with the surface, as the tangent
    does, but the product of normal and tangent does not."""
    directions, side = np.asarray(tangents[:, :3], np.float64), np.where(tangents[:, 3] < 0.0, -1.0, 1.0)
    if matrix is not None:
        m = np.ldexp(matrix[:3, :3], -np.frexp(np.abs(matrix[:3, :3]).max())[1])
        directions = np.ldexp(directions, -np.frexp(np.abs(directions).max(axis=1, keepdims=True, initial=0.0))[1])
        directions, side = directions @ m.T, -side if mirrors(matrix) else side
    unit = _unit(directions)
    return np.column_stack([unit, np.where(unit.any(axis=1), side, 0.0)])


def mirrors(matrix: Array | None) -> bool:
    """Return whether a placement mirrors. The winding of its faces is then reversed, so that front stays front.

    Decided by the exact sign of its determinant: rounded to float64, the determinant of a placement that flattens may have
    either sign.
    """
    if matrix is None:
        return False
    (a, b, c), (d, e, f), (g, h, i) = np.ldexp(
        matrix[:3, :3], -np.frexp(np.abs(matrix[:3, :3]).max(axis=1, keepdims=True))[1]
    ).tolist()
    products = a * e * i, b * f * g, c * d * h, -c * e * g, -b * d * i, -a * f * h
    determinant = math.fsum(products)
    # Each product has a relative error of at most 2^-52, unless it underflows.
    if abs(determinant) > 2.0**-50 * math.fsum(map(abs, products)) + 1e-300:
        return determinant < 0.0
    a, b, c, d, e, f, g, h, i = map(Fraction, matrix[:3, :3].ravel().tolist())
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) < 0


def _turned(index: Array, matrix: Array | None) -> Array:
    return np.ascontiguousarray(index[:, [0, 2, 1]]) if mirrors(matrix) else index


def _four(vectors: Array, real: Real) -> Array:
    wide = np.zeros((len(vectors), 4), real)
    wide[:, : vectors.shape[1]] = vectors
    return wide


def _shifted(parts: list[tuple[Array, int]]) -> Array:
    """Concatenate index arrays, each offset by the number of rows before it."""
    moved, offset = [], 0
    for index, count in parts:
        moved.append(index + np.int32(offset) if offset else index)
        offset += count
    return joined(moved, np.int32)


def _without_unused(mesh: Mesh) -> tuple[Array, Array, Array | None]:
    """Return vertices, faces and the vertices kept, or None if all are: unreferenced vertices are not uploaded."""
    used = np.zeros(len(mesh.verts), bool)
    used[mesh.faces] = True
    if used.all():
        return mesh.verts, mesh.faces, None
    kept = np.flatnonzero(used)
    renumbered = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return mesh.verts[kept], renumbered[mesh.faces], kept


def _kept(rows: Array, kept: Array | None) -> Array:
    return rows if kept is None else rows[kept]


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
    ) -> None:
        """maps: whether the shader uses the maps of shader pbr."""
        self.maps = maps
        self.scene, self._structs, self._forced, self.scalars = scene, structs, forced, scalars
        self.parts: dict[str, list[Any]] = {}
        self.materials = materials_of(scene)
        meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
        table = {id(texture): texture for mesh in meshes for texture in textures_of(mesh, maps=maps)}
        self.textures: list[Texture] = list(table.values())
        self._white = len(self.textures)
        if "TEXTURED" in forced or "ALPHA_TEST" in forced:
            self.textures.append(WHITE)
        self.placed = []
        for mesh in meshes:
            verts, faces, kept = _without_unused(mesh)
            self.placed += [(mesh, matrix, verts, _turned(faces, matrix), kept) for matrix in _placements(mesh)]

    def positions(self) -> tuple[Array, Array]:
        if not self.placed:
            return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
        points = [_placed(verts, matrix) for _, matrix, verts, _, _ in self.placed]
        faces = [(faces, len(verts)) for _, _, verts, faces, _ in self.placed]
        if all(map(_fits_float32, points)):
            return joined(points, np.float32), _shifted(faces)
        return joined(points, np.float64), _shifted(faces)

    def normals(self, indexed: bool, *, bends: bool = False) -> tuple[Array, Array | None]:
        """Return the normals, (K, 4), and their indices, (F, 3), if they have their own. bends: the fourth component is as
        of `_bends`."""
        parts, index = [], []
        for mesh, matrix, verts, faces, kept in self.placed:
            if mesh.normals is None or self.scene.preset == "course":
                own, own_faces = vertex_normals(_placed(verts, matrix), faces), faces
            elif mesh.normal_faces is not None:
                own, own_faces = _own_normals(mesh, matrix), _turned(mesh.normal_faces, matrix)
            else:
                own, own_faces = _kept(_own_normals(mesh, matrix)[: len(mesh.verts)], kept), faces
            rows = _four(own, self._structs.real)
            if bends:
                rows[:, 3] = _bends(own, own_faces, _placed(verts, matrix)[faces])
            parts.append(rows)
            index.append((own_faces, len(own)))
        return joined(parts), _shifted(index) if indexed else None

    def tangents(self) -> tuple[Array, Array]:
        """Return the tangents of meshes with a normal map, (K, 4), unit or 0, with the side of the bitangent, and their
        indices (F, 3). Row 0 is that of all others."""
        parts, index = [np.zeros((1, 4), self._structs.real)], []
        count = 1
        for mesh, matrix, _, faces, _ in self.placed:
            texture = map_of(mesh, "normal_texture")
            if texture is None:
                index.append(np.zeros_like(faces))
                continue
            own, own_faces = mesh_tangents(mesh, texture.coordinates)
            parts.append(_placed_tangents(own, matrix).astype(self._structs.real))
            index.append(_turned(own_faces, matrix) + np.int32(count))
            count += len(own)
        return joined(parts), joined(index, np.int32)

    def colors(self, at_corners: bool) -> Array:
        """Return colors and positions in the color map of the vertices, (V, 4), or of the faces' corners, (3F, 4)."""
        parts = []
        for mesh, matrix, verts, faces, kept in self.placed:
            white = mesh.colors is None or replaces_colors(mesh)
            own = np.ones((len(verts), 3)) if white else _kept(np.asarray(mesh.colors), kept)
            rows = _four(to_real(own * mesh.material.color, self._structs.real), self._structs.real)
            rows[:, 3] = WHITE_POSITION
            positions = None if self.scalars is None else to_real(self.scalars.positions(mesh), self._structs.real)
            if positions is not None and positions.ndim == 1:
                rows[:, 3] = _kept(positions, kept)
            rows = rows[faces.reshape(-1)] if at_corners else rows
            if positions is not None and positions.ndim == 2:
                rows[:, 3] = _turned(positions, matrix).reshape(-1)
            parts.append(rows)
        return joined(parts)

    def alphas(self) -> Array:
        """Return the alphas of the vertices, (V,)."""
        parts = []
        for mesh, _, verts, _, kept in self.placed:
            own = np.ones(len(verts)) if mesh.alphas is None else _kept(mesh.alphas, kept)
            parts.append(to_real(own, self._structs.real))
        return joined(parts)

    def corner_scalars(self) -> tuple[Array, int]:
        """Return the scalars at the corners of faces, (3F,), over a power of two, NAN_POSITION for none, and the power's
        exponent: 0 unless they are very large or very small."""
        parts = [np.full((len(faces), 3), np.nan) for *_, faces, _ in self.placed]
        if self.scalars is not None:
            parts = [_turned(self.scalars.values(mesh), matrix) for mesh, matrix, *_ in self.placed]
        values = np.concatenate([part.reshape(-1) for part in parts])
        own = int(np.frexp(np.abs(values[np.isfinite(values)]).max(initial=0.0))[1])
        most = np.finfo(self._structs.real).maxexp - _MOST_BITS  # what is beyond a real's range saturates
        exponent = min(own - _MOST_BITS, most) if own > _MOST_BITS else min(own + _LEAST_BITS, 0)
        held = np.clip(np.ldexp(values, -exponent), -2.0 * MOST_POSITION, 2.0 * MOST_POSITION)
        return to_real(np.where(np.isnan(values), NAN_POSITION, held), self._structs.real), exponent

    def uvs(self, indexed: bool, *, untextured: bool = False) -> tuple[Array, Array | None]:
        """Return texture coordinates and their indices, each set's after the other's. untextured: include those of meshes
        without a texture, which are 0 otherwise."""
        sets = 1 + max((texture.coordinates for texture in self.textures), default=0)
        parts: list[list[Array]] = [[] for _ in range(sets)]
        index = []
        for mesh, matrix, verts, faces, kept in self.placed:
            if mesh.uvs is None or not (untextured or textures_of(mesh, maps=self.maps)):
                count, own_faces = len(verts), faces
                own: list[Reals] = [np.zeros((count, 2))] * sets
            else:
                own = [*(mesh.uvs, *mesh.more_uvs)[:sets]]
                own += [np.zeros_like(mesh.uvs)] * (sets - len(own))
                if mesh.uv_faces is not None:
                    own_faces = _turned(mesh.uv_faces, matrix)
                else:
                    own, own_faces = [_kept(each[: len(mesh.verts)], kept) for each in own], faces
            for part, each in zip(parts, own, strict=True):
                part.append(split(each, self._structs.real))
            index.append((own_faces, len(own[0])))
        return joined([part for each in parts for part in each]), _shifted(index) if indexed else None

    def mirrored(self) -> list[int]:
        """Return for each placed mesh whether its placement mirrors."""
        return [int(mirrors(matrix)) for _, matrix, *_ in self.placed]

    def per_face(self, value: list[int], kind: type[np.integer[Any]] = np.int32) -> Array:
        """Repeat one value per placed mesh for each of its faces."""
        repeats = [len(faces) for _, _, _, faces, _ in self.placed]
        return np.repeat(np.array(value, kind), repeats)

    def face_materials(self) -> Array:
        numbers = {key: i for i, key in enumerate(self.materials)}
        return self.per_face([numbers[material_key(mesh)] for mesh, *_ in self.placed])

    def light_unit(self, radius: float, *, pbr: bool = False) -> float:
        """Return `shading_tables.light_unit`. radius: of the scene."""
        intensities = typical_intensities(self.scene.lights, radius)
        brightest = 0.0
        for mesh, *_ in self.placed:
            color = mesh.material.color.max() * (1.0 if mesh.colors is None else mesh.colors.max(initial=0.0))
            texel = 1.0 if mesh.material.texture is None else mesh.material.texture.image.max()
            brightest = max(brightest, float(color) * max(float(texel), 1.0))
        around = self.scene.environment if pbr else None
        radiance = 0.0 if around is None else float(around.image.max()) * around.intensity
        return light_unit(
            self.materials.values(), intensities, self.scene.ambient, brightest, pbr=pbr, radiance=radiance
        )

    def material_table(self, ambient_unit: float, at_corners: bool) -> Array:
        """Return the material table. at_corners: whether the texels are in the corners' colors and need no lookup at
        the pixels.

        If a lookup is forced, materials without a texture (or an alpha test) look up white (or its alpha).
        """
        table = material_table(
            list(self.materials.values()), self.textures, self.scene.ambient / ambient_unit, self._structs
        )
        table["texture"][(table["texture"] < 0) | at_corners] = self._white if "TEXTURED" in self._forced else -1
        if "ALPHA_TEST" in self._forced:
            table["alpha_texture"][table["alpha_texture"] < 0] = self._white
            table["alpha_tested"] = 1
        return table

    def face_textures(self) -> Array:
        numbers = {id(texture): i for i, texture in enumerate(self.textures)}
        return self.per_face([numbers[id(m.material.texture)] if texture_applies(m) else -1 for m, *_ in self.placed])
