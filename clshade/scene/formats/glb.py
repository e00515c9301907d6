"""A binary glTF 2.0 file while it is put together: its JSON, and the bytes that accessors and images name."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, replacing
from ...base.input_files import file_error

MOST_BYTES = (1 << 32) - 1  # of a GLB file, whose lengths have 32 bits
VERTICES, INDICES = 34962, 34963  # targets of buffer views
_COMPONENTS = {"uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class Glb:
    """Lists of JSON objects by name, and one binary chunk. The same calls give the same bytes."""

    def __init__(self) -> None:
        self.lists: dict[str, list[dict[str, Any]]] = {}
        self.extensions: dict[str, dict[str, Any]] = {}
        self.used: set[str] = set()
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Append an object to a list such as `meshes`, and return its index."""
        entries = self.lists.setdefault(kind, [])
        entries.append(entry)
        return len(entries) - 1

    def shared(self, kind: str, entry: dict[str, Any]) -> int:
        """Return the index of an equal object in a list; append the object if there is none."""
        entries = self.lists.get(kind, [])
        return entries.index(entry) if entry in entries else self.add(kind, entry)

    def use(self, extension: str, entry: dict[str, Any]) -> dict[str, Any]:
        """Note that the file uses an extension; return the `extensions` of an object, {extension: entry}."""
        self.used.add(extension)
        return {extension: entry}

    def view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes, from a multiple of four on, and return the index of their buffer view."""
        padding = bytes(-self._length % 4)
        start = self._length + len(padding)
        self._parts += [padding, data]
        self._length = start + len(data)
        entry = {"buffer": 0, "byteOffset": start, "byteLength": len(data)}
        return self.add("bufferViews", entry if target is None else {**entry, "target": target})

    def accessor(self, values: Array, target: int = VERTICES, *, extent: bool = False) -> int:
        """Append an array, (K,) or (K, 2 to 4), of uint16, uint32 or float32. extent: with the least and the largest of
        each column, which positions need."""
        columns = values.reshape(len(values), -1)
        little = np.ascontiguousarray(columns, columns.dtype.newbyteorder("<"))
        entry = {
            "bufferView": self.view(little.tobytes(), target),
            "componentType": _COMPONENTS[values.dtype.name],
            "count": len(values),
            "type": _TYPES[columns.shape[1]],
        }
        if extent:
            entry |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def write(self, path: Path, owner: str) -> None:
        """Write the file atomically. Raises InputError, naming `owner`, for one of 4 GiB or more and for numbers beyond
        float64, OutputError if it cannot be written."""
        document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "clshade"}}
        if self.used:
            document["extensionsUsed"] = sorted(self.used)
        if self.extensions:
            document["extensions"] = self.extensions
        document |= {"scene": 0, **self.lists}
        length = self._length + -self._length % 4
        if length:
            document["buffers"] = [{"byteLength": length}]
        try:
            text = json.dumps(document, allow_nan=False, separators=(",", ":")).encode("ascii")
        except ValueError:
            raise file_error(owner, "scene", "materials and lights within the range of float64", "others") from None
        text += b" " * (-len(text) % 4)
        whole = 12 + 8 + len(text) + (8 + length if length else 0)
        if whole > MOST_BYTES:
            raise file_error(owner, "scene", f"a file of at most {MOST_BYTES} bytes", f"{whole} bytes")
        with replacing(path) as file:
            file.write(struct.pack("<4sII", b"glTF", 2, whole))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            if length:
                file.write(struct.pack("<I4s", length, b"BIN\0"))
                for part in self._parts:
                    file.write(part)
                file.write(bytes(length - self._length))
