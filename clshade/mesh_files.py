"""Scenes from mesh files that hold no camera or lights: Wavefront OBJ."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from . import framing, geometry
from .atomic import Path, shown
from .images import as_texture
from .mtl_files import Library
from .obj_text import ObjText, Run, parse_obj
from .reading import complaint, quoted, read_file
from .scene import Array, Material, Mesh, Scene, Texture

MAX_BYTES = 1 << 31  # of a mesh file

DEFAULT_MATERIAL = Material(ka=1.0, kd=0.8, ks=0.3, n=32.0)  # of faces whose material the file does not give


def read_obj(path: Path, *, texture: Any = None, resolution: tuple[int, int] | None = None) -> Scene:
    """The scene in a Wavefront OBJ file: its faces in the file's order, with a camera and lights by `framing.framed`.

    texture: path of an image (decoded from sRGB), array (linear) or Texture, in place of the materials' own, for all
        faces with texture coordinates.
    resolution: (N, M), pixels.

    A new Mesh begins wherever the object (`o`), the material, or the presence of uvs or normals changes. Positions
    are float64. Vertex colors are taken as linear; one that is NaN or infinite becomes white, with a warning. Faces
    without normals get those of the whole file's faces, so that no seam shows between meshes. A material or image that
    is not there is left out, with a warning. See `obj_text.parse_obj` for the format and `mtl_files` for materials.

    Raises InputError, one line, see clshade.loading.load.
    """
    owner = shown(path)
    name = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    text = parse_obj(read_file(path, MAX_BYTES), owner)
    if texture is not None and text.indices[:, 0, 1].max() < 0:
        raise complaint(owner, "vt", "texture coordinates for the texture", "none")
    own = None if texture is None else as_texture(texture, srgb=True)
    library = Library(os.fspath(path), text.libraries)
    text.colors = _finite_colors(text.colors, owner)
    text.uvs = _flipped(text.uvs)
    return framing.framed(_meshes(text, library, own, name, owner), name, resolution)


def _flipped(uvs: Array) -> Array:
    """(T, 2) uvs with v = 0 at the bottom of the image, as OBJ has them, to v = 0 at row 0, as all of clshade has."""
    return np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)


def _finite_colors(colors: Array | None, owner: str) -> Array | None:
    if colors is None:
        return None
    bad = ~np.isfinite(colors).all(axis=1)
    if bad.any():
        warnings.warn(f"{owner}: v: {bad.sum()} colors that are not finite became white", stacklevel=2)
        colors[bad] = 1.0
    return colors


def _meshes(text: ObjText, library: Library, texture: Texture | None, name: str, owner: str) -> tuple[Mesh, ...]:
    """The file's faces as meshes, each of one object and one material, in the order of the file."""
    parts = _parts(text)
    computed = None
    if len(parts) > 1 and text.indices[:, 0, 2].min() < 0:
        computed = geometry.vertex_normals(text.verts, text.indices[:, :, 0])
    materials: dict[tuple[str | None, bool], Material] = {}
    meshes = []
    for run, end in parts:
        indices = text.indices[run.first : end]
        key = (run.material, bool(indices[0, 0, 1] >= 0))
        if key not in materials:
            materials[key] = _material(library, *key, texture, owner)
        arrays = _arrays(text, indices, computed, whole=len(parts) == 1)
        meshes.append(Mesh(**arrays, material=materials[key], name=run.object or run.group or name))
    return tuple(meshes)


def _parts(text: ObjText) -> list[tuple[Run, int]]:
    """Where a mesh begins, as a run, and the face after its last one."""
    has = text.indices[:, 0, 1:] >= 0
    cuts = set((np.flatnonzero((has[1:] != has[:-1]).any(axis=1)) + 1).tolist())
    firsts = [run.first for run in text.runs]
    for before, run in zip(text.runs, text.runs[1:], strict=False):
        if (before.object, before.material) != (run.object, run.material):
            cuts.add(run.first)
    starts = [0, *sorted(cuts)]
    which = np.searchsorted(firsts, starts, side="right") - 1
    runs = [text.runs[index]._replace(first=first) for index, first in zip(which, starts, strict=True)]
    return list(zip(runs, [*starts[1:], len(text.indices)], strict=True))


def _arrays(text: ObjText, indices: Array, computed: Array | None, whole: bool) -> dict[str, Any]:
    """The arrays of a Mesh of the faces `indices` (F, 3, 3): the file's own where it is `whole`, else what is used.

    computed: (V, 3) normals at the vertices for faces that have none, None to leave them to the mesh.
    """
    faces, *others = (indices[:, :, column] for column in range(3))
    verts, colors, normals = text.verts, text.colors, computed
    if not whole:
        used, faces = _used(faces)
        verts = verts[used]
        colors, normals = (None if array is None else array[used] for array in (colors, normals))
    arrays: dict[str, Any] = {"verts": verts, "faces": faces, "colors": colors, "normals": normals}
    for name, values, own in zip(("uv", "normal"), (text.uvs, text.normals), others, strict=True):
        if own[0, 0] >= 0:
            if not whole:
                used, own = _used(own)
                values = values[used]
            arrays.update({f"{name}s": values, f"{name}_faces": own})
    return arrays


def _used(indices: Array) -> tuple[Array, Array]:
    """The values that occur in (F, 3) indices, ascending, and the indices into these."""
    used, inverse = np.unique(indices, return_inverse=True)
    return used, inverse.reshape(indices.shape)


def _material(library: Library, name: str | None, textured: bool, texture: Texture | None, owner: str) -> Material:
    material = None
    if name is not None:
        material = library.material(name, textured and texture is None)
        if material is None:
            warnings.warn(f"{owner}: usemtl: no library defines the material {quoted(name)}", stacklevel=2)
    material = material or DEFAULT_MATERIAL
    return replace(material, texture=texture) if textured and texture is not None else material
