"""Scenes from Wavefront OBJ files, which have no camera or lights: text parsed into arrays, a few megabytes at a time, with
every line checked, then split into meshes.

Own code, because trimesh 5.2 does not read OBJ correctly: it resolves relative indices against the whole file instead
of the lines so far (another mesh, silently), regroups the faces by material and reorders the materials, gives wrong
texture coordinates at seams with `maintain_order` and torn normals without, and accepts index 0, indices out of range
and NaN.
"""

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
from ...errors import InputError
from ..geometry import against_normals, crease_normals, seamless_normals, vertex_normals
from ..model import MAX_FACES, Material, Mesh, Scene, with_fields
from ..triangulate import CUT_AS_FANS, triangulated
from .mtl import Library
from .reading import Options, framed, linear_colors, name_of, repair_normals
from .text_tokens import KEYWORDS, VN, VT, F, V, arguments, blank_comments, chunks, is_blank, numbers, tokenize

MAX_BYTES = 1 << 31  # of a mesh file
_COUNTS = {
    V: ((3, 4, 6, 7), "3 numbers, 4 with w, 6 with a color or 7 with a color and alpha"),
    VT: ((1, 2, 3), "1 to 3 numbers"),
    VN: ((3,), "3 numbers"),
}
_MAX_INDEX = (1 << 31) - 2
# Statements for primitives that are not rendered.
_IGNORED = {
    b"l": "lines",
    b"p": "points",
    b"vc": "colors by vc",
    **dict.fromkeys((b"curv", b"curv2", b"surf"), "free-form curves and surfaces"),
}


def read_obj(path: Path, options: Options) -> Scene:
    """Read a Wavefront OBJ file: its faces in the file's order, with a camera and lights by `framing.framed`; see README.md.

    A new Mesh begins wherever the object (`o`, or `g` in a file without any), the material, or the presence of uvs or
    normals changes; those of one object are its parts. Positions are float64. Faces without normals get those computed from
    all faces of the file, so that no seam shows between meshes; all edges are sharp if the file's only smoothing group is
    `s off`.
    """
    owner = shown(path)
    text = ObjText(read_file(path, MAX_BYTES), owner)
    if options.texture is not None and text.indices[:, 0, 1].max() < 0:
        raise file_error(owner, "vt", "texture coordinates for the texture", "none")
    if options.crease is None and text.smoothing and text.indices[:, 0, 2].min() < 0:
        if text.smoothing == {"off"}:
            options = replace(options, crease=0.0)
        elif len(text.smoothing) > 1:
            text.ignored.append("smoothing groups")
    _orient_by_normals(text, owner)
    if text.colors is not None:  # as linear colors (V, 3), and alphas (V,), of all vertices: white and 1 without
        rgba = np.ones((len(text.verts), 4))
        rgba[text.colored] = linear_colors(text.colors, options, f"{owner}: v")
        text.colors = np.ascontiguousarray(rgba[:, :3])
        text.alphas = rgba[:, 3].copy() if (rgba[:, 3] < 1.0).any() else None
    library = Library(os.fspath(path), text.libraries, options.texture)
    meshes = _meshes(text, library, options, name_of(path))
    if library.undefined:
        more = f" and {len(library.undefined) - 1} more" if library.undefined[1:] else ""
        line = f"{owner}: usemtl: no library defines the material {quoted(library.undefined[0])}{more}"
        warnings.warn(line, stacklevel=2)
    return framed(meshes, path, options, text.ignored + library.ignored)


def _orient_by_normals(text: ObjText, owner: str) -> None:
    """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals that
    are 0 or not finite."""
    with_normals = np.flatnonzero(text.indices[:, 0, 2] >= 0)
    corners = text.indices[with_normals]
    against = against_normals(text.verts, corners[..., 0], text.normals, corners[..., 2])
    corners[against] = corners[against][:, [0, 2, 1]]
    repaired = repair_normals(text.verts, corners[..., 0], text.normals, corners[..., 2], f"{owner}: vn")
    text.normals, corners[..., 2] = repaired
    text.indices[with_normals] = corners


