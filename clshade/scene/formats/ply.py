"""Scenes from PLY files, ascii and binary: the header, the rows of every element as columns, each checked, then a mesh.

Own code on NumPy, because trimesh 5.2 silently returns no faces for triangle strips, accepts NaN, infinity and
indices out of range, doubles the precision of every position, and opens the textures that a comment names.
"""

from __future__ import annotations

import re
import struct
import warnings
from array import array
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted, read_file, runs
from ...errors import InputError
from ..geometry import against_normals, crease_normals, seamless_normals, vertex_normals
from ..model import MAX_FACES, Mesh, Scene, Texture
from ..triangulate import CUT_AS_FANS, Cuts, strips, triangulated
from .reading import DEFAULT_MATERIAL, Images, Options, framed, linear_colors, name_of, repair_normals
from .text_tokens import is_blank, numbers

MAX_BYTES = 1 << 31
MAX_HEADER = 1 << 16  # bytes
MAX_LISTS = 8  # in an element
MAX_SCALARS = 64  # of vertices, and of faces
_INDICES = ("vertex_indices", "vertex_index")
_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_COLORS = (
    ("red", "green", "blue", "alpha"),
    ("r", "g", "b", "a"),
    ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"),
)
_TEXTURE = re.compile(r"TextureFile\s+(.+)", re.IGNORECASE)
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_LINE_END = re.compile(rb"[ \t]*(?:\r\n|\n|\r|\Z)")
_CHUNK = 1 << 20  # bytes of ascii text taken at once


def read_ply(path: Path, options: Options) -> Scene:
    """Read a PLY file: one Mesh of its faces, followed by its triangle strips, see README.md.

    Positions are float32, or float64 where the file has double or text. Colors, of integers value/255 (65535), are decoded
    by `linear_colors`. Faces that have colors get vertices of their own. Properties of vertices and faces that are
    numbers and mean nothing else become Mesh.scalars; other elements are listed in Scene.ignored.
    """
    reader = _Reader(path, options)
    return framed((reader.mesh(),), path, options, reader.ignored)


