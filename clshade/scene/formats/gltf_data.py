"""The JSON and the binary data of a glTF file: container, buffers and accessors, each checked against the bytes that are
there. Every value is checked where it is used.

Own checks instead of msgspec's structs: exporters write indices as 3.0, byte order marks and halves of surrogate pairs,
which msgspec refuses; glTF forbids duplicate keys, which it accepts; a message names the value; and what a scene does not
use may be broken.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import math
import os
import re
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import beside, file_error, quoted, read_file
from ...base.json_values import found_text, parse_text
from ...errors import InputError

MAX_BYTES = 1 << 31  # of a file
MAX_ROWS = 1 << 26  # of an accessor
MAX_EMPTY = 1 << 24  # rows of an accessor without data, which means zeros

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_MAX_CHUNKS = 64  # that are looked at
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


@dataclass(eq=False)  # frozen ones take three times as long to make, and large files have millions
class Item:
    """A JSON object and its place in the file: `where` is a path such as meshes[0].primitives[1]."""

    value: dict[str, Any]
    where: str
    file: GltfData

    def path(self, key: str) -> str:
        """Return the place of a field of this object in the file."""
        return f"{self.where}.{key}" if self.where and key else self.where or key

    def error(self, key: str, expected: str, found: str) -> InputError:
        return file_error(self.file.owner, self.path(key), expected, found)

    def check_rows(self, key: str, good: Array, expected: str, values: Array) -> None:
        """Raise InputError for the first row that is not all `good` (n, ...), with its values (n, ...)."""
        if not good.all():
            row = int(np.argmin(good.reshape(len(good), -1).all(axis=1)))
            place = f" of accessors[{self.value[key]}]" if key in self.value else ""
            raise self.error(key, expected, f"{str(values[row].tolist())[:100]} in row {row}{place}")

    def integer(self, key: str, default: int | None = None, minimum: int = 0) -> int:
        """Return an integer. Raises InputError for anything else, and if it is missing without a default."""
        value = self.value.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value < 1 << 53:
            raise self.error(key, f"a whole number of at least {minimum}", found_text(value))
        return value

    def number(self, key: str, default: float | None = None, minimum: float = -math.inf) -> float:
        """Return a finite number. Raises InputError for anything else, and if it is missing without a default."""
        value = self.value.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not minimum <= value <= 1e300:
            expected = "a finite number" + (f" of at least {minimum:g}" if minimum > -math.inf else "")
            raise self.error(key, expected, found_text(value))
        return float(value)

    def numbers(self, key: str, length: int, default: Any = None) -> Array:
        """Return (length,) finite float64 numbers."""
        value = self.value.get(key, default)
        expected = f"{length} finite numbers"
        if not isinstance(value, (list, tuple)) or len(value) != length:
            raise self.error(key, expected, found_text(value))
        for number in value:
            if isinstance(number, bool) or not isinstance(number, (int, float)) or not abs(number) <= 1e300:
                raise self.error(key, expected, found_text(number))
        return np.array(value, np.float64)

    def text(self, key: str, default: str = "") -> str:
        value = self.value.get(key, default)
        if not isinstance(value, str):
            raise self.error(key, "text", found_text(value))
        return value.encode("utf-8", "replace").decode("utf-8")

    def choice(self, key: str, allowed: Collection[Any], default: Any = None) -> Any:
        """Return one of the allowed texts, or whole numbers."""
        is_text = isinstance(next(iter(allowed)), str)
        value: Any = self.text(key, default or "") if is_text else self.integer(key, default)
        if value not in allowed:
            raise self.error(key, "one of " + ", ".join(map(str, allowed)), quoted(value) if is_text else str(value))
        return value

    def item(self, key: str) -> Item | None:
        """Return the object of that name, or None if there is none."""
        return self.part(key) if key in self.value else None

    def part(self, key: str) -> Item:
        """Return the object of that name, an empty one if there is none."""
        return self._at(self.value.get(key, {}), self.path(key))

    def items(self, key: str) -> Iterator[Item]:
        """Yield the objects of a list, which may be missing."""
        for index, value in enumerate(self.values(key)):
            yield self._at(value, f"{self.path(key)}[{index}]")

    def values(self, key: str) -> list[Any]:
        """Return a list, which may be missing."""
        values = self.value.get(key, [])
        if not isinstance(values, list):
            raise self.error(key, "a list", found_text(values))
        return values

    def extension(self, name: str) -> Item | None:
        return self.part("extensions").item(name)

    def refuse_extensions(self) -> None:
        """Raise InputError if this object, whose data is not in the file, has extensions, which then hold it."""
        extensions = self.part("extensions").value
        if extensions:
            expected = "geometry that needs no extension (export it without compression)"
            raise self.error("extensions", expected, quoted(", ".join(extensions)))

    def reference(self, key: str, kind: str) -> int | None:
        """Return the index, in range, that a field holds into the file's list `kind`; None if the field is missing."""
        if key not in self.value:
            return None
        index, count = self.integer(key), self.count(kind)
        if index >= count:
            raise self.error(key, f"an index of the {count} {kind}", str(index))
        return index

    def index(self, key: str, kind: str) -> int:
        """Return an index as `reference` does. Raises InputError if the field is missing, too."""
        index = self.reference(key, kind)
        if index is None:
            raise self.error(key, "an index", "none")
        return index

    def references(self, key: str, kind: str) -> list[int]:
        """Return the indices, in range, of a field that holds a list of them."""
        count, indices = self.count(kind), self.values(key)
        for index in indices:
            if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < count:
                raise self.error(key, f"indices of the {count} {kind}", found_text(index))
        return indices

    def accessor(self, key: str, expected: str, fits: Callable[[Array], bool], *, normalized: bool = True) -> Array:
        """Return the numbers of the accessor that a field names, see `GltfData.array`, if they fit what is expected."""
        index = self.index(key, "accessors")
        values = self.file.array(index, normalized=normalized)
        if not fits(values):
            content = f"{values.shape[0]} of {values.shape[1]} {values.dtype} in accessors[{index}]"
            raise self.error(key, expected, content)
        return values

    def entry(self, kind: str, index: int) -> Item:
        """Return the object at an index that is in range of the file's list `kind`."""
        return self._at(self.file.document.value[kind][index], f"{kind}[{index}]")

    def count(self, kind: str) -> int:
        """Return the length of one of the file's lists."""
        return len(self.file.document.values(kind))

    def _at(self, value: Any, where: str) -> Item:
        if not isinstance(value, dict):
            raise file_error(self.file.owner, where, "an object", found_text(value))
        return Item(value, where, self.file)


