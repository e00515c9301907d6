"""Scene files of clshade's own: one JSON text, and beside it one binary file with the large arrays.

Reader and writer take the fields of the model's dataclasses as they are, so that a new field needs no word here.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import LEFT_SECONDS, Path, folder_locked, naming, replacing_all, shown
from ...base.input_files import beside, file_error, quoted, read_file, size_of, stamp, within
from ...base.json_values import MAX_VALUES, found_text, parse_text
from ...base.spelling import hint
from ...base.validation import path as checked_path
from ...base.validation import read_only, value_error
from ...errors import InputError
from ..camera import Camera
from ..environment import Environment
from ..lights import LIGHTS
from ..material import MAPS
from ..model import Material, Mesh, MetallicRoughness, Scene, Texture
from .reading import Options

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FORMAT = "clshade scene"
VERSION = 1
ENDING = ".json"
MAX_BYTES = 1 << 28  # of the JSON file
MAX_BINARY_BYTES = 1 << 35  # two textures of the largest size
TYPES = ("float32", "float64", "int32")  # of arrays in the binary file, little-endian
ALIGNMENT = 64  # bytes
INLINE = 16  # numbers of an array in the text, such as a 4x4 matrix

_TABLES: dict[str, type] = {"textures": Texture, "materials": Material}  # materials name textures, which are read first
# Fields that hold an object of a table, and the table's name: what is shared in the scene is shared in the file.
_SHARED = {"material": "materials", "texture": "textures", **dict.fromkeys(MAPS, "textures")}
_PARTS: dict[str, type] = {"camera": Camera, "environment": Environment, "pbr": MetallicRoughness}
_KINDS: dict[str, type] = {kind.__name__: kind for kind in LIGHTS}
_KEYS = ("format", "version", "scene", *_TABLES, "arrays")
_MAX_DEPTH = 4  # nested lists
_MAX_SIDE = (1 << 30) - 1  # side of an array
_SAME = 2.0**-50  # two unit vectors that differ by less are one, normalized once and twice
_WIDTH = 110  # characters of a line, where an object or a list fits into one


def read_scene(path: Path, options: Options) -> Scene:
    """Read a scene file that `Scene.to_json` wrote, or a person.

    Raises InputError, one line with the file and the place in it, for an unknown version, an unknown, missing or repeated
    key, a value that the scene's classes refuse, and a file of arrays that is missing, outside the folder, or another
    than the one that was written.
    """
    while True:
        before = stamp(path)
        try:
            return options.applied(_Reader(shown(path), path).scene(read_file(path, MAX_BYTES)))
        except InputError:
            if stamp(path) == before:
                raise
            # Another process has replaced it, and removed the arrays of the earlier one.


class _Reader:
    """Makes the objects of one file. `where` is a place in it, such as scene.meshes[0].verts."""

    def __init__(self, owner: str, path: Path) -> None:
        self.owner, self.path = owner, path
        self._tables: dict[str, list[Any]] = {name: [] for name in dict.fromkeys(_SHARED.values())}
        self._data = b""
        self._arrays: dict[tuple[str, tuple[int, ...], int], Array] = {}

    def error(self, where: str, expected: str, found: str) -> InputError:
        return file_error(self.owner, where, expected, found)

    def check_keys(
        self, value: Any, allowed: Sequence[str], where: str, required: Sequence[str] | None = None
    ) -> dict[str, Any]:
        """Return an object that has allowed keys only, and the required ones (default: all)."""
        if not isinstance(value, dict):
            raise self.error(where, "an object", found_text(value))
        for key in value:
            if key not in allowed:
                wrong = f"{quoted(key)}{hint(key, allowed)}"
                raise self.error(where or "keys", f"one of {', '.join(allowed)}", wrong)
        for key in allowed if required is None else required:
            if key not in value:
                raise self.error(f"{where}.{key}" if where else key, "this key", "none")
        return value

    def scene(self, text: bytes) -> Scene:
        document = parse_text(text, self.owner, "a scene file", unique=True)
        form = document.get("format") if isinstance(document, dict) else document
        if not isinstance(document, dict) or form != FORMAT:
            raise self.error("format", repr(FORMAT), found_text(form))
        version = document.get("version")
        if isinstance(version, bool) or version != VERSION:
            raise self.error("version", str(VERSION), found_text(version))
        self.check_keys(document, _KEYS, "", required=("scene",))
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
        facts = self.check_keys(value, ("file", "bytes", "sha256"), "arrays")
        for key in ("file", "sha256"):
            if not isinstance(facts[key], str):
                raise self.error(f"arrays.{key}", "a text", found_text(facts[key]))
        reference, digest = facts["file"], facts["sha256"]
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
        declared = fields(kind)
        required = [field.name for field in declared if field.default is MISSING and field.default_factory is MISSING]
        self.check_keys(value, [field.name for field in declared], where, required)
        values = {name: self._field(name, entry, f"{where}.{name}") for name, entry in value.items()}
        with within(f"{self.owner}: {where}"):
            instance = kind(**values)
        if isinstance(instance, Environment) and "up" in values:
            # Restore the bits of a unit vector, which normalizing it again may change.
            up = np.array(values["up"], np.float64).reshape(3)
            if np.abs(up - instance.up).max() <= _SAME:
                vars(instance)["up"] = read_only(up)
        return instance

    def _field(self, name: str, value: Any, where: str) -> Any:
        if value is None:
            return None
        if name in _SHARED:
            table = self._tables[_SHARED[name]]
            expected = f"an index of the {len(table)} {_SHARED[name]}, from 0"
            return table[self._whole(value, where, len(table) - 1, expected)]
        if name in _PARTS:
            return self._made(_PARTS[name], value, where)
        if name in ("meshes", "lights"):
            read = self._light if name == "lights" else partial(self._made, Mesh)
            return [read(entry, f"{where}[{k}]") for k, entry in enumerate(self._list(value, where))]
        if name == "scalars":
            items = self.check_keys(value, value, where).items()
            return {key: self._plain(entry, f"{where} {quoted(key)}") for key, entry in items}
        return self._plain(value, where)

    def _light(self, value: Any, where: str) -> Any:
        kind = value.get("kind") if isinstance(value, dict) else None
        if not isinstance(kind, str) or kind not in _KINDS:
            raise self.error(f"{where}.kind", f"one of {', '.join(_KINDS)}", found_text(kind) + hint(kind, _KINDS))
        return self._made(_KINDS[kind], {key: entry for key, entry in value.items() if key != "kind"}, where)

    def _plain(self, value: Any, where: str, depth: int = 0) -> Any:
        """Return a number, a text, a truth value, an array, or a list of such."""
        if isinstance(value, dict):
            return self._array(self.check_keys(value, ("type", "shape", "offset"), where), where)
        if not isinstance(value, list):
            if isinstance(value, bool) and depth:
                raise self.error(where, "a list of numbers or texts", found_text(value))
            return value
        if depth == _MAX_DEPTH:
            raise self.error(where, f"at most {_MAX_DEPTH} lists in each other", "more")
        return [self._plain(entry, where, depth + 1) for entry in value]

    def _array(self, value: dict[str, Any], where: str) -> Array:
        name, size = value["type"], len(self._data)
        if not isinstance(name, str) or name not in TYPES:
            raise self.error(f"{where}.type", f"one of {', '.join(TYPES)}", found_text(name) + hint(name, TYPES))
        shape = tuple(self._whole(n, f"{where}.shape", _MAX_SIDE) for n in self._list(value["shape"], f"{where}.shape"))
        offset = self._whole(value["offset"], f"{where}.offset", size)
        kind, count = np.dtype(name).newbyteorder("<"), math.prod(shape)
        if not 1 <= len(shape) <= 3 or offset % kind.itemsize or offset + count * kind.itemsize > size:
            content = f"shape {list(shape)} at byte {offset}"
            raise self.error(where, f"1 to 3 dimensions of whole values within {size} bytes", content)
        key = name, shape, offset
        if key not in self._arrays:
            array = np.frombuffer(self._data, kind, count, offset) if count else np.zeros(0, kind)
            self._arrays[key] = array.astype(kind.newbyteorder("="), copy=False).reshape(shape)
        return self._arrays[key]

    def _whole(self, value: Any, where: str, maximum: int, expected: str = "") -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= maximum:
            raise self.error(where, expected or f"a whole number from 0 to {maximum}", found_text(value))
        return value

    def _list(self, value: Any, where: str) -> list[Any]:
        if not isinstance(value, list):
            raise self.error(where, "a list", found_text(value))
        return value


def checked_name(path: Path, argument: tuple[str, str] = ("Scene.to_json", "path")) -> str:
    """Return the name of a scene's JSON file. argument: function and argument, for messages. Raises InputError for a name
    that `clshade.load` does not take, or to which no scene file may refer."""
    name = checked_path(*argument, path)
    if os.path.splitext(name)[1].lower() != ENDING:
        raise file_error(*argument, f"a name ending in {ENDING}", shown(path))
    basename = os.path.basename(name)
    if "\\" in basename:  # readers take it for a slash
        raise file_error(*argument, "a file in the scene's folder (no backslash)", quoted(basename))
    beside(name, f"{basename}.bin", *argument)  # the name of its binary file
    return name


def write_scene(scene: DataclassInstance, path: Path) -> None:
    """Write a scene, see `Scene.to_json`.

    The JSON names its binary file, whose name has its hash: whenever this process ends, and whoever else writes this file,
    the JSON and the arrays belong to one scene.
    """
    name = checked_name(path)
    folder, basename = os.path.split(name)
    text, file, parts = _encoded(scene, basename)
    binary = os.path.join(folder, file)
    with contextlib.ExitStack() as stack:
        with replacing_all(*((binary, name) if parts else (name,))) as files:
            if parts:
                with naming(binary):
                    files[0].writelines(parts)
            with naming(name):
                files[-1].write(text)
            locked = stack.enter_context(folder_locked(folder or "."))  # before both take their places
        _remove_earlier(folder or ".", basename, file, at_once=locked)


def _remove_earlier(folder: str, basename: str, current: str, *, at_once: bool) -> None:
    """Remove the binary files of a JSON file but one. at_once: whether no other process can have begun to replace them;
    else only those left for long."""
    name = re.compile(re.escape(basename) + r"\.[0-9a-f]{16}\.bin")
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if name.fullmatch(entry.name) and entry.name != current:
                with contextlib.suppress(OSError):
                    if at_once or entry.stat().st_mtime < time.time() - LEFT_SECONDS:
                        os.unlink(entry.path)


def _encoded(scene: DataclassInstance, name: str) -> tuple[bytes, str, list[bytes | memoryview]]:
    """Return a scene as it is written to a JSON file of this name: the text, the name of the binary file ("" without
    arrays), and its parts. Raises InputError beyond the limits of the format."""
    encoder = _Encoder()
    content = {"format": FORMAT, "version": VERSION, "scene": encoder.fields_of(scene), **encoder.tables}
    if encoder.size > MAX_BINARY_BYTES:
        raise value_error("Scene.to_json", "scene", f"at most {MAX_BINARY_BYTES} bytes of arrays", encoder.size)
    digest = hashlib.sha256()
    for part in encoder.parts:
        digest.update(part)
    file = f"{name}.{digest.hexdigest()[:16]}.bin" if encoder.parts else ""
    facts = {"file": file, "bytes": encoder.size, "sha256": digest.hexdigest()}
    document = _text({**content, "arrays": facts if encoder.parts else None}) + "\n"
    text = document.encode("utf-8", "backslashreplace")  # halves of surrogate pairs, as JSON escapes them
    values = sum(map(text.count, (b",", b"[", b"{")))
    if values > MAX_VALUES or len(text) > MAX_BYTES:
        expected = f"at most {MAX_VALUES} values and {MAX_BYTES} bytes beside its arrays"
        raise value_error("Scene.to_json", "scene", expected, f"{values} values and {len(text)} bytes")
    return text, file, encoder.parts


class _Encoder:
    """Makes JSON-compatible values of a scene's parts, and collects their arrays and what they share."""

    def __init__(self) -> None:
        self.tables: dict[str, list[Any]] = {name: [] for name in dict.fromkeys(_SHARED.values())}
        self.parts: list[bytes | memoryview] = []
        self.size = 0
        self._numbers: dict[int, int] = {}  # of objects of a table, by their id
        self._places: dict[tuple[str, tuple[int, ...], bytes], int] = {}  # of arrays, by type, shape and hash

    def fields_of(self, instance: DataclassInstance) -> dict[str, Any]:
        kind = {"kind": type(instance).__name__} if isinstance(instance, LIGHTS) else {}
        return kind | {field.name: self._value(field.name, getattr(instance, field.name)) for field in fields(instance)}

    def _value(self, name: str, value: Any) -> Any:
        if name in _SHARED and value is not None:
            return self._number(self.tables[_SHARED[name]], value)
        if is_dataclass(value) and not isinstance(value, type):
            return self.fields_of(value)
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, Mapping):
            return {key: self._value("", entry) for key, entry in value.items()}
        if isinstance(value, (list, tuple)):
            return [self._value("", entry) for entry in value]
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, (str, int)) or (isinstance(value, float) and math.isfinite(value)):
            return value
        raise value_error("Scene.to_json", name, "a value that a scene file can hold", value)

    def _number(self, table: list[Any], value: Any) -> int:
        """Return the number of an object in its table, in which it is entered once."""
        if id(value) not in self._numbers:
            entry = self.fields_of(value)  # which enters what it holds before it
            self._numbers[id(value)] = len(table)
            table.append(entry)
        return self._numbers[id(value)]

    def _array(self, array: Array) -> Any:
        """Return a small array of float64 as nested lists, and others as a reference to the binary file."""
        if array.dtype == np.float64 and 0 < array.size <= INLINE and np.isfinite(array).all():
            return array.tolist()
        if array.dtype.name not in TYPES:
            raise value_error("Scene.to_json", "scene", f"arrays of {', '.join(TYPES)}", array)
        array = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        key = array.dtype.name, array.shape, hashlib.sha256(array.data).digest() if array.size else b""
        if key not in self._places:
            self._places[key] = 0
            if array.size:
                padding = bytes(-self.size % ALIGNMENT)
                self._places[key] = start = self.size + len(padding)
                self.parts += [padding, array.data]
                self.size = start + array.nbytes
        return {"type": array.dtype.name, "shape": list(array.shape), "offset": self._places[key]}


def _text(value: Any, indent: str = "") -> str:
    """Return JSON in which short objects and lists stand in one line, unescaped."""
    inner = indent + "  "
    if isinstance(value, dict):
        parts, ends = [f"{_text(key)}: {_text(entry, inner)}" for key, entry in value.items()], "{}"
    elif isinstance(value, list):
        parts, ends = [_text(entry, inner) for entry in value], "[]"
    else:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)
    line = ends[0] + ", ".join(parts) + ends[1]
    if "\n" not in line and len(indent) + len(line) <= _WIDTH:
        return line
    return ends[0] + "\n" + ",\n".join(inner + part for part in parts) + "\n" + indent + ends[1]
