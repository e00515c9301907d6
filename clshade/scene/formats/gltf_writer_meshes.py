"""Meshes of a glTF file that is written: float32 attributes with one row per vertex."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from ...base.arrays import Array, Faces, Floats, Floats32
from ...images.decode import srgb_to_linear
from ..geometry import vertex_normals
from ..model import Mesh
from ..scalar_colors import at_vertices
from .glb import INDICES, Glb

Source: TypeAlias = tuple[
    Array, Faces | None
]  # rows of an attribute, and their indices (F, 3); None: those of vertices

_MOST_UV = 2.0**40  # as Mesh.uvs says
_RESTART = 65535  # as an index of 16 bits restarts strips
_EXPONENTS = range(-60, 61)  # of the largest coordinate: others are scaled by a power of two


class MeshWriter:
    """Writes meshes into a file.

    lost: collects a few words for what the file does not say. decode: whether vertex colors are decoded from sRGB, as for
    `gltf_writer_materials.MaterialWriter`.
    """

    def __init__(self, glb: Glb, lost: list[str], *, decode: bool) -> None:
        self.glb, self.lost, self.decode = glb, lost, decode

    def write(self, mesh: Mesh, material: int) -> tuple[dict[str, Any], Floats]:
        """Write a mesh that has triangles; return it as a primitive, and the (4, 4) matrix from its positions to object
        space."""
        used = _used(mesh.faces, len(mesh.verts))
        verts = mesh.verts if used.all() else np.where(used[:, None], mesh.verts, mesh.verts[mesh.faces[0, 0]])
        positions, matrix = in_float32(verts)
        sources = {"POSITION": (positions, None), **self._sources(mesh)}
        found, faces = unified(mesh.faces, len(mesh.verts), sources)
        attributes = {name: self.glb.accessor(rows, extent=name == "POSITION") for name, rows in found.items()}
        kind = np.uint16 if int(faces.max()) < _RESTART else np.uint32
        indices = self.glb.accessor(faces.reshape(-1).astype(kind), INDICES)
        return {"attributes": attributes, "indices": indices, "material": material}, matrix

    def _sources(self, mesh: Mesh) -> dict[str, Source]:
        """Return the attributes but positions, by their names in the file."""
        normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
        found: dict[str, Source] = {"NORMAL": (_unit(normals, (0.0, 0.0, 1.0)), mesh.normal_faces)}
        if mesh.tangents is not None:
            signs = np.where(mesh.tangents[:, 3:] < 0.0, -1.0, 1.0).astype(np.float32)
            tangents = np.hstack([_unit(mesh.tangents[:, :3], (1.0, 0.0, 0.0)), signs])
            found["TANGENT"] = tangents, mesh.tangent_faces
        if mesh.uvs is not None:
            for number, uvs in enumerate((mesh.uvs, *mesh.more_uvs)):
                finite = np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -_MOST_UV, _MOST_UV)
                found[f"TEXCOORD_{number}"] = finite.astype(np.float32), mesh.uv_faces
        colors = self._colors(mesh)
        if colors is not None:
            found["COLOR_0"] = colors, None
        for name, values in mesh.scalars.items():
            if np.isnan(values).any():
                self.lost.append(f"NaN in scalars {name} (kept, though glTF forbids it)")
            with np.errstate(over="ignore"):
                rows = values.astype(np.float32)
            found[f"_{in_utf8(name)}"] = (rows, None) if at_vertices(mesh, name) else _by_value(rows)
        return found

    def _colors(self, mesh: Mesh) -> Floats32 | None:
        """Return the colors of the vertices, (V, 3) or with alpha (V, 4); None for opaque white."""
        texture = mesh.material.texture
        replaced = texture is not None and texture.lookup == "course" and mesh.uvs is not None
        colors: Floats32 | None = None
        if mesh.colors is not None and not replaced:
            clipped = np.clip(mesh.colors, 0.0, 1.0)
            if (clipped != mesh.colors).any():
                self.lost.append("colors beyond 0 to 1 (clamped)")
            colors = (srgb_to_linear(clipped) if self.decode else clipped).astype(np.float32)
        if mesh.alphas is None:
            return colors
        white = np.ones((len(mesh.verts), 3), np.float32)
        return np.hstack([white if colors is None else colors, mesh.alphas[:, None].astype(np.float32)])


def named(name: str) -> dict[str, str]:
    """Return the name of an object of the file; nothing for an empty one."""
    return {"name": in_utf8(name)} if name else {}


def in_utf8(name: str) -> str:
    """Return a text with escapes for what UTF-8 cannot say, halves of surrogate pairs, which other readers refuse."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def in_float32(verts: Array) -> tuple[Floats32, Floats]:
    """Return positions (V, 3) in float32, and the (4, 4) matrix that takes them to where the given ones are.

    Positions that float32 holds stay as they are. Others are taken relative to the middle of their box where that lies
    farther from the origin than from their ends, and scaled by a power of two where float32 would over- or underflow.
    """
    matrix = np.eye(4)
    with np.errstate(over="ignore", under="ignore"):
        narrow: Floats32 = verts.astype(np.float32)
    if verts.dtype == np.float32 or (narrow == verts).all():
        return narrow, matrix
    low, high = verts.min(axis=0), verts.max(axis=0)
    middle, half = low / 2 + high / 2, float((high / 2 - low / 2).max())
    if float(np.abs(middle).max()) <= half:
        middle = np.zeros(3)
    moved = verts - middle
    exponent = int(np.frexp(np.abs(moved).max())[1])
    exponent = 0 if exponent in _EXPONENTS else exponent
    matrix[:3, :3] *= np.ldexp(1.0, exponent)
    matrix[:3, 3] = middle
    return np.ldexp(moved, -exponent).astype(np.float32), matrix