class _Reader:
    """Makes the Mesh of a file.

    faces: (F, 3) int32 indices into the file's vertices. polygon: (F,) the row in element face of each, -1 for triangles
    of strips. cuts: how the polygons are cut; None if there are strips. arrays: fields of the Mesh.
    """

    def __init__(self, path: Path, options: Options) -> None:
        self.path, self.owner, self.options = path, shown(path), options
        self.file = PlyFile(read_file(path, MAX_BYTES), self.owner)
        self.error, self.ignored = self.file.error, list[str]()
        vertex, face = self.file.elements.get("vertex"), self.file.elements.get("face")
        if vertex is None or not vertex.rows:
            raise self.error("element vertex", "at least one vertex", "none")
        self.vertex, self.face = vertex, face if face is not None and face.rows else None
        verts = self._columns("x", "y", "z")
        if verts is None:
            raise self.error("element vertex", "properties x, y and z", ", ".join(vertex.columns) or "none")
        self.faces, self.polygon, self.cuts = self._faces(verts)
        self.arrays: dict[str, Any] = {"verts": verts, "faces": self.faces}

    def mesh(self) -> Mesh:
        arrays, options = self.arrays, self.options
        arrays["normals"] = normals = self._columns("nx", "ny", "nz", finite=False)
        arrays["scalars"] = self._scalars(self.vertex)
        if normals is None and options.crease is not None:
            creased = crease_normals(arrays["verts"], self.faces, options.crease)
            arrays["normals"], arrays["normal_faces"] = creased
        elif normals is None and options.weld:
            arrays["normals"] = seamless_normals(arrays["verts"], self.faces)
        self._color()
        texture = self._texture()
        for name, values in ({} if self.face is None else self._scalars(self.face)).items():
            by_face = np.where(self.polygon < 0, values.dtype.type(np.nan), values[self.polygon])  # NaN: of strips
            if len(by_face) == len(arrays["verts"]):  # by corner, they are not taken for the vertices'
                by_face = np.repeat(by_face[:, None], 3, axis=1)
            arrays["scalars"][name if name not in arrays["scalars"] else f"face_{name}"] = by_face
        if normals is not None:
            self._orient_by_normals()
        blend = arrays["colors"] is not None and bool((arrays["colors"][:, 3] < 1.0).any())
        material = replace(options.lit(DEFAULT_MATERIAL), texture=texture, blend=blend)
        read = ("vertex", "face", "tristrips")
        self.ignored += [f"element {name[:32]}" for name in self.file.elements if name not in read]
        return Mesh(**arrays, material=material, name=name_of(self.path))

    def _columns(self, *names: str, finite: bool = True) -> Array | None:
        """Return (rows, len(names)) values of scalar properties of vertices, float32 or float64; None unless all are
        there."""
        if not self.vertex.has(*names):
            return None
        columns = [self.vertex.columns[name] for name in names]
        single = all(column.dtype == np.float32 for column in columns)
        values = np.empty((self.vertex.rows, len(names)), np.float32 if single else np.float64)
        for number, column in enumerate(columns):
            values[:, number] = column
        if finite and not np.isfinite(values).all():
            row, number = np.argwhere(~np.isfinite(values))[0]
            where = f"element vertex: row {row}: {names[number]}"
            raise self.error(where, "a finite number", str(values[row, number]))
        return values

    def _faces(self, verts: Array) -> tuple[Array, Array, Cuts | None]:
        faces, polygons, cuts = [], [], None
        for element in (self.face, self.file.elements.get("tristrips")):
            if element is None or not element.rows:
                continue
            corners, lengths = self._corners(element, len(verts))
            if element is self.face:
                cuts = triangulated(verts, corners, lengths)
                if cuts.left:
                    self.ignored.append(CUT_AS_FANS)
                triangles, polygon = cuts.triangles(corners), cuts.polygon
            else:
                triangles = strips(np.insert(corners, np.cumsum(lengths)[:-1], -1))
                polygon = np.full(len(triangles), -1)
            faces.append(triangles)
            polygons.append(polygon)
        if not sum(map(len, faces)):
            raise self.error("element face", "at least one triangle, in faces or tristrips", "none")
        if len(faces) == 1:
            return faces[0], polygons[0], cuts
        return np.concatenate(faces), np.concatenate(polygons), None if len(faces[1]) else cuts

    def _corners(self, element: Element, count: int) -> tuple[Array, Array]:
        """Return the int32 indices below `count` of the corners of an element's polygons or strips, and how many each
        has."""
        where, is_face = f"element {element.name}", element is self.face
        lists = [element.columns[name] for name in _INDICES if isinstance(element.columns.get(name), tuple)]
        if not lists:
            expected = f"a list property {' or '.join(_INDICES)}"
            raise self.error(where, expected, ", ".join(element.columns) or "none")
        values, lengths = lists[0]
        minimum = 0 if is_face else -1
        integral = values.dtype.kind in "iu" or bool((values == np.floor(values)).all())
        if len(values) and not (integral and values.min() >= minimum and values.max() < count):
            place = int(np.argmin((values >= minimum) & (values < count) & (values == np.floor(values))))
            row = int(np.searchsorted(np.cumsum(lengths), place, side="right"))
            raise self.error(f"{where}: row {row}", f"indices from 0 to {count - 1}", f"{values[place]:g}")
        if is_face and lengths.min() < 3:
            row = int(np.argmax(lengths < 3))
            raise self.error(f"{where}: row {row}", "at least 3 corners", str(lengths[row]))
        if is_face and int(lengths.sum()) - 2 * len(lengths) > MAX_FACES:
            raise self.error(where, f"at most {MAX_FACES} triangles", "more")
        return values.astype(np.int32, copy=False), lengths

    def _orient_by_normals(self) -> None:
        """Reverse the faces that are clockwise as seen along the file's normals, which define the front; compute normals
        that are 0 or not finite."""
        arrays = self.arrays
        names = [name for name in ("faces", "normal_faces", "uv_faces") if arrays.get(name) is not None]
        name = "normal_faces" if "normal_faces" in names else "faces"
        against = against_normals(arrays["verts"], arrays["faces"], arrays["normals"], arrays[name])
        if against.any():
            arrays.update({key: np.where(against[:, None], arrays[key][:, [0, 2, 1]], arrays[key]) for key in names})
        where = f"{self.owner}: element vertex: nx, ny, nz"
        arrays["normals"], repaired = repair_normals(
            arrays["verts"], arrays["faces"], arrays["normals"], arrays[name], where
        )
        if repaired is not arrays[name]:
            arrays["normal_faces"] = repaired

    def _linear(self, element: Element | None) -> Array | None:
        """Return (rows, 4) linear colors and alphas of an element, or None if it has none."""
        names = () if element is None else next((names for names in _COLORS if element.has(*names[:3])), ())
        if element is None or not names:
            return None
        kinds = {item.name: np.dtype(item.kind) for item in element.properties}
        values = np.ones((element.rows, 4))
        for number, name in enumerate(names if element.has(names[3]) else names[:3]):
            values[:, number] = element.columns[name]
            if kinds[name].kind in "iu":
                largest = np.iinfo(kinds[name]).max if kinds[name].itemsize < 4 else 255
                values[:, number] = np.clip(values[:, number] / largest, 0.0, 1.0)
        return linear_colors(values, self.options, f"{self.owner}: element {element.name}").astype(np.float32)

    def _color(self) -> None:
        """Set the colors of the vertices or, if they have none, of the faces, whose corners then get their own vertices."""
        arrays = self.arrays
        arrays["colors"], colors = self._linear(self.vertex), self._linear(self.face)
        if colors is None:
            return
        if arrays["colors"] is not None:
            self.ignored.append("colors of faces (the vertices have some)")
            return
        faces, verts = arrays["faces"], arrays["verts"]
        if arrays["normals"] is None:
            arrays["normals"] = vertex_normals(verts, faces)
        arrays.setdefault("normal_faces", faces)
        by_face = np.where(self.polygon[:, None] < 0, np.float32(1.0), colors[self.polygon])
        arrays.update(verts=verts[faces].reshape(-1, 3), colors=np.repeat(by_face, 3, axis=0))
        arrays["scalars"] = {name: values[faces].reshape(-1) for name, values in arrays["scalars"].items()}
        arrays["faces"] = np.arange(len(arrays["verts"]), dtype=np.int32).reshape(-1, 3)

    def _scalars(self, element: Element) -> dict[str, Array]:
        """Return the (rows,) values, float32 or float64, of an element's properties that mean nothing else."""
        is_vertex = element is self.vertex
        groups = [("x", "y", "z"), ("nx", "ny", "nz"), *_UVS] if is_vertex else []
        groups = [names for names in groups if element.has(*names)]
        groups += [names for names in _COLORS if element.has(*names[:3])][:1]
        meant = {name for names in groups for name in names}
        rest = {name: column for name, column in element.columns.items() if name not in meant}
        lists = [name for name, column in rest.items() if isinstance(column, tuple)]
        self.ignored += [f"list {name[:32]}" for name in lists if is_vertex or name not in (*_INDICES, "texcoord")]
        names = [name for name in rest if name not in lists]
        if len(names) > MAX_SCALARS:
            self.ignored.append(f"properties of element {element.name} beyond {MAX_SCALARS}")
        # float32 holds every number of 16 bits, and float64 those of 32.
        kinds = {name: np.promote_types(rest[name].dtype, np.float32) for name in names[:MAX_SCALARS]}
        return {name: rest[name].astype(kind) for name, kind in kinds.items()}

    def _texture(self) -> Texture | None:
        """Return the texture, and set its coordinates; None if the file has no coordinates or no image."""
        texture = self.options.texture
        uvs, uv_faces = self._uvs()
        names = [match.group(1).strip() for match in map(_TEXTURE.fullmatch, self.file.comments) if match]
        if uvs is None:
            self.ignored.extend(["textures of faces without texture coordinates"] if names else [])
            if texture is not None:
                raise self.error("element vertex", "texture coordinates (s t, u v ...) for the texture", "none")
            return None
        if uv_faces is None and self.arrays["faces"] is not self.faces:
            uv_faces = self.faces
        uvs[:, 1] = 1.0 - uvs[:, 1]
        self.arrays.update(uvs=uvs, uv_faces=uv_faces)
        if texture is not None or not names:
            return texture
        if len(names) > 1:
            warnings.warn(f"{self.owner}: comment TextureFile: images after the first are not rendered", stacklevel=2)
        images = Images(self.path)
        image = images.find(names[0], self.owner, "comment TextureFile")
        return None if image is None else images.texture(image)

    def _uvs(self) -> tuple[Array | None, Array | None]:
        """Return texture coordinates (T, 2), and their indices (F, 3) where corners have them."""
        listed = None if self.face is None else self.face.columns.get("texcoord")
        if self.face is not None and isinstance(listed, tuple) and self.cuts is not None:
            values, lengths = listed
            corners = self.cuts.counts
            if (lengths == 2 * corners).all():
                index = self.cuts.triangles(np.arange(int(corners.sum()), dtype=np.int32))
                return values.reshape(-1, 2).astype(np.float64), index
            row = int(np.argmax(lengths != 2 * corners))
            raise self.error(f"element face: row {row}: texcoord", "two values a corner", str(lengths[row]))
        tables = (self._columns(*names, finite=False) for names in _UVS)
        return next((table for table in tables if table is not None), None), None


