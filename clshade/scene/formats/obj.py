"""Scenes from Wavefront OBJ files, which have no camera or lights."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted, read_file
from .. import framing
from ..geometry import against_normals, crease_normals, seamless_normals, vertex_normals
from ..model import Material, Mesh, Scene, with_fields
from .mtl import Library
from .obj_parser import FaceRun, ObjText
from .options import Options, linear_colors, mended_normals, warn_ignored

MAX_BYTES = 1 << 31  # of a mesh file


def read_obj(path: Path, options: Options) -> Scene:
    """Read a Wavefront OBJ file: its faces in the file's order, with a camera and lights by `framing.framed`.

    A new Mesh begins wherever the object (`o`, or `g` in a file without any), the material, or the presence of uvs or
    normals changes; those of one object are its parts. Positions are float64. Vertex colors are decoded by
    `options.linear_colors`; those with alpha below 1 blend. Faces without normals get those computed from all faces of the
    file, so that no seam shows between meshes; options.weld joins vertices at one position (`geometry.seamless_normals`);
    edges above options.crease are sharp, and all are if the file's only smoothing group is `s off`. Faces that are clockwise
    as seen along the file's normals are reversed. A missing material or image is ignored with a warning. See
    `obj_parser.ObjText` and `mtl`.
    """
    owner = shown(path)
    name = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    text = ObjText(read_file(path, MAX_BYTES), owner)
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
    meshes = _meshes(text, library, options, name)
    if library.undefined:
        more = f" and {len(library.undefined) - 1} more" if library.undefined[1:] else ""
        line = f"{owner}: usemtl: no library defines the material {quoted(library.undefined[0])}{more}"
        warnings.warn(line, stacklevel=2)
    return warn_ignored(
        framing.framed(meshes, name, options.resolution, up=options.up), owner, text.ignored + library.ignored
    )


def _turn_to_normals(text: ObjText, owner: str) -> None:
    """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals that
    are 0 or not finite."""
    with_normals = np.flatnonzero(text.indices[:, 0, 2] >= 0)
    against = with_normals[
        against_normals(text.verts, text.indices[with_normals, :, 0], text.normals, text.indices[with_normals, :, 2])
    ]
    if len(against):
        text.indices[against] = text.indices[against][:, [0, 2, 1]]
    faces, normal_faces = text.indices[with_normals, :, 0], text.indices[with_normals, :, 2]
    text.normals, mended = mended_normals(text.verts, faces, text.normals, normal_faces, f"{owner}: vn")
    if mended is not normal_faces:
        text.indices[with_normals, :, 2] = mended


def _decode_colors(text: ObjText, options: Options, owner: str) -> None:
    """Replace the colors by linear ones (V, 3), and set alphas (V,), of all vertices: 1 where there is none; None if no
    vertex has a color, or alpha below 1."""
    if text.colors is None or not len(text.colored):
        text.colors = None
        return
    rgba = np.ones((len(text.verts), 4))
    rgba[text.colored] = linear_colors(text.colors, options, f"{owner}: v")
    text.colors = np.ascontiguousarray(rgba[:, :3])
    text.alphas = rgba[:, 3].copy() if (rgba[:, 3] < 1.0).any() else None


def _meshes(text: ObjText, library: Library, options: Options, name: str) -> tuple[Mesh, ...]:
    """Return the file's faces as meshes, each of one object and one material, in the order of the file."""
    parts = _parts(text)
    counts = Counter(run.object for run, _ in parts)
    whole = len(parts) == 1
    tables = _Tables(text, _normals(text, options, whole), [run.first for run, _ in parts])
    plain = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    materials: dict[tuple[str | None, bool, bool], tuple[Material, Array | None]] = {}
    flipped: dict[bytes, Array] = {}
    meshes = []
    for number, (run, end) in enumerate(parts):
        indices = text.indices[run.first : end]
        fades = text.alphas is not None and bool((text.alphas[indices[:, :, 0]] < 1.0).any())
        key = (run.material, bool(indices[0, 0, 1] >= 0), fades)
        if key not in materials:
            material, transform = library.material(*key[:2])
            material = with_fields(material, blend=True) if fades else material
            materials[key] = options.lit(material), transform
        material, transform = materials[key]
        transform_key = b"" if transform is None else transform.tobytes()
        if transform_key not in flipped:
            with np.errstate(over="ignore", invalid="ignore"):  # overflowing coordinates mean texel 0
                uvs = text.uvs if transform is None else text.uvs * transform[0] + transform[1]
                flipped[transform_key] = np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)  # v = 0 is the bottom in OBJ
        fields = tables.of_part(number, slice(run.first, end), flipped[transform_key])
        fields.update(material=material, name=run.object or name)
        if counts[run.object] > 1:
            fields["part_of"] = f"{name}/{run.object or ''}"
        # The parser has checked the file's numbers, which thousands of meshes would check again.
        meshes.append(Mesh(**fields) if whole else with_fields(plain, **fields))
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
        joined = vertex_normals(text.verts, faces)
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