def unified(faces: Faces, count: int, sources: dict[str, Source]) -> tuple[dict[str, Array], Faces]:
    """Return attributes with one row per vertex of the file, and the faces (F, 3) that index all of them.

    count: of the vertices. Vertices are split only where an attribute differs between the faces around them. They keep
    their order, and those without faces are left out.
    """
    columns: list[Faces] = []
    for _, own in sources.values():
        if own is not None and not any(np.array_equal(own, other) for other in (faces, *columns)):
            columns.append(own)
    if not columns and _used(faces, count).all():
        return {name: rows[:count] for name, (rows, _) in sources.items()}, faces
    key = faces.reshape(-1).astype(np.int64)
    for column in columns:
        key = np.unique(key * (int(column.max()) + 1) + column.reshape(-1), return_inverse=True)[1].reshape(-1)
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    found = {name: rows[(faces if own is None else own).reshape(-1)[first]] for name, (rows, own) in sources.items()}
    return found, vertex.reshape(-1, 3).astype(np.int32)


def _used(faces: Faces, count: int) -> Array:
    """Return which of so many vertices have faces, (count,) bool."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used


def _by_value(values: Array) -> Source:
    """Return the different numbers of scalars per face (F,) or corner (F, 3), and their indices (F, 3)."""
    numbers, index = np.unique(values, return_inverse=True)
    corners = index.reshape(len(values), -1).astype(np.int32)
    return numbers, np.ascontiguousarray(np.broadcast_to(corners, (len(values), 3)))


def _unit(vectors: Array, otherwise: tuple[float, float, float]) -> Floats32:
    """Return vectors (K, 3) at length 1; `otherwise` for those of length 0, which glTF forbids."""
    wide = vectors.astype(np.float64)
    wide[~wide.any(axis=1)] = otherwise
    wide = np.ldexp(wide, -np.frexp(np.abs(wide).max(axis=1, keepdims=True))[1])
    unit: Floats32 = (wide / np.sqrt((wide * wide).sum(axis=1, keepdims=True))).astype(np.float32)
    return unit
