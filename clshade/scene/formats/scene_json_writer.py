"""Scene files of clshade's own: writing. One JSON text, and beside it one binary file with the large arrays.

It takes the fields of the model's dataclasses as they are, so that a new field is written without a word here.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import LEFT_SECONDS, Path, folder_locked, naming, replacing_all, shown
from ...base.input_files import beside, file_error, quoted
from ...base.json_values import MAX_VALUES
from ...base.validation import path as checked_path
from ...base.validation import value_error
from ..lights import LIGHTS
from ..metallic_roughness import MAPS

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

# Fields that hold an object of a table, and the table's name: what is shared in the scene is shared in the file.
SHARED = {"material": "materials", "texture": "textures", **dict.fromkeys(MAPS, "textures")}

_WIDTH = 110  # characters of a line, where an object or a list fits into one


@dataclass(frozen=True)
class SceneFile:
    """A scene as it is written.

    text: the JSON, UTF-8. file: name of the binary file, "" without arrays. arrays: its content in order, each with its
    first byte.
    """

    text: bytes
    file: str
    arrays: tuple[tuple[int, Array], ...]

    def binary(self) -> Iterator[bytes | memoryview]:
        """Yield the parts of the binary file."""
        return _parts(self.arrays)


def checked_name(path: Path, asked: tuple[str, str] = ("Scene.to_json", "path")) -> str:
    """Return the name of a scene's JSON file.

    asked: function and argument, for messages. Raises InputError for a name that `clshade.load` does not take, or to
    which no scene file may refer.
    """
    name = checked_path(*asked, path)
    if os.path.splitext(name)[1].lower() != ENDING:
        raise file_error(*asked, f"a name ending in {ENDING}", shown(path))
    own = os.path.basename(name)
    if "\\" in own:  # readers take it for a slash
        raise file_error(*asked, "a file in the scene's folder (no backslash)", quoted(own))
    beside(name, f"{own}.bin", *asked)  # as that of its arrays
    return name


def write_scene(scene: DataclassInstance, path: Path) -> None:
    """Write a scene, see `Scene.to_json`.

    The JSON names its binary file, whose name has its hash: whenever this process ends, and whoever else writes the same
    scene file, the JSON and what it names are those of one scene.
    """
    text = checked_name(path)
    folder, own = os.path.split(text)
    made = encoded(scene, own)
    binary = os.path.join(folder, made.file)
    with contextlib.ExitStack() as stack:
        with replacing_all(*((binary, text) if made.arrays else (text,))) as files:
            if made.arrays:
                with naming(binary):
                    for part in made.binary():
                        files[0].write(part)
            with naming(text):
                files[-1].write(made.text)
            locked = stack.enter_context(folder_locked(folder or "."))  # before both take their places
        _remove_earlier(folder or ".", own, made.file, at_once=locked)


def _remove_earlier(folder: str, own: str, kept: str, *, at_once: bool) -> None:
    """Remove the binary files of a JSON file but one. at_once: whether no other process can have begun to replace them;
    else only those left for long."""
    name = re.compile(re.escape(own) + r"\.[0-9a-f]{16}\.bin")
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if name.fullmatch(entry.name) and entry.name != kept:
                with contextlib.suppress(OSError):
                    if at_once or entry.stat().st_mtime < time.time() - LEFT_SECONDS:
                        os.unlink(entry.path)


def encoded(scene: DataclassInstance, name: str) -> SceneFile:
    """Return a scene as it is written to a JSON file of this name.

    Raises InputError for a scene beyond the limits of the format.
    """
    encoder = _Encoder()
    content = {"format": FORMAT, "version": VERSION, "scene": encoder.fields_of(scene), **encoder.tables}
    arrays = tuple(encoder.arrays)
    if encoder.size > MAX_BINARY_BYTES:
        raise value_error("Scene.to_json", "scene", f"at most {MAX_BINARY_BYTES} bytes of arrays", encoder.size)
    hashed = hashlib.sha256()
    for part in _parts(arrays):
        hashed.update(part)
    file = f"{name}.{hashed.hexdigest()[:16]}.bin" if arrays else ""
    facts = {"file": file, "bytes": encoder.size, "sha256": hashed.hexdigest()}
    text = (_text({**content, "arrays": facts if arrays else None}) + "\n").encode()
    values = sum(map(text.count, (b",", b"[", b"{")))
    if values > MAX_VALUES or len(text) > MAX_BYTES:
        expected = f"at most {MAX_VALUES} values and {MAX_BYTES} bytes beside its arrays"
        raise value_error("Scene.to_json", "scene", expected, f"{values} values and {len(text)} bytes")
    return SceneFile(text, file, arrays)


class _Encoder:
    """Makes JSON-compatible values of a scene's parts, and collects their arrays and what they share."""

    def __init__(self) -> None:
        self.tables: dict[str, list[Any]] = {name: [] for name in dict.fromkeys(SHARED.values())}
        self.arrays: list[tuple[int, Array]] = []
        self.size = 0
        self._numbers: dict[int, int] = {}  # of objects of a table, by their id
        self._places: dict[tuple[str, tuple[int, ...], bytes], int] = {}  # of arrays, by type, shape and hash

    def fields_of(self, instance: DataclassInstance) -> dict[str, Any]:
        kind = {"kind": type(instance).__name__} if isinstance(instance, LIGHTS) else {}
        return kind | {field.name: self._value(field.name, getattr(instance, field.name)) for field in fields(instance)}

    def _value(self, name: str, value: Any) -> Any:
        if value is None or isinstance(value, str):
            return value
        if name in SHARED:
            return self._number(self.tables[SHARED[name]], value)
        if is_dataclass(value) and not isinstance(value, type):
            return self.fields_of(value)
        if isinstance(value, np.ndarray):
            return self._array(value)
        if isinstance(value, Mapping):
            return {key: self._value("", each) for key, each in value.items()}
        if isinstance(value, (list, tuple)):
            return [self._value("", each) for each in value]
        if isinstance(value, (bool, np.bool_)):
            return bool(value)
        if isinstance(value, Integral):
            return int(value)
        if isinstance(value, Real) and math.isfinite(value):
            return float(value)
        raise value_error("Scene.to_json", name, "a value that a scene file can hold", value)

    def _number(self, table: list[Any], value: Any) -> int:
        """Return the number of an object in its table, in which it is entered once."""
        if id(value) not in self._numbers:
            self._numbers[id(value)] = number = len(table)
            table.append(None)
            table[number] = self.fields_of(value)
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
                self._places[key] = start = -(-self.size // ALIGNMENT) * ALIGNMENT
                self.arrays.append((start, array))
                self.size = start + array.nbytes
        return {"type": array.dtype.name, "shape": list(array.shape), "offset": self._places[key]}


def _parts(arrays: tuple[tuple[int, Array], ...]) -> Iterator[bytes | memoryview]:
    end = 0
    for start, array in arrays:
        yield bytes(start - end)
        yield array.data
        end = start + array.nbytes


def _text(value: Any, indent: str = "") -> str:
    """Return JSON in which short objects and lists stand in one line."""
    inner = indent + "  "
    if isinstance(value, dict):
        parts, ends = [f"{_scalar(key)}: {_text(each, inner)}" for key, each in value.items()], "{}"
    elif isinstance(value, list):
        parts, ends = [_text(each, inner) for each in value], "[]"
    else:
        return _scalar(value)
    line = ends[0] + ", ".join(parts) + ends[1]
    if "\n" not in line and len(indent) + len(line) <= _WIDTH:
        return line
    return ends[0] + "\n" + ",\n".join(inner + part for part in parts) + "\n" + indent + ends[1]


def _scalar(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if isinstance(value, str):
        try:
            text.encode()
        except UnicodeEncodeError:  # half of a surrogate pair
            return json.dumps(value)
    return text