@dataclass(frozen=True)
class Property:
    """A property. kind: type of the values, such as f4. count: type of a list's length, empty for a scalar."""

    name: str
    kind: str
    count: str


class Stored(NamedTuple):
    """How the rows of an element hold a property. length: of a list, None for a scalar."""

    name: str
    kind: np.dtype
    length: struct.Struct | None


@dataclass
class Element:
    """An element of `rows` rows. columns: by property, (rows,) values, or (values, lengths) of lists, row by row."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)
    columns: dict[str, Any] = field(default_factory=dict)

    def has(self, *names: str) -> bool:
        """Return whether all these properties are there, as scalars."""
        return all(isinstance(self.columns.get(name), np.ndarray) for name in names)


class PlyFile:
    """The content of a PLY file. elements: by name. Values keep the file's types. Text is parsed to float64, and read like a
    binary file whose types are all float64.

    Raises InputError naming the line of the header, or the element and row, for any inconsistency.
    """

    def __init__(self, data: bytes, owner: str) -> None:
        self.data: bytes | memoryview = data
        self.owner, self.order = owner, "?"  # `<`, `>`, or `=` for text
        self.elements: dict[str, Element] = {}
        self.comments: list[str] = []
        if not re.match(rb"ply\s", data):
            raise self.error("magic", "a first line of ply", quoted(data[:8]))
        end = data.find(b"end_header", 0, MAX_HEADER)
        after = _LINE_END.match(data, end + len(b"end_header"))
        if end < 0 or after is None:
            raise self.error("header", f"end_header in the first {MAX_HEADER} bytes", "none")
        lines = data[:end].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
        self._read_header(lines)
        if self.order != "=":
            self._read_elements(after.end())
            return
        values = self._numbers(data, after.end(), len(lines))
        self.data = values.view(np.uint8).data
        count = self._read_elements(0) // values.itemsize
        if count != len(values):
            raise self.error("rows", f"{count} values, as the header says", str(len(values)))

    def error(self, where: str, expected: str, found: str) -> InputError:
        return file_error(self.owner, where, expected, found)

    def _read_header(self, lines: list[str]) -> None:
        names: list[str] = []
        element: Element | None = None
        for number, line in enumerate(lines[1:-1], 2):
            if not line.strip():
                continue
            keyword, *words = line.split()
            where, rest = f"line {number}: {keyword}", " ".join(words)
            if keyword in ("comment", "obj_info"):
                self.comments.append(line.strip()[len(keyword) :].strip())
            elif keyword == "format":
                if len(words) != 2 or words[0] not in _FORMATS or words[1] != "1.0":
                    raise self.error(where, f"one of {', '.join(_FORMATS)}, and the version 1.0", quoted(rest))
                self.order = _FORMATS[words[0]]
            elif keyword == "element":
                if len(words) != 2 or not re.fullmatch(r"[0-9]{1,18}", words[1]):
                    where, rows = f"{where} {' '.join(words[:1])[:32]}", quoted(" ".join(words[1:]))
                    raise self.error(where, "a name and a number of rows from 0", rows)
                names.append(words[0])
                element = self.elements[words[0]] = Element(words[0], int(words[1]))
            elif keyword == "property":
                if element is None:
                    raise self.error(where, "an element before it", "none")
                self._add_property(element, words, where)
            else:
                expected = "format, element, property, comment, obj_info or end_header"
                raise self.error(f"line {number}", expected, quoted(keyword))
        if self.order == "?":
            raise self.error("header", "a line of format", "none")
        for element in self.elements.values():
            lists = sum(bool(item.count) for item in element.properties)
            if lists > MAX_LISTS:
                raise self.error(f"element {element.name}", f"at most {MAX_LISTS} lists", str(lists))
        if len(self.elements) != len(names):
            raise self.error("header", "elements of different names", ", ".join(names)[:80])

    def _add_property(self, element: Element, words: list[str], where: str) -> None:
        listed = words[:1] == ["list"]
        if len(words) != (4 if listed else 2):
            raise self.error(where, "a type and a name, or list, two types and a name", quoted(" ".join(words)))
        *types, name = words[1:] if listed else words
        for word in types:
            if word not in _TYPES:
                raise self.error(where, f"one of the types {' '.join(_TYPES)}", quoted(word))
        if listed and _TYPES[types[0]][0] == "f":
            raise self.error(where, "a type of whole numbers for the length of a list", quoted(types[0]))
        if any(name == item.name for item in element.properties):
            raise self.error(where, f"properties of different names in element {element.name}", quoted(name))
        element.properties.append(Property(name, _TYPES[types[-1]], _TYPES[types[0]] if listed else ""))

    def _numbers(self, data: bytes, start: int, lines: int) -> Array:
        """Return the numbers of text from byte `start` on, after so many lines."""
        parts, body = [np.zeros(0)], start
        while start < len(data):
            end = data.find(b"\n", start + _CHUNK) + 1 or len(data)
            text = b" " + data[start:end]
            blank = is_blank(text)
            part = numbers(text, float, int(np.count_nonzero(blank[:-1] & ~blank[1:])))
            if part is None:
                bad = next((word for word in text.split() if numbers(word, float, 1) is None), b"")
                line = lines + data.count(b"\n", body, data.find(bad, start)) + 1
                raise self.error(f"line {line}", "numbers", quoted(bad))
            parts.append(part)
            start = end
        return np.concatenate(parts)

    def _read_elements(self, place: int) -> int:
        """Fill in the columns of all elements, whose rows begin at a byte. Returns the position after them."""
        for element in self.elements.values():
            items = []
            for item in element.properties:
                kind, count = ("f8", item.count and "f8") if self.order == "=" else (item.kind, item.count)
                length = struct.Struct(self.order + np.dtype(count).char) if count else None
                items.append(Stored(item.name, np.dtype(self.order + kind), length))
            row_size = sum(item.length.size if item.length else item.kind.itemsize for item in items)
            if element.rows * row_size > len(self.data) - place:
                expected = f"{element.rows} rows, of at least {self._amount(row_size)} each"
                content = f"{self._amount(len(self.data) - place)} left in the file"
                raise self.error(f"element {element.name}", expected, content)
            if element.rows and items:
                place = self._read_rows(place, element, items)
        return place

    def _amount(self, size: int) -> str:
        return f"{size // 8} values" if self.order == "=" else f"{size} bytes"

    def _read_rows(self, place: int, element: Element, items: list[Stored]) -> int:
        """Fill in the columns of an element: at once if all its rows have lists as long as the first, else after locating
        them one by one. Returns the position after them."""
        data, rows = self.data, element.rows
        starts, counts, end = self._located(place, element.name, items, 1)
        size = end - place
        is_even = size <= (len(data) - place) // rows
        for (_, _, length), start, count in zip(items, starts, counts, strict=True):
            if length is not None and is_even:
                lengths: Array = np.ndarray((rows,), length.format, data, int(start[0]) - length.size, (size,))
                is_even = bool((lengths == count).all())
        if is_even:
            end = place + rows * size
        else:
            starts, counts, end = self._located(place, element.name, items, rows)
        for (name, kind, length), start, count in zip(items, starts, counts, strict=True):
            if not is_even:
                values = _joined_runs(data, start, count * kind.itemsize).view(kind)
            elif length is not None:
                values = runs(data, int(start[0]), rows, size, kind, int(count[0])).reshape(-1)
            else:  # a view of the data: the only copy is made where the column is used
                values = np.ndarray((rows,), kind, data, int(start[0]), (size,))
            values = values.astype(kind.newbyteorder("="), copy=False)
            element.columns[name] = values if length is None else (values, np.broadcast_to(count, rows))
        return end

    def _located(self, place: int, name: str, items: list[Stored], rows: int) -> tuple[list[Array], list[Array], int]:
        """Return where the values of each property begin and their numbers, (rows,) each, and the position after them."""
        starts, counts = ([array("q") for _ in items] for _ in range(2))
        steps, data, total = [(kind.itemsize, length) for _, kind, length in items], self.data, len(self.data)
        for row in range(rows):
            for number, (size, length) in enumerate(steps):
                count: Any = 1
                if length is not None and place + length.size <= total:
                    (count,) = length.unpack_from(data, place)
                place += 0 if length is None else length.size
                if place > total or not 0 <= count * size <= total - place or count % 1:
                    where = f"element {name}: row {row}: {items[number].name}"
                    content = f"a length of {count:.10g}, and {self._amount(total - place)} left in the file"
                    content = "the end of the file" if place > total else content
                    raise self.error(where, "a length and as many values", content)
                starts[number].append(place)
                counts[number].append(int(count))
                place += int(count) * size
        return [np.frombuffer(k, np.int64) for k in starts], [np.frombuffer(k, np.int64) for k in counts], place


def _joined_runs(data: Any, start: Array, sizes: Array) -> Array:
    """Return the bytes of runs that follow each other, (R,) each, with two bytes of memory for each byte of data."""
    if not len(start):
        return np.zeros(0, np.uint8)
    first, last = int(start[0]), int(start[-1] + sizes[-1])
    changes = np.zeros(last - first + 1, np.int8)
    some = sizes > 0
    changes[start[some] - first] += 1
    np.subtract.at(changes, start[some] + sizes[some] - first, 1)
    mask = np.cumsum(changes[:-1], dtype=np.int8).view(bool)
    return np.asarray(np.frombuffer(data, np.uint8, last - first, first)[mask])