def _meshes(text: ObjText, library: Library, options: Options, name: str) -> tuple[Mesh, ...]:
    """Return the file's faces as meshes, each of one object and one material, in the order of the file."""
    parts = _parts(text)
    counts = Counter(run.object for run, _ in parts)
    is_single = len(parts) == 1
    tables = _Tables(text, _normals(text, options, is_single), [run.first for run, _ in parts])
    plain = Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    materials: dict[tuple[str | None, bool, bool], tuple[Material, Array]] = {}
    flipped: dict[bytes, Array] = {}  # texture coordinates, by the bytes of their transform
    meshes = []
    for number, (run, end) in enumerate(parts):
        indices = text.indices[run.first : end]
        fades = text.alphas is not None and bool((text.alphas[indices[:, :, 0]] < 1.0).any())
        key = (run.material, bool(indices[0, 0, 1] >= 0), fades)
        if key not in materials:
            material, transform = library.material(*key[:2])
            material = with_fields(material, blend=True) if fades else material
            materials[key] = options.lit(material), transform
        material, (scale, offset) = materials[key]
        uvs_key = scale.tobytes() + offset.tobytes()
        if uvs_key not in flipped:
            with np.errstate(over="ignore", invalid="ignore"):  # overflowing coordinates mean texel 0
                u, v = (text.uvs * scale + offset).T
                flipped[uvs_key] = np.stack([u, 1.0 - v], axis=1)  # v = 0 is the bottom in OBJ
        fields = tables.of_part(number, slice(run.first, end), flipped[uvs_key])
        fields.update(material=material, name=run.object or name)
        if counts[run.object] > 1:
            fields["part_of"] = f"{name}/{run.object or ''}"
        # The parser has checked the file's numbers, which thousands of meshes would check again.
        meshes.append(Mesh(**fields) if is_single else with_fields(plain, **fields))
    return tuple(meshes)


def _normals(text: ObjText, options: Options, is_single: bool) -> tuple[Array | None, Array | None]:
    """Return normals (K, 3) for faces that have none, None to leave them to the mesh; and indices (F, 3) into them, None
    for those of the vertices."""
    faces = text.indices[:, :, 0]
    if text.indices[:, 0, 2].min() >= 0:
        return None, None
    if options.crease is not None:
        return crease_normals(text.verts, faces, options.crease)
    joined = seamless_normals(text.verts, faces) if options.weld else None
    return vertex_normals(text.verts, faces) if joined is None and not is_single else joined, None


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


class _Split:
    """The rows of a table that the parts of a file use. firsts: the first face of each part. faces: (F, 3) indices, into the
    rows of their part from `indices` into the table, of which those below 0 count as 0."""

    def __init__(self, indices: Array, firsts: Sequence[int]) -> None:
        self.faces = indices
        self.rows: list[Array] | None = None  # of each part, ascending; None: all
        if len(firsts) > 1:
            part = np.repeat(np.arange(len(firsts)), np.diff([*firsts, len(indices)]))[:, None]
            count = int(indices.max(initial=0)) + 1
            used, faces = np.unique(part * count + np.maximum(indices, 0), return_inverse=True)
            starts = np.searchsorted(used, count * np.arange(len(firsts) + 1))
            self.rows = np.split(used % count, starts[1:-1])
            self.faces = (faces.reshape(indices.shape) - starts[part]).astype(np.int32)
            self.faces.flags.writeable = False

    def select(self, values: Array, number: int) -> Array:
        """Return the rows of a table (R, ...) that a part uses."""
        if self.rows is None:
            return values
        rows = values[self.rows[number]]
        rows.flags.writeable = False
        return rows


class _Tables:
    """The tables of a file, split at the first faces of its parts. computed: see _normals."""

    def __init__(self, text: ObjText, computed: tuple[Array | None, Array | None], firsts: Sequence[int]) -> None:
        self.text, (normals, indices) = text, computed
        self.verts, self.uvs, self.normals = (_Split(text.indices[:, :, k], firsts) for k in range(3))
        self.at_verts = {"verts": text.verts, "colors": text.colors, "alphas": text.alphas}
        self.computed = (None, None) if indices is None else (normals, _Split(indices, firsts))
        if indices is None:
            self.at_verts["normals"] = normals

    def of_part(self, number: int, faces: slice, uvs: Array) -> dict[str, Any]:
        """Return the arrays of the Mesh of a part. faces: of the file. uvs: (T, 2), in place of the file's."""
        has_uvs, has_normals = (self.text.indices[faces.start, 0, 1:] >= 0).tolist()
        arrays = {
            name: self.verts.select(values, number) for name, values in self.at_verts.items() if values is not None
        }
        if "alphas" in arrays and (arrays["alphas"] == 1.0).all():
            del arrays["alphas"]
        arrays["faces"] = self.verts.faces[faces]
        if has_uvs:
            arrays |= {"uvs": self.uvs.select(uvs, number), "uv_faces": self.uvs.faces[faces]}
        values, split = (self.text.normals, self.normals) if has_normals else self.computed
        if values is not None and split is not None:
            arrays |= {"normals": split.select(values, number), "normal_faces": split.faces[faces]}
        return arrays


