"""Scene files of clshade's own: reading. `scene_json_writer` has the format, and writes it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import MISSING, fields
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import beside, file_error, quoted, read_file, size_of, stamp, within
from ...base.json_values import found_text, parse_text
from ...base.spelling import hint
from ...base.validation import set_fields
from ...errors import InputError
from ..camera import Camera
from ..environment import Environment
from ..lights import LIGHTS
from ..model import Material, Mesh, MetallicRoughness, Scene, Texture
from .options import Options
from .scene_json_writer import FORMAT, MAX_BINARY_BYTES, MAX_BYTES, SHARED, TYPES, VERSION

_PARTS: dict[str, type] = {"camera": Camera, "environment": Environment, "pbr": MetallicRoughness}
_TABLES: dict[str, type] = {"textures": Texture, "materials": Material}  # materials name textures, which are read first
_KINDS: dict[str, type] = {kind.__name__: kind for kind in LIGHTS}
_KEYS = ("format", "version", "scene", *_TABLES, "arrays")
_ARRAY, _BINARY = ("type", "shape", "offset"), ("file", "bytes", "sha256")
_DEEPEST = 4  # nested lists
_LONGEST = (1 << 30) - 1  # side of an array
_SAME = 2.0**-50  # two unit vectors that differ by less are one, normalized once and twice


def read_scene(path: Path, options: Options) -> Scene:
    """Read a scene file that `Scene.to_json` wrote, or a person.

    Raises InputError, one line with the file and the place in it, for an unknown version, an unknown, missing or repeated
    key, a value that the scene's classes refuse, and a file of arrays that is missing, outside the folder, or another
    than the one that was written.
    """
    while True:
        before = stamp(path)
        try:
            return options.applied(_scene_of(read_file(path, MAX_BYTES), path))
        except InputError:
            if stamp(path) == before:
                raise
            # Another process has replaced it, and removed the arrays of the earlier one.


def _scene_of(text: bytes, path: Path) -> Scene:
    owner = shown(path)
    document = parse_text(text, owner, "a scene file", unique=True)
    found = document.get("format") if isinstance(document, dict) else document
    if not isinstance(document, dict) or found != FORMAT:
        raise file_error(owner, "format", repr(FORMAT), found_text(found))
    version = document.get("version")
    if isinstance(version, bool) or version != VERSION:
        raise file_error(owner, "version", str(VERSION), found_text(version))
    reader = _Reader(owner, path)
    reader.check_keys(document, _KEYS, "", required=("scene",))
    return reader.scene(document)


class _Reader:
    """Makes the objects of one file. `where` is a place in it, such as scene.meshes[0].verts."""

    def __init__(self, owner: str, path: Path) -> None:
        self.owner, self.path = owner, path
        self._tables: dict[str, list[Any]] = {name: [] for name in _TABLES}
        self._data = b""
        self._arrays: dict[tuple[str, tuple[int, ...], int], Array] = {}

    def error(self, where: str, expected: str, found: str) -> InputError:
        return file_error(self.owner, where, expected, found)

    def check_keys(
        self, value: Any, known: Iterable[str], where: str, required: Iterable[str] | None = None
    ) -> dict[str, Any]:
        """Return an object that has known keys only, and the required ones (default: all)."""
        known = tuple(known)
        if not isinstance(value, dict):
            raise self.error(where, "an object", found_text(value))
        for key in value:
            if key not in known:
                found = f"{quoted(key)}{hint(key, known)}"
                raise self.error(where or "keys", f"one of {', '.join(known)}", found)
        for key in known if required is None else required:
            if key not in value:
                raise self.error(f"{where}.{key}" if where else key, "this key", "none")
        return value

    def scene(self, document: dict[str, Any]) -> Scene:
        self._data = self._binary(document.get("arrays"))
        for name, kind in _TABLES.items():
            entries = self._list(document.get(name, []), name)
            self._tables[name] = [self._made(kind, entry, f"{name}[{k}]") for k, entry in enumerate(entries)]
        scene: Scene = self._made(Scene, document["scene"], "scene")
        return scene

    def _binary(self, value: Any) -> bytes:
        """Return the content of the file with the arrays, checked; nothing if there is none."""
        if value is None:
            return b""
        facts = self.check_keys(value, _BINARY, "arrays")
        reference, digest = facts["file"], facts["sha256"]
        for key, text in (("file", reference), ("sha256", digest)):
            if not isinstance(text, str):
                raise self.error(f"arrays.{key}", "a text", found_text(text))
        size = self._whole(facts["bytes"], "arrays.bytes", MAX_BINARY_BYTES)
        path = beside(self.path, reference, self.owner, "arrays.file")
        if path is None:
            raise self.error("arrays.file", "an existing file", f"no file {quoted(reference)}")
        if size_of(path) != size:
            raise self.error("arrays.bytes", f"{size} bytes in {quoted(reference)}", f"{size_of(path)}")
        data = read_file(path, size)
        actual = hashlib.sha256(data).hexdigest()
        if actual != digest.lower():
            raise self.error("arrays.sha256", f"{quoted(digest, 64)} of {quoted(reference)}", quoted(actual, 64))
        return data

    def _made(self, kind: type, value: Any, where: str) -> Any:
        """Return an instance of a dataclass, whose own checks say what its fields may be."""
        own = fields(kind)
        needed = [each.name for each in own if each.default is MISSING and each.default_factory is MISSING]
        self.check_keys(value, [each.name for each in own], where, needed)
        given = {name: self._field(name, each, f"{where}.{name}") for name, each in value.items()}
        with within(f"{self.owner}: {where}"):
            made = kind(**given)
        if isinstance(made, Environment) and "up" in given:
            # Restore the bits of a unit vector, which normalizing it again may change.
            up = np.array(given["up"], np.float64).reshape(3)
            if np.abs(up - made.up).max() <= _SAME:
                up.flags.writeable = False
                set_fields(made, up=up)
        return made

    def _field(self, name: str, value: Any, where: str) -> Any:
        if value is None:
            return None
        if name in SHARED:
            table = self._tables[SHARED[name]]
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < len(table):
                raise self.error(where, f"an index of the {len(table)} {SHARED[name]}, from 0", found_text(value))
            return table[value]
        if name in _PARTS:
            return self._made(_PARTS[name], value, where)
        if name == "meshes":
            return [self._made(Mesh, each, f"{where}[{k}]") for k, each in enumerate(self._list(value, where))]
        if name == "lights":
            return [self._light(each, f"{where}[{k}]") for k, each in enumerate(self._list(value, where))]
        if name == "scalars":
            if not isinstance(value, dict):
                raise self.error(where, "an object", found_text(value))
            return {key: self._plain(each, f"{where} {quoted(key)}") for key, each in value.items()}
        return self._plain(value, where)

    def _light(self, value: Any, where: str) -> Any:
        kind = value.get("kind") if isinstance(value, dict) else None
        if not isinstance(kind, str) or kind not in _KINDS:
            raise self.error(f"{where}.kind", f"one of {', '.join(_KINDS)}", found_text(kind) + hint(kind, _KINDS))
        return self._made(_KINDS[kind], {key: each for key, each in value.items() if key != "kind"}, where)

    def _plain(self, value: Any, where: str, depth: int = 0) -> Any:
        """Return a number, a text, a truth value, an array, or a list of such."""
        if isinstance(value, dict):
            return self._array(self.check_keys(value, _ARRAY, where), where)
        if not isinstance(value, list):
            if isinstance(value, bool) and depth:
                raise self.error(where, "a list of numbers or texts", found_text(value))
            return value
        if depth == _DEEPEST:
            raise self.error(where, f"at most {_DEEPEST} lists in each other", "more")
        return [self._plain(each, where, depth + 1) for each in value]

    def _array(self, value: dict[str, Any], where: str) -> Array:
        name, size = value["type"], len(self._data)
        if not isinstance(name, str) or name not in TYPES:
            raise self.error(f"{where}.type", f"one of {', '.join(TYPES)}", found_text(name) + hint(name, TYPES))
        shape = tuple(self._whole(n, f"{where}.shape", _LONGEST) for n in self._list(value["shape"], f"{where}.shape"))
        offset = self._whole(value["offset"], f"{where}.offset", size)
        kind = np.dtype(name).newbyteorder("<")
        count = math.prod(shape)
        if not 1 <= len(shape) <= 3 or offset % kind.itemsize or offset + count * kind.itemsize > size:
            found = f"shape {list(shape)} at byte {offset}"
            raise self.error(where, f"1 to 3 dimensions of whole values within {size} bytes", found)
        key = name, shape, offset
        if key not in self._arrays:
            array = np.frombuffer(self._data, kind, count, offset) if count else np.zeros(0, kind)
            self._arrays[key] = array.astype(kind.newbyteorder("="), copy=False).reshape(shape)
        return self._arrays[key]

    def _whole(self, value: Any, where: str, most: int) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise self.error(where, f"a whole number from 0 to {most}", found_text(value))
        return value

    def _list(self, value: Any, where: str) -> list[Any]:
        if not isinstance(value, list):
            raise self.error(where, "a list", found_text(value))
        return value
