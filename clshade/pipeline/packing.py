"""A scene's meshes as the flat arrays that the kernels read: world positions, indices, normals, colors, texels."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..base.validation import Array
from ..scene.geometry import vertex_normals
from ..scene.model import Material, Mesh, Scene, Settings, Texture
from . import struct_layout
from .features import Features, derive, material_key, materials_of, replaces_colors, tests_alpha, texture_applies
from .layer_buffers import LayerTables, layer_tables
from .mipmaps import levels_below
from .struct_layout import Structs

Real = type[np.floating]

_WRAPS = {
    "repeat": struct_layout.CONSTANTS["WRAP_REPEAT"],
    "clamp": struct_layout.CONSTANTS["WRAP_CLAMP"],
    "mirror": struct_layout.CONSTANTS["WRAP_MIRROR"],
}
WHITE = Texture(np.ones((1, 1, 3)))  # a color times its texel is the color, bit for bit
_LOOKUPS = {"standard": struct_layout.CONSTANTS["LOOKUP_STANDARD"], "course": struct_layout.CONSTANTS["LOOKUP_COURSE"]}


@dataclass(frozen=True)
class Packed:
    """What stays on the device between frames. Arrays that the features leave out are None.

    A real is float32, or float64 with precision float64. positions: (V, 3) world space, float32 or float64. faces: (F, 3)
    int32. normals: (K, 4) reals, unit or 0. normal_faces, uv_faces: (F, 3) int32. colors: (V, 4) reals. uvs: (T, 4)
    reals, u and v and what rounding leaves of them. face_materials: (F,) int32. materials, textures: tables of layout's
    structs. texels: (X, 4) float32.
    corner_uvs, corner_textures: (3F, 4) and (3F,), the lookups of texture_at vertex.
    low, high: (3,) float64, bounding box of the vertices in use. light_unit: see `light_unit`; tinted ambient light is
    in it too. layers: what layers read besides.
    """

    features: Features
    positions: Array
    faces: Array
    low: Array
    high: Array
    normals: Array | None
    normal_faces: Array | None
    colors: Array | None
    uvs: Array | None
    uv_faces: Array | None
    face_materials: Array | None
    materials: Array
    textures: Array | None
    texels: Array | None
    corner_uvs: Array | None
    corner_textures: Array | None
    light_unit: float
    layers: LayerTables


def _fits_float32(values: Array) -> bool:
    if values.dtype == np.float32:
        return True
    with np.errstate(over="ignore"):
        return bool((values.astype(np.float32) == values).all())


def _placements(mesh: Mesh) -> list[Array | None]:
    """One matrix per instance; None for an identity, whose vertices are used as they are."""
    return [None if (matrix == np.eye(4)).all() else matrix for matrix in np.asarray(mesh.instances)]


def _placed(points: Array, matrix: Array | None) -> Array:
    if matrix is None:
        return points
    return points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _unit(vectors: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)
        unit = scaled / np.sqrt((scaled * scaled).sum(axis=1, keepdims=True))
    return np.where(np.isfinite(unit), unit, 0.0)


def _own_normals(mesh: Mesh, matrix: Array | None) -> Array:
    normals = np.asarray(mesh.normals, np.float64)
    if matrix is not None:
        # By powers of two to about 1: products neither overflow nor vanish.
        m = np.ldexp(matrix[:3, :3], -np.frexp(np.abs(matrix[:3, :3]).max())[1])
        normals = np.ldexp(normals, -np.frexp(np.abs(normals).max(axis=1, keepdims=True, initial=0.0))[1])
        # The cofactor matrix turns normals as the matrix turns planes, also where it has no inverse.
        cofactor = np.array([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
        normals = (normals @ cofactor.T) * (-1.0 if mirrors(matrix) else 1.0)
    return _unit(normals)


def mirrors(matrix: Array | None) -> bool:
    """Whether a placement turns left into right. Its faces then run the other way, so that front stays front.

    That is the exact sign of its determinant: of a placement that flattens float64 gives a determinant of either sign."""
    if matrix is None:
        return False
    (a, b, c), (d, e, f), (g, h, i) = np.ldexp(
        matrix[:3, :3], -np.frexp(np.abs(matrix[:3, :3]).max(axis=1, keepdims=True))[1]
    ).tolist()
    products = a * e * i, b * f * g, c * d * h, -c * e * g, -b * d * i, -a * f * h
    determinant = math.fsum(products)
    # Each product is right to 2^-52 of itself, unless it underflows.
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


def split(values: Array, real: Real = np.float32) -> Array:
    """(K, 2) float64 -> (K, 4) reals: rounded, and what that leaves. Values that are not finite become 0."""
    values = np.where(np.isfinite(values), values, 0.0).astype(np.float64)
    # Whole numbers beyond 2^24 have no texel of their own left; keep the arithmetic finite.
    values = np.clip(values, -(2.0**40), 2.0**40)
    rounded = values.astype(real)
    return np.concatenate([rounded, (values - rounded).astype(real)], axis=1)


def _join(parts: list[Array], dtype: type | None = None) -> Array:
    joined = parts[0] if len(parts) == 1 else np.concatenate(parts)
    return np.ascontiguousarray(joined, dtype=dtype or joined.dtype)


def _shifted(parts: list[tuple[Array, int]]) -> Array:
    """Index arrays of the parts, each moved by the number of rows before it."""
    moved, offset = [], 0
    for index, count in parts:
        moved.append(index + np.int32(offset) if offset else index)
        offset += count
    return _join(moved, np.int32)


def material_table(
    materials: list[Material], textures: list[Texture], ambient: Array, structs: Structs = struct_layout.SINGLE
) -> Array:
    """Rows of structs.Material. Coefficients beyond a real saturate."""
    table = np.zeros(len(materials), structs.Material)
    for row, material in zip(table, materials, strict=True):
        for name, value in (("ambient", material.ka * ambient), ("kd", material.kd), ("ks", material.ks)):
            row[name] = to_real(value, structs.real)
        row["n"] = material.n
        row["two_sided"], row["front_only"] = material.two_sided, material.sides == "front"
        row["texture"] = next((i for i, t in enumerate(textures) if t is material.texture), -1)
        row["alpha_texture"] = row["texture"] if tests_alpha(material) else -1
        row["alpha_cutoff"] = material.alpha_cutoff if tests_alpha(material) else 0.0
    return table


def light_unit(materials: Iterable[Material], intensities: Array, ambient: Array, brightest: float) -> float:
    """The power of two that light is counted in so that no sum of it overflows float32: 1 for all but extreme scenes.

    intensities: (L, 3). ambient: (3,). brightest: the largest component of a surface's color.
    """
    reflected = max((float((np.abs(m.kd) + np.abs(m.ks)).max()) for m in materials), default=0.0)
    scattered = max((float(np.abs(m.ka * ambient).max()) for m in materials), default=0.0)
    with np.errstate(over="ignore"):
        most = (float(np.abs(intensities).sum(axis=0).max(initial=0.0)) * reflected + scattered) * max(brightest, 1.0)
    return 2.0 ** max(min(math.frexp(most)[1] if math.isfinite(most) else 1000, 220) - 96, 0)


def to_real(values: Array, real: Real = np.float32) -> Array:
    """Rounded to a real; beyond its range the largest finite value, below its normal range 0."""
    info = np.finfo(real)
    values = np.clip(np.asarray(values, np.float64), float(info.min), float(info.max))
    return np.where(np.abs(values) < float(info.tiny), 0.0, values).astype(real)


def scale_for(extent: float) -> float:
    """The power of two that brings lengths of up to `extent` to about 1: it changes no bit of a direction, and keeps
    squares within float32."""
    return 2.0 ** -min(max(math.frexp(extent or 1.0)[1], -1000), 1000)


def relative_lights(positions: Array, eye: Array, scale: float) -> Array:
    """Light positions (L, 3) relative to the eye, times `scale`, a power of two. Of a light beyond 2^60 (2^59 along an
    axis) only the direction is kept."""
    half = positions * 0.5 - eye * 0.5  # halves cannot overflow
    exponent = np.frexp(np.abs(half).max(axis=1, initial=0.0))[1]
    return np.ldexp(half, np.minimum(math.frexp(scale)[1], 60 - exponent)[:, None])


def texture_tables(textures: list[Texture], *, mipmaps: bool = False) -> tuple[Array, Array]:
    """layout.SINGLE.Texture rows and the texels of all textures behind each other, (X, 4) float32; with `mipmaps` the
    smaller levels of each follow it, opaque ones."""
    table = np.zeros(len(textures), struct_layout.SINGLE.Texture)
    offset, parts = 0, []
    for row, texture in zip(table, textures, strict=True):
        height, width, _ = texture.image.shape
        row["width"], row["height"] = width, height
        row["wrap"], row["lookup"] = [_WRAPS[wrap] for wrap in texture.wrap], _LOOKUPS[texture.lookup]
        levels = [texture.image]
        if mipmaps and texture.lookup == "standard":
            levels += levels_below(texture)
        row["levels"] = len(levels)
        for number, level in enumerate(levels):
            row["offset"][number] = offset
            texels = np.ones((level.shape[0] * level.shape[1], 4), np.float32)
            texels[:, : level.shape[2]] = level.reshape(len(texels), -1)
            parts.append(texels)
            offset += len(texels)
    return table, _join(parts)


def _without_unused(mesh: Mesh) -> tuple[Array, Array, Array | None]:
    """Vertices, faces and the vertices kept, or None when all are: vertices of no face are not uploaded."""
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
    """Collects the arrays of the placed meshes, one after the other."""

    def __init__(self, scene: Scene, structs: Structs, forced: Collection[str]) -> None:
        self.scene, self._structs, self._forced = scene, structs, forced
        self.parts: dict[str, list] = {}
        self.materials = materials_of(scene)
        meshes = [mesh for mesh in scene.meshes if len(mesh.faces)]
        table = {id(m.material.texture): m.material.texture for m in meshes if texture_applies(m)}
        self.textures: list[Texture] = [texture for texture in table.values() if texture is not None]
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
            return _join(points, np.float32), _shifted(faces)
        return _join(points, np.float64), _shifted(faces)

    def normals(self, indexed: bool) -> tuple[Array, Array | None]:
        parts, index = [], []
        for mesh, matrix, verts, faces, kept in self.placed:
            if mesh.normals is None or self.scene.preset == "course":
                own, own_faces = vertex_normals(_placed(verts, matrix), faces), faces
            elif mesh.normal_faces is not None:
                own, own_faces = _own_normals(mesh, matrix), _turned(mesh.normal_faces, matrix)
            else:
                own, own_faces = _kept(_own_normals(mesh, matrix)[: len(mesh.verts)], kept), faces
            parts.append(_four(own, self._structs.real))
            index.append((own_faces, len(own)))
        return _join(parts), _shifted(index) if indexed else None

    def colors(self) -> Array:
        parts = []
        for mesh, _, verts, _, kept in self.placed:
            white = mesh.colors is None or replaces_colors(mesh)
            own = np.ones((len(verts), 3)) if white else _kept(np.asarray(mesh.colors), kept)
            parts.append(_four(to_real(own * mesh.material.color, self._structs.real), self._structs.real))
        return _join(parts)

    def uvs(self, indexed: bool, *, untextured: bool = False) -> tuple[Array, Array | None]:
        """untextured: those of meshes without a texture too; the others' are 0."""
        parts, index = [], []
        for mesh, matrix, verts, faces, kept in self.placed:
            if mesh.uvs is None or not (untextured or texture_applies(mesh)):
                own, own_faces = np.zeros((len(verts), 2)), faces
            elif mesh.uv_faces is not None:
                own, own_faces = mesh.uvs, _turned(mesh.uv_faces, matrix)
            else:
                own, own_faces = _kept(mesh.uvs[: len(mesh.verts)], kept), faces
            parts.append(split(own, self._structs.real))
            index.append((own_faces, len(own)))
        return _join(parts), _shifted(index) if indexed else None

    def mirrored(self) -> list[int]:
        """Of each placed mesh, whether its placement mirrors."""
        return [int(mirrors(matrix)) for _, matrix, *_ in self.placed]

    def per_face(self, value: list[int]) -> Array:
        """One value per placed mesh, repeated for each of its faces."""
        repeats = [len(faces) for _, _, _, faces, _ in self.placed]
        return np.repeat(np.array(value, np.int32), repeats)

    def face_materials(self) -> Array:
        numbers = {key: i for i, key in enumerate(self.materials)}
        return self.per_face([numbers[material_key(mesh)] for mesh, *_ in self.placed])

    def light_unit(self) -> float:
        intensities = np.array([light.intensity for light in self.scene.lights]).reshape(-1, 3)
        brightest = 0.0
        for mesh, *_ in self.placed:
            color = mesh.material.color.max() * (1.0 if mesh.colors is None else mesh.colors.max(initial=0.0))
            texel = 1.0 if mesh.material.texture is None else mesh.material.texture.image.max()
            brightest = max(brightest, float(color) * max(float(texel), 1.0))
        return light_unit(self.materials.values(), intensities, self.scene.ambient, brightest)

    def material_table(self, ambient_unit: float, at_corners: bool) -> Array:
        """at_corners: whether the texels are in the corners' colors, so that the pixels look none up.

        Where a lookup is forced, materials without a texture (or an alpha test) look white (or its alpha) up.
        """
        table = material_table(
            list(self.materials.values()), self.textures, self.scene.ambient / ambient_unit, self._structs
        )
        table["texture"][(table["texture"] < 0) | at_corners] = self._white if "TEXTURED" in self._forced else -1
        table["alpha_texture"][table["alpha_texture"] < 0] = self._white if "ALPHA_TEST" in self._forced else -1
        return table

    def face_textures(self) -> Array:
        numbers = {id(texture): i for i, texture in enumerate(self.textures)}
        return self.per_face([numbers[id(m.material.texture)] if texture_applies(m) else -1 for m, *_ in self.placed])


