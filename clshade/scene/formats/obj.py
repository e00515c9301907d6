"""Scenes from Wavefront OBJ files, which have no camera or lights."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, read_file
from .. import framing, geometry
from ..model import Material, Mesh, Scene
from ..normals import against_normals, crease_normals, seamless_normals
from .mtl import Library
from .obj_parser import FaceRun, ObjText, parse_obj
from .options import Options, linear_colors, mended_normals, warn_ignored

MAX_BYTES = 1 << 31  # of a mesh file


def read_obj(path: Path, options: Options) -> Scene:
    """Read a Wavefront OBJ file: its faces in the file's order, with a camera and lights by `framing.framed`.

    A new Mesh begins wherever the object (`o`), the material, or the presence of uvs or normals changes. Positions
    are float64. Vertex colors are decoded by `options.linear_colors`; those with alpha below 1 blend. Faces
    without normals get those computed from all faces of the file, so that no seam shows between meshes; options.weld joins
    vertices at one position (`normals.seamless_normals`); edges above options.crease are sharp, and all are if the file's
    only smoothing group is `s off`. Faces that are clockwise as seen along the file's normals are reversed. A missing
    material or image is ignored with a warning. See `obj_parser.parse_obj` and `mtl`.

    Raises InputError, one line, see clshade.scene.formats.load.load.
    """
    owner = shown(path)
    name = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    text = parse_obj(read_file(path, MAX_BYTES), owner)
    if options.texture is not None and text.indices[:, 0, 1].max() < 0:
        raise file_error(owner, "vt", "texture coordinates for the texture", "none")
    if options.crease is None and text.smoothing and text.indices[:, 0, 2].min() < 0:
        if text.smoothing == {"off"}:
            options = replace(options, crease=0.0)
        elif len(text.smoothing) > 1:
            text.ignored.append("smoothing groups")
    _turn_to_normals(text, owner)
    _decode_colors(text, options, owner)
    library = Library(os.fspath(path), text.libraries, options.texture)
    meshes = _meshes(text, library, options, name, owner)
    return warn_ignored(
        framing.framed(meshes, name, options.resolution, up=options.up), owner, text.ignored + library.ignored
    )


def _turn_to_normals(text: ObjText, owner: str) -> None:
    """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals that
    are 0 or not finite."""
    given = np.flatnonzero(text.indices[:, 0, 2] >= 0)
    faces, normal_faces = text.indices[given, :, 0], text.indices[given, :, 2]
    against = given[against_normals(text.verts, faces, text.normals, normal_faces)]
    if len(against):
        text.indices[against] = text.indices[against][:, [0, 2, 1]]
        faces, normal_faces = text.indices[given, :, 0], text.indices[given, :, 2]
    text.normals, mended = mended_normals(text.verts, faces, text.normals, normal_faces, f"{owner}: vn")
    if mended is not normal_faces:
        text.indices[given, :, 2] = mended


def _flipped(uvs: Array) -> Array:
    """Flip (T, 2) uvs from v = 0 at the bottom of the image, as in OBJ, to v = 0 at row 0, as in all of clshade."""
    return np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)


def _decode_colors(text: ObjText, options: Options, owner: str) -> None:
    """Replace the colors by linear ones (V, 3), and set alphas (V,), of all vertices: 1 where there is none; None if no
    vertex has a color, or alpha below 1."""
    rgba = np.ones((len(text.verts), 4))
    if text.colors is not None and len(text.colors):
        rgba[text.colored] = linear_colors(text.colors, options, f"{owner}: v")
    text.colors = np.ascontiguousarray(rgba[:, :3]) if len(text.colored) else None
    text.alphas = rgba[:, 3].copy() if (rgba[:, 3] < 1.0).any() else None


def _meshes(text: ObjText, library: Library, options: Options, name: str, owner: str) -> tuple[Mesh, ...]:
    """Return the file's faces as meshes, each of one object and one material, in the order of the file."""
    parts = _parts(text)
    whole = len(parts) == 1
    computed = _normals(text, options, whole)
    materials: dict[tuple[str | None, bool], tuple[Material, Array | None]] = {}
    flipped: dict[bytes, Array] = {}
    meshes = []
    for run, end in parts:
        indices = text.indices[run.first : end]
        key = (run.material, bool(indices[0, 0, 1] >= 0))
        if key not in materials:
            material, moved = library.material(*key)
            materials[key] = options.lit(replace(material, blend=material.blend or text.alphas is not None)), moved
        material, moved = materials[key]
        moment = b"" if moved is None else moved.tobytes()
        if moment not in flipped:
            with np.errstate(over="ignore", invalid="ignore"):  # overflowing coordinates mean texel 0
                flipped[moment] = _flipped(text.uvs if moved is None else text.uvs * moved[0] + moved[1])
        arrays = _arrays(text, flipped[moment], slice(run.first, end), computed, whole)
        meshes.append(Mesh(**arrays, material=material, name=run.object or run.group or name))
    return tuple(meshes)


def _normals(text: ObjText, options: Options, whole: bool) -> tuple[Array, Array | None] | None:
    """Return normals (K, 3) for faces that have none, and indices (F, 3) into them, or None for those of the vertices.

    None in place of both leaves the normals to the mesh.
    """
    if text.indices[:, 0, 2].min() >= 0:
        return None
    faces = text.indices[:, :, 0]
    if options.crease is not None:
        return crease_normals(text.verts, faces, options.crease)
    joined = seamless_normals(text.verts, faces) if options.weld else None
    if joined is None and not whole:
        joined = geometry.vertex_normals(text.verts, faces)
    return None if joined is None else (joined, None)


def _parts(text: ObjText) -> list[tuple[FaceRun, int]]:
    """Return where each mesh begins, as a run, and the face after its last one."""
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


def _arrays(
    text: ObjText, uvs: Array, chosen: slice, computed: tuple[Array, Array | None] | None, whole: bool
) -> dict[str, Any]:
    """Return the arrays of a Mesh of the chosen faces: the file's own if these are the `whole`, else the rows in use.

    uvs: (T, 2), used in place of the file's. computed: see _normals.
    """
    faces, *others = (text.indices[chosen, :, column] for column in range(3))
    at_verts = {"verts": text.verts, "colors": text.colors, "alphas": text.alphas, "normals": None}
    sources = [("uv", uvs, others[0]), ("normal", text.normals, others[1])]
    if others[1][0, 0] < 0 and computed is not None:
        if computed[1] is None:
            at_verts["normals"] = computed[0]
        else:
            sources[1] = ("normal", computed[0], computed[1][chosen])
    if not whole:
        used, faces = _used(faces)
        at_verts = {name: None if values is None else values[used] for name, values in at_verts.items()}
    arrays: dict[str, Any] = {**at_verts, "faces": faces}
    for name, values, own in sources:
        if own[0, 0] >= 0:
            if not whole:
                used, own = _used(own)
                values = values[used]
            arrays.update({f"{name}s": values, f"{name}_faces": own})
    return arrays


def _used(indices: Array) -> tuple[Array, Array]:
    """Return the values that occur in (F, 3) indices, ascending, and the indices into these."""
    used, inverse = np.unique(indices, return_inverse=True)
    return used, inverse.reshape(indices.shape)