def open_gltf(path: Path) -> GltfData:
    """Open a glTF file. Raises InputError for a broken container."""
    owner = shown(path)
    data = read_file(path, MAX_BYTES)
    binary = None
    if data[:4] == b"glTF":
        text, binary = _chunks(data, owner)
    elif os.path.splitext(os.fspath(path))[1].lower() == ".glb":
        raise file_error(owner, "magic", "b'glTF' at the start of a GLB file", repr(data[:4]))
    else:
        text = memoryview(data)
    # Exporters pad with NULs too, not with blanks alone. glTF forbids duplicate keys.
    value = parse_text(bytes(text).rstrip(b"\0 "), owner, "a glTF document", unique=True)
    if not isinstance(value, dict):
        raise file_error(owner, "JSON", "an object", found_text(value))
    return GltfData(path, value, binary)


def _chunks(data: bytes, owner: str) -> tuple[memoryview, memoryview | None]:
    """Return the JSON chunk of a GLB file and its binary chunk, if any."""
    if len(data) < 20:
        raise file_error(owner, "GLB header", "at least 20 bytes", f"{len(data)} bytes")
    _, version, length = struct.unpack_from("<4sII", data)
    if version != 2:
        raise file_error(owner, "GLB version", "2", str(version))
    if not 20 <= length <= len(data):
        raise file_error(owner, "GLB length", f"at most the {len(data)} bytes of the file", str(length))
    view, offset = memoryview(data), 12
    chunks: list[tuple[int, memoryview]] = []
    while offset + 8 <= length and len(chunks) < _MAX_CHUNKS and (not chunks or chunks[-1][0] != _BIN):
        size, kind = struct.unpack_from("<II", data, offset)
        if size > length - offset - 8:
            expected = f"at most the {length - offset - 8} bytes left"
            raise file_error(owner, f"GLB chunk {len(chunks)} length", expected, str(size))
        chunks.append((kind, view[offset + 8 : offset + 8 + size]))
        offset += 8 + size
        if data[offset + 4 : offset + 8] != b"BIN\0":
            offset += -offset % 4  # exporters leave the padding out of the length
    if not chunks or chunks[0][0] != _JSON:
        raise file_error(owner, "GLB chunk 0 type", "JSON", "another" if chunks else "no chunk")
    return chunks[0][1], chunks[-1][1] if chunks[-1][0] == _BIN else None