def pack(scene: Scene, settings: Settings, *, forced: Collection[str] = frozenset()) -> Packed:
    """The arrays a render of `scene` under `settings` needs, and the features they imply; forced: see features.derive."""
    structs = struct_layout.DOUBLE if settings.precision == "float64" else struct_layout.SINGLE
    gatherer = Gatherer(scene, structs, forced)
    positions, faces = gatherer.positions()
    features = derive(scene, settings, double_positions=positions.dtype == np.float64, forced=forced)
    positions = positions.astype(np.float64 if features["DOUBLE_POSITIONS"] else np.float32, copy=False)
    low, high = (positions.min(axis=0), positions.max(axis=0)) if len(positions) else (np.zeros(3), np.zeros(3))
    found: dict[str, Any] = dict.fromkeys(Packed.__dataclass_fields__)
    if len(faces):
        if features["DIFFUSE"] or features["SPECULAR"]:
            found["normals"], found["normal_faces"] = gatherer.normals(bool(features["NORMAL_INDICES"]))
        if features["VERTEX_COLORS"] or features["CORNER_COLORS"]:
            found["colors"] = gatherer.colors()
        if features["TEXTURED"] or features["CORNER_COLORS"] or features["ALPHA_TEST"]:
            found["uvs"], found["uv_faces"] = gatherer.uvs(bool(features["UV_INDICES"]))
            if gatherer.textures:
                found["textures"], found["texels"] = texture_tables(
                    gatherer.textures, mipmaps=settings.texture_filter == "trilinear"
                )
        if features["CORNER_COLORS"]:
            index = found["uv_faces"] if found["uv_faces"] is not None else faces
            found["corner_uvs"] = np.ascontiguousarray(found["uvs"][index.reshape(-1)])
            found["corner_textures"] = np.repeat(gatherer.face_textures(), 3)
        if features["MATERIALS"] or features["SIDES"]:
            found["face_materials"] = gatherer.face_materials()
    unit = gatherer.light_unit()
    materials = gatherer.material_table(unit if features["TINTED"] else 1.0, bool(features["CORNER_COLORS"]))
    found.update(positions=positions, faces=faces, materials=materials, light_unit=unit)
    found.update(layers=layer_tables(gatherer, settings, features))
    found.update(features=features, low=low.astype(np.float64), high=high.astype(np.float64))
    return Packed(**found)