class _Split(NamedTuple):
    """The rows of a table that the parts of a file use. rows: those of each part, ascending, one part's after the other's;
    None for all rows, of a file in one part. starts: of each part. faces: (F, 3) indices into the rows of their part."""

    rows: Array | None
    starts: list[int]
    faces: Array

    @classmethod
    def of(cls, indices: Array, firsts: Sequence[int]) -> _Split:
        """Split indices (F, 3) at the first faces of parts. What is below 0 counts as 0."""
        if len(firsts) == 1:
            return cls(None, [], indices)
        part = np.repeat(np.arange(len(firsts)), np.diff([*firsts, len(indices)]))[:, None]
        count = int(indices.max(initial=0)) + 1
        used, faces = np.unique(part * count + np.maximum(indices, 0), return_inverse=True)
        starts = np.searchsorted(used, count * np.arange(len(firsts) + 1))
        faces = (faces.reshape(indices.shape) - starts[part]).astype(np.int32)
        faces.flags.writeable = False
        return cls(used % count, starts.tolist(), faces)

    def taken(self, values: Array, number: int) -> Array:
        """Return the rows of a table (R, ...) that a part uses."""
        if self.rows is None:
            return values
        taken = values[self.rows[self.starts[number] : self.starts[number + 1]]]
        taken.flags.writeable = False
        return taken


class _Tables:
    """The tables of a file, split at the first faces of its parts. computed: see _normals."""

    def __init__(self, text: ObjText, computed: tuple[Array, Array | None] | None, firsts: Sequence[int]) -> None:
        self.text = text
        self.verts, self.uvs, self.normals = (_Split.of(text.indices[:, :, k], firsts) for k in range(3))
        self.at_verts = {"verts": text.verts, "colors": text.colors, "alphas": text.alphas}
        self.computed: tuple[Array, _Split] | None = None
        if computed is not None and computed[1] is not None:
            self.computed = computed[0], _Split.of(computed[1], firsts)
        elif computed is not None:
            self.at_verts["normals"] = computed[0]

    def of_part(self, number: int, faces: slice, uvs: Array) -> dict[str, Any]:
        """Return the arrays of the Mesh of a part. faces: of the file. uvs: (T, 2), in place of the file's."""
        has_uvs, has_normals = (self.text.indices[faces.start, 0, 1:] >= 0).tolist()
        arrays = {
            name: self.verts.taken(values, number) for name, values in self.at_verts.items() if values is not None
        }
        if "alphas" in arrays and (arrays["alphas"] == 1.0).all():
            del arrays["alphas"]
        arrays["faces"] = self.verts.faces[faces]
        if has_uvs:
            arrays |= {"uvs": self.uvs.taken(uvs, number), "uv_faces": self.uvs.faces[faces]}
        values, split = (self.text.normals, self.normals) if has_normals else self.computed or (None, None)
        if values is not None and split is not None:
            arrays |= {"normals": split.taken(values, number), "normal_faces": split.faces[faces]}
        return arrays