def data_of(item: Item, uri: str) -> memoryview:
    """Return the bytes of a data URI."""
    head, comma, body = uri.partition(",")
    data = unquote_to_bytes(body)
    try:
        if not comma:
            raise ValueError
        return memoryview(base64.b64decode(b"".join(data.split()), validate=True) if head.endswith(";base64") else data)
    except ValueError:
        raise item.error("uri", "a data URI", quoted(uri)) from None


class GltfData:
    """A glTF file: its JSON, and buffers, buffer views and accessors by index; each is read on first use.

    binary: the binary chunk of a GLB file. ignored: collects a few words for each feature of the file that is not rendered.
    """

    def __init__(self, path: Path, document: dict[str, Any], binary: memoryview | None) -> None:
        self.path, self.owner, self.binary = path, shown(path), binary
        self._document = document
        self.ignored: list[str] = []
        self._buffers: dict[int, memoryview] = {}
        self._files: dict[str, memoryview] = {}
        self._arrays: dict[tuple[int, bool], Array] = {}

    @property
    def document(self) -> Item:  # made anew: kept, it would be a cycle that holds the file's bytes
        return Item(self._document, "", self)

    def buffer(self, index: int) -> memoryview:
        if index in self._buffers:
            return self._buffers[index]
        item = self.document.entry("buffers", index)
        length = item.integer("byteLength", minimum=1)
        if "uri" in item.value:
            data = self._loaded(item)
        elif index == 0 and self.binary is not None:
            data = self.binary
        else:
            raise item.error("uri", "a file, or the binary chunk of a GLB file", "none")
        if length > len(data):
            raise item.error("byteLength", f"at most the {len(data)} bytes that are there", str(length))
        self._buffers[index] = data[:length]
        return self._buffers[index]

    def digest(self) -> str:
        """Return a digest of the document and of all buffers that can be read."""
        digest = hashlib.sha256(json.dumps(self.document.value).encode())
        for index in range(self.document.count("buffers")):
            with contextlib.suppress(InputError):  # then nothing can use it
                digest.update(b"%d " % index + hashlib.sha256(self.buffer(index)).digest())
        return digest.hexdigest()

    def _loaded(self, item: Item) -> memoryview:
        text = item.text("uri")
        if text.startswith("data:"):
            return data_of(item, text)
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text):
            raise item.error("uri", "a file in the scene's folder, or data (nothing is fetched)", quoted(text))
        where = self.owner, item.path("uri")
        path = beside(self.path, unquote(text), *where) or beside(self.path, text, *where)
        if path is None:
            raise item.error("uri", "a file in the scene's folder", f"no file {quoted(text)}")
        if path not in self._files:
            self._files[path] = memoryview(read_file(path, MAX_BYTES))
        return self._files[path]

    def view(self, index: int) -> tuple[memoryview, int]:
        """Return the bytes of a buffer view, and its stride or 0."""
        item = self.document.entry("bufferViews", index)
        buffer = item.index("buffer", "buffers")
        try:
            data = self.buffer(buffer)
        except InputError:  # the fallback of compressed data, which may be left out
            item.refuse_extensions()
            raise
        offset, length = item.integer("byteOffset", 0), item.integer("byteLength", minimum=1)
        if offset + length > len(data):
            expected = f"byteOffset + byteLength of at most the {len(data)} bytes of buffers[{buffer}]"
            raise item.error("byteLength", expected, str(offset + length))
        return data[offset : offset + length], item.integer("byteStride", 0)

    def check_data(self, user: Item, index: int | None) -> None:
        """Raise InputError if an extension of an accessor or of its user holds the data that the accessor does not."""
        item = None if index is None else self.document.entry("accessors", index)
        if item is not None and not {"bufferView", "sparse"} & item.value.keys():
            user.refuse_extensions()
            item.refuse_extensions()

    def array(self, index: int, *, normalized: bool = True) -> Array:
        """Return (count, width) numbers of an accessor, as they are stored, in native byte order; read-only.

        normalized: convert normalized integers, which stand for [0, 1] or [-1, 1], to float32.
        Raises InputError for an accessor that reaches beyond its bytes, or of an unknown type.
        """
        if (index, normalized) not in self._arrays:
            item = self.document.entry("accessors", index)
            values = self._read(item)
            if normalized and item.value.get("normalized") is True and values.dtype.kind in "iu":
                values = np.maximum(values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max), np.float32(-1))
            values.flags.writeable = False
            self._arrays[index, normalized] = values
        return self._arrays[index, normalized]

    def _read(self, item: Item) -> Array:
        count = item.integer("count", minimum=1)
        dtype = np.dtype(_COMPONENTS[item.choice("componentType", _COMPONENTS)])
        width = _WIDTHS[item.choice("type", _WIDTHS)]
        view = item.reference("bufferView", "bufferViews")
        if view is None:
            if count > MAX_EMPTY:
                raise item.error("count", f"at most {MAX_EMPTY} without a bufferView", str(count))
            values = np.zeros((count, width), dtype.newbyteorder("="))
        else:
            values = self._strided(item, view, count, width, dtype)
        sparse = item.item("sparse")
        if sparse is not None:
            self._put(sparse, values, dtype)
        return values

    def _strided(self, item: Item, view: int, count: int, width: int, dtype: np.dtype) -> Array:
        """Return (count, width) numbers copied from a buffer view."""
        data, stride = self.view(view)
        size, offset = width * dtype.itemsize, item.integer("byteOffset", 0)
        stride = stride or size
        if stride < size:
            raise item.error("bufferView", f"a byteStride of at least {size}", str(stride))
        if count > MAX_ROWS or offset + stride * (count - 1) + size > len(data):
            expected = f"rows of {size} bytes that fit into the {len(data)} bytes of bufferViews[{view}]"
            raise item.error("count", expected, f"{count} from byte {offset} on")
        rows: Array = np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
        return rows.astype(dtype.newbyteorder("="), order="C")

    def _put(self, sparse: Item, values: Array, dtype: np.dtype) -> None:
        """Replace the rows that a sparse accessor lists."""
        count, parts = sparse.integer("count", minimum=1), []
        if count > len(values):
            raise sparse.error("count", f"at most {len(values)}", str(count))
        for key, width in (("indices", 1), ("values", values.shape[1])):
            part = sparse.part(key)
            view = part.index("bufferView", "bufferViews")
            kind = np.dtype(_COMPONENTS[part.choice("componentType", _COMPONENTS)]) if key == "indices" else dtype
            parts.append(self._strided(part, view, count, width, kind))
        where = parts[0][:, 0]
        if where.dtype.kind != "u" or where.max() >= len(values):
            raise sparse.error("indices", f"indices below {len(values)}", str(where.max()))
        values[where] = parts[1]
