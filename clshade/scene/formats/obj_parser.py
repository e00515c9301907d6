"""Parser of Wavefront OBJ text into arrays, a few megabytes at a time, with every line checked.

Own code, because trimesh 5.2 does not read OBJ correctly: it resolves relative indices against the whole file instead
of the lines so far (another mesh, silently), regroups the faces by material and reorders the materials, gives wrong
texture coordinates at seams with `maintain_order` and torn normals without, and accepts index 0, indices out of range
and NaN.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error, quoted
from ...errors import InputError
from ..model import MAX_FACES
from ..triangulate import CUT_AS_FANS, triangulated
from .text_tokens import KEYWORDS, VN, VT, F, V, arguments, chunks, cleaned, is_blank, numbers, tokenized

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


class FaceRun(NamedTuple):
    """The state from face `first` on: the names of the last `o` (in a file without any, of the last `g`), `g` and `usemtl`;
    None if there was none."""

    first: int
    object: str | None
    group: str | None
    material: str | None


class ObjText:
    """The content of an OBJ file. owner: the file's name, for messages.

    verts: (V, 3) float64, finite. colored: (C,) the vertices with a color. colors: (C, 4) float64 as written, alpha 1
        where there is none; replaced by the reader, which also sets alphas. uvs: (T, 2) float64, v = 0 at the bottom.
    normals: (K, 3) float64.
    indices: (F, 3, 3) int32 from 0: face, corner, and which of verts, uvs and normals; -1 at all corners of a face
        without uvs or normals.
    runs: in order of their first face. libraries: of each mtllib, (line number, text after the keyword).
    smoothing: the groups that `s` statements name, `off` for none. ignored: features not rendered, a few words each.

    Read: v (also with w, which is ignored, or a color with or without alpha), vt, vn, f (any number of corners, see
    `triangulate.triangulated`; relative indices), o, g, s, usemtl, mtllib, comments, continued lines, a byte order
    mark, line ends of any kind. Other statements are skipped. Vertices, uvs and normals that no face uses are kept.

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
            self._offset, self._lines = offset, tokenized(cleaned(chunk))
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
        found = quoted(found) if isinstance(found, bytes) else found
        return file_error(self.owner, f"line {self._line_of(token)}: {keyword}", expected, found)

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
        """Read the v, vt and vn lines of a chunk."""
        lines = self._lines
        for kind, (allowed, expected) in _COUNTS.items():
            wrong = np.flatnonzero((lines.kind == kind) & ~np.isin(lines.count, allowed))
            if len(wrong):
                found = str(lines.count[wrong[0]])
                raise self._error(int(lines.first[wrong[0]]), KEYWORDS[kind], expected, found)
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
                numbers_of = start[mine[colored], None] + np.minimum(np.arange(3, 7), count[mine[colored], None] - 1)
                colors = values[numbers_of]
                colors[count[mine[colored]] == 6, 3] = np.nan
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
                fields = [part for part in text.split(b"/") if part] if dtype is int else [text]
                good = all(numbers(part, dtype, 1) is not None for part in fields)
                if not good or text.count(b"/") > 2:
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
        lines = self._lines
        before = np.cumsum(lines.count[chosen])
        line = int(np.searchsorted(before, corner, side="right"))
        index = chosen[line]
        return int(lines.first[index] + 1 + corner - (before[line] - lines.count[index]))

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
        self.colors: Array | None = np.concatenate(self._colors)
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
