"""The binary data of a glTF file: container, buffers and accessors, each checked against the bytes that are there."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import re
import struct
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import beside, file_error, quoted, read_file
from ...errors import InputError
from .gltf_json import Item, parse

MAX_BYTES = 1 << 31  # of a file
MAX_ROWS = 1 << 26  # of an accessor
MAX_EMPTY = 1 << 24  # rows of an accessor without data, which means zeros

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_MOST_CHUNKS = 64  # that are looked at
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def open_gltf(path: Path) -> tuple[Item, Buffers]:
    """Open a glTF file and return its JSON and its buffers. Raises InputError for a broken container."""
    owner = shown(path)
    data = read_file(path, MAX_BYTES)
    binary = None
    if data[:4] == b"glTF":
        text, binary = _chunks(data, owner)
    elif os.path.splitext(os.fspath(path))[1].lower() == ".glb":
        raise file_error(owner, "magic", "b'glTF' at the start of a GLB file", repr(data[:4]))
    else:
        text = memoryview(data)
    document = parse(bytes(text).rstrip(b"\0 "), owner)  # exporters pad with NULs too, not with blanks alone
    return document, Buffers(document, path, binary)


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
    found: list[tuple[int, memoryview]] = []
    while offset + 8 <= length and len(found) < _MOST_CHUNKS and (not found or found[-1][0] != _BIN):
        size, kind = struct.unpack_from("<II", data, offset)
        if size > length - offset - 8:
            expected = f"at most the {length - offset - 8} bytes left"
            raise file_error(owner, f"GLB chunk {len(found)} length", expected, str(size))
        found.append((kind, view[offset + 8 : offset + 8 + size]))
        offset += 8 + size
        if data[offset + 4 : offset + 8] != b"BIN\0":
            offset += -offset % 4  # exporters leave the padding out of the length
    if not found or found[0][0] != _JSON:
        raise file_error(owner, "GLB chunk 0 type", "JSON", "another" if found else "no chunk")
    return found[0][1], found[-1][1] if found[-1][0] == _BIN else None


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


class Buffers:
    """Buffers, buffer views and accessors of a glTF document by index; each is read on first use.

    document: its JSON. path: of the file. binary: the binary chunk of a GLB file.
    """

    def __init__(self, document: Item, path: Path, binary: memoryview | None) -> None:
        self.document, self.path, self.binary = document, path, binary
        self._buffers: dict[int, memoryview] = {}
        self._files: dict[str, memoryview] = {}
        self._arrays: dict[tuple[int, bool], Array] = {}

    def buffer(self, index: int) -> memoryview:
        if index in self._buffers:
            return self._buffers[index]
        item = self.document.entry("buffers", index)
        length = item.integer("byteLength", least=1)
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
        found = hashlib.sha256(json.dumps(self.document.value).encode())
        for index in range(self.document.count("buffers")):
            with contextlib.suppress(InputError):  # then nothing can use it
                found.update(b"%d " % index + hashlib.sha256(self.buffer(index)).digest())
        return found.hexdigest()

    def _loaded(self, item: Item) -> memoryview:
        text = item.text("uri")
        if text.startswith("data:"):
            return data_of(item, text)
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:", text):
            raise item.error("uri", "a file in the scene's folder, or data (nothing is fetched)", quoted(text))
        where = item.owner, f"{item.where}.uri"
        path = beside(self.path, unquote(text), *where) or beside(self.path, text, *where)
        if path is None:
            raise item.error("uri", "a file in the scene's folder", f"no file {quoted(text)}")
        if path not in self._files:
            self._files[path] = memoryview(read_file(path, MAX_BYTES))
        return self._files[path]

    def view(self, index: int) -> tuple[memoryview, int]:
        """Return the bytes of a buffer view, and its stride or 0."""
        item = self.document.entry("bufferViews", index)
        buffer = item.reference("buffer", "buffers")
        if buffer is None:
            raise item.error("buffer", "an index", "none")
        try:
            data = self.buffer(buffer)
        except InputError:  # the fallback of compressed data, which may be left out
            item.refuse_extensions()
            raise
        offset, length = item.integer("byteOffset", 0), item.integer("byteLength", least=1)
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
        count = item.integer("count", least=1)
        dtype, width = self._component(item), _WIDTHS.get(item.text("type"), 0)
        if not width:
            raise item.error("type", "one of " + ", ".join(_WIDTHS), quoted(item.text("type")))
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

    def _component(self, item: Item) -> np.dtype:
        name = _COMPONENTS.get(item.integer("componentType"))
        if name is None:
            expected = "one of " + ", ".join(map(str, _COMPONENTS))
            raise item.error("componentType", expected, str(item.integer("componentType")))
        return np.dtype(name)

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
        count, parts = sparse.integer("count", least=1), []
        if count > len(values):
            raise sparse.error("count", f"at most {len(values)}", str(count))
        for key, width in (("indices", 1), ("values", values.shape[1])):
            part = sparse.item(key)
            view = None if part is None else part.reference("bufferView", "bufferViews")
            if part is None or view is None:
                raise sparse.error(f"{key}.bufferView", "an index", "none")
            kind = self._component(part) if key == "indices" else dtype
            parts.append(self._strided(part, view, count, width, kind))
        where = parts[0][:, 0]
        if where.dtype.kind != "u" or where.max() >= len(values):
            raise sparse.error("indices", f"indices below {len(values)}", str(where.max()))
        values[where] = parts[1]