class FaceRun(NamedTuple):
    """The state from face `first` on: the names of the last `o` (in a file without any, of the last `g`), `g` and
    `usemtl`."""

    first: int
    object: str | None
    group: str | None
    material: str | None


class ObjText:
    """The content of an OBJ file. owner: the file's name, for messages.

    verts: (V, 3) float64, finite. colored: (C,) the vertices with a color. colors: (C, 4) float64 as written, alpha NaN
        where there is none, or None; replaced by the reader, which also sets alphas. uvs: (T, 2) float64, v = 0 at the
        bottom. normals: (K, 3) float64.
    indices: (F, 3, 3) int32 from 0: face, corner, and which of verts, uvs and normals; -1 at all corners of a face
        without uvs or normals.
    runs: in order of their first face. libraries: of each mtllib, (line number, text after the keyword).
    smoothing: the groups that `s` statements name, `off` for none. ignored: features not rendered, a few words each.

    Raises InputError with the line number for: a line that is not an OBJ statement, wrong counts, text in place of a
    number, v that is NaN or infinite, indices 0 or out of range, a face with vt or vn at some corners only; and for a file
    without faces or with more than MAX_FACES triangles.
    """

    alphas: Array | None = None

    def __init__(self, data: bytes, owner: str) -> None:
        if data.startswith(b"\xef\xbb\xbf"):
            data = b"   " + data[3:]
        self.data = data if b"\n" in data else data.replace(b"\r", b"\n")
        self.owner = owner
        self.runs = [FaceRun(0, None, None, None)]
        self.libraries: list[tuple[int, str]] = []
        self.smoothing: set[str] = set()
        self.ignored: list[str] = []
        self._last_line = 0, 1  # a place, and the number of its line
        self._counts, self._face_count = {V: 0, VT: 0, VN: 0}, 0
        self._values: dict[int, list[Array]] = {V: [], VT: [], VN: []}
        self._colored: list[Array] = []
        self._colors: list[Array] = []
        self._corners: list[Array] = []  # of polygons, (C, 3), see indices
        self._corner_counts: list[Array] = []  # of polygons, (P,)
        self._places: list[Array] = []  # of polygons' lines, (P,)
        for offset, chunk in chunks(self.data, owner):
            self._offset, self._lines = offset, tokenize(blank_comments(chunk))
            self._read_names(self._read_faces())
            self._read_numbers()
        if b"\n#MRGB" in self.data:
            self.ignored.append("colors in comments (#MRGB)")
        if not self._face_count:
            raise file_error(owner, "f", "at least one face", "none")
        self._join()
        del self.data, self._lines, self._values, self._corners, self._places  # as large as the file

    def _line(self, place: int) -> int:
        """Return the number of the line that holds byte `place` of the file, counted from the last one asked for."""
        start, number = self._last_line if self._last_line[0] <= place else (0, 1)
        self._last_line = place, number + self.data.count(b"\n", start, place)
        return self._last_line[1]

    def _line_of(self, token: int) -> int:
        return self._line(self._offset + int(self._lines.starts[token]) - 1)

    def _error(self, token: int, keyword: str, expected: str, found: str | bytes) -> InputError:
        """Build the error for a token of the current chunk. found: bytes of the file are quoted."""
        text = quoted(found) if isinstance(found, bytes) else found
        return file_error(self.owner, f"line {self._line_of(token)}: {keyword}", expected, text)

    def _read_names(self, first_triangle: Array) -> None:
        """Read the lines without numbers. first_triangle: (face lines + 1,) index of each face line's first triangle."""
        lines = self._lines
        is_face = lines.kind == F
        upcoming = first_triangle[np.cumsum(is_face) - is_face]
        for index in np.flatnonzero(lines.kind == 0):
            token = int(lines.first[index])
            keyword = lines.token(token)
            if not (len(keyword) <= 32 and keyword.replace(b"_", b"").isalnum()):
                raise self._error(token, "keyword", "an OBJ statement (v, vt, vn, f ...)", keyword)
            if keyword in _IGNORED and _IGNORED[keyword] not in self.ignored:
                self.ignored.append(_IGNORED[keyword])
            if keyword not in (b"o", b"g", b"s", b"usemtl", b"mtllib"):
                continue
            last = int(lines.ends[token + int(lines.count[index])])
            name = lines.text[lines.ends[token] : last].decode("utf-8", "replace").strip()
            if keyword == b"mtllib":
                self.libraries.append((self._line_of(token), name))
                continue
            if keyword == b"s":
                self.smoothing.add("off" if name in ("0", "off") else name)
                continue
            run = self.runs[-1]._replace(first=int(upcoming[index]))
            if keyword == b"o":
                run = run._replace(object=name or None, group=None)
            else:
                run = run._replace(group=name or None) if keyword == b"g" else run._replace(material=name or None)
            if self.runs[-1].first == run.first:
                self.runs.pop()
            self.runs.append(run)

    def _read_numbers(self) -> None:
        lines = self._lines
        for kind, (allowed, expected) in _COUNTS.items():
            wrong = np.flatnonzero((lines.kind == kind) & ~np.isin(lines.count, allowed))
            if len(wrong):
                line = wrong[0]
                raise self._error(int(lines.first[line]), KEYWORDS[kind], expected, str(lines.count[line]))
        chosen = np.flatnonzero(np.isin(lines.kind, (V, VT, VN)))
        count, kinds = lines.count[chosen], lines.kind[chosen]
        values = numbers(arguments(lines, chosen), float, int(count.sum()))
        if values is None:
            raise self._bad_token(chosen, float, "numbers")
        start = np.cumsum(count) - count
        for kind, width in ((V, 3), (VT, 2), (VN, 3)):
            mine = np.flatnonzero(kinds == kind)
            rows = values[start[mine, None] + np.minimum(np.arange(width), count[mine, None] - 1)]
            if kind == VT:
                rows[count[mine] == 1, 1] = 0.0
            if kind == V:
                if not np.isfinite(rows).all():
                    bad = int(np.flatnonzero(~np.isfinite(rows).all(axis=1))[0])
                    token = int(lines.first[chosen[mine[bad]]])
                    raise self._error(token, "v", "finite numbers", str(rows[bad].tolist()))
                colored = np.flatnonzero(count[mine] >= 6)
                some = mine[colored]
                colors = values[start[some, None] + np.minimum(np.arange(3, 7), count[some, None] - 1)]
                colors[count[some] == 6, 3] = np.nan
                self._colored.append(self._counts[V] + colored)
                self._colors.append(colors)
            self._values[kind].append(rows)
            self._counts[kind] += len(rows)

    def _bad_token(self, chosen: Array, dtype: type, expected: str) -> InputError:
        """Build the error for the first token in the chosen lines that is not a number, or not a corner of a face."""
        lines = self._lines
        for index in chosen:
            first, count = int(lines.first[index]), int(lines.count[index])
            for token in range(first + 1, first + 1 + count):
                text = lines.token(token)
                fields = filter(None, text.split(b"/")) if dtype is int else [text]
                if text.count(b"/") > 2 or any(numbers(part, dtype, 1) is None for part in fields):
                    return self._error(token, KEYWORDS[int(lines.kind[index])], expected, text)
        raise file_error(self.owner, "text", expected, "something else")

    def _read_faces(self) -> Array:
        """Read the f lines of a chunk. Returns (face lines + 1,) the index in the file of each one's first triangle."""
        lines = self._lines
        chosen = np.flatnonzero(lines.kind == F)
        count = lines.count[chosen]
        first_triangle = self._face_count + np.concatenate([[0], np.cumsum(np.maximum(count - 2, 0))])
        if len(chosen) and count.min() < 3:
            self.ignored.append("faces of fewer than 3 corners")
            chosen, count = chosen[count >= 3], count[count >= 3]
        if first_triangle[-1] > MAX_FACES:
            raise file_error(self.owner, "f", f"at most {MAX_FACES} triangles", "more")
        if len(chosen):
            self._corners.append(self._resolved(chosen, self._corner_table(chosen)))
            self._corner_counts.append(count)
            self._places.append(self._offset + lines.starts[lines.first[chosen]] - 1)
        self._face_count = int(first_triangle[-1])
        return first_triangle

    def _corner_table(self, chosen: Array) -> Array:
        """Return (C, 3) int64: the numbers v/vt/vn as written in each corner of the chosen f lines, 0 if missing."""
        lines = self._lines
        text = arguments(lines, chosen)
        blank, slash = is_blank(text), np.frombuffer(text, np.uint8) == ord("/")
        slashes = np.cumsum(slash, dtype=np.int32)
        # Each line's part begins with a blank, so position 0 never starts a corner or a number.
        corner = np.flatnonzero(blank[:-1] & ~blank[1:]) + 1
        apart = blank | slash
        part = np.flatnonzero(apart[:-1] & ~apart[1:]) + 1
        owner = np.searchsorted(corner, part, side="right") - 1
        before = slashes[corner] - slash[corner]
        column = slashes[part] - before[owner]
        expected = "corners of whole numbers v, v/vt, v//vn or v/vt/vn"
        values = numbers(text.replace(b"/", b" "), int, len(part))
        if values is None or np.diff(before, append=slashes[-1]).max() > 2:
            raise self._bad_token(chosen, int, expected)
        table = np.zeros((len(corner), 3), np.int64)
        table[owner, column] = values
        bad = owner[values == 0] if (values == 0).any() else np.flatnonzero(table[:, 0] == 0)
        if len(bad):
            token = self._corner_token(chosen, int(bad[0]))
            raise self._error(token, "f", "indices from 1, or below 0", lines.token(token))
        return table

    def _corner_token(self, chosen: Array, corner: int) -> int:
        """Return the token of a corner, counted over the chosen f lines."""
        count = self._lines.count[chosen]
        first = self._lines.first[chosen] + 1 - (np.cumsum(count) - count)
        return int(np.repeat(first, count)[corner]) + corner

    def _resolved(self, chosen: Array, table: Array) -> Array:
        """Return (C, 3) int32 indices from 0, or -1, of the corners with the numbers `table` (see _corner_table)."""
        lines = self._lines
        count = lines.count[chosen]
        start = np.cumsum(count) - count
        result = np.empty(table.shape, np.int32)
        for column, kind in enumerate((V, VT, VN)):
            entries = table[:, column]
            so_far = self._counts[kind] + np.repeat(np.cumsum(lines.kind == kind)[chosen], count)
            index = np.where(entries > 0, entries - 1, so_far + entries)
            bad = np.flatnonzero((entries != 0) & ((index < 0) | (index > _MAX_INDEX)))
            if len(bad):
                token = self._corner_token(chosen, int(bad[0]))
                expected = f"{KEYWORDS[kind]} indices up to the {so_far[bad[0]]} so far"
                raise self._error(token, "f", expected, lines.token(token))
            have = np.add.reduceat(entries != 0, start, dtype=np.int64)
            partly = np.flatnonzero((have != 0) & (have != count))
            if len(partly):
                token = int(lines.first[chosen[partly[0]]])
                expected = f"{KEYWORDS[kind]} at all corners or none"
                raise self._error(token, "f", expected, f"{have[partly[0]]} of {count[partly[0]]}")
            result[:, column] = np.where(entries == 0, -1, index)
        return result

    def _join(self) -> None:
        self.verts, self.uvs, self.normals = (np.concatenate(self._values[kind]) for kind in (V, VT, VN))
        self.colored = np.concatenate(self._colored)
        self.colors = np.concatenate(self._colors) if len(self.colored) else None
        corners, counts = np.concatenate(self._corners), np.concatenate(self._corner_counts)
        for column, (kind, values) in enumerate(((V, self.verts), (VT, self.uvs), (VN, self.normals))):
            if corners[:, column].max() >= len(values):
                corner = int(np.argmax(corners[:, column] >= len(values)))
                polygon = int(np.searchsorted(np.cumsum(counts), corner, side="right"))
                line = self._line(int(np.concatenate(self._places)[polygon]))
                expected = f"{KEYWORDS[kind]} indices up to {len(values)}"
                raise file_error(self.owner, f"line {line}: f", expected, str(corners[corner, column] + 1))
        cuts = triangulated(self.verts, corners[:, 0], counts)
        if cuts.left:
            self.ignored.append(CUT_AS_FANS)
        self.indices = cuts.triangles(corners)
        self.runs = [run for run in self.runs if run.first < len(self.indices)]
        if all(run.object is None for run in self.runs):
            self.runs = [run._replace(object=run.group) for run in self.runs]
