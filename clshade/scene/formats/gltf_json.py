"""The JSON of a glTF file; every value is checked where it is used."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error, quoted
from ...base.json_values import found_text, parse_text
from ...errors import InputError


@dataclass(eq=False)  # frozen ones take three times as long to make, and large files have millions
class Item:
    """A JSON object and its place in the file: `where` is a path such as meshes[0].primitives[1]."""

    value: dict[str, Any]
    where: str
    root: dict[str, Any]
    owner: str

    def error(self, key: str, expected: str, found: str) -> InputError:
        """Build the error for a field of this object."""
        where = f"{self.where}.{key}" if self.where and key else self.where or key
        return file_error(self.owner, where, expected, found)

    def integer(self, key: str, default: int | None = None, least: int = 0) -> int:
        """Return an integer. Raises InputError for anything else, and if it is missing without a default."""
        value = self.value.get(key, default)
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value < 1 << 53:
            raise self.error(key, f"a whole number of at least {least}", found_text(value))
        return value

    def number(self, key: str, default: float | None = None, least: float = -math.inf) -> float:
        """Return a finite number. Raises InputError for anything else, and if it is missing without a default."""
        value = self.value.get(key, default)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= 1e300:
            expected = "a finite number" + (f" of at least {least:g}" if least > -math.inf else "")
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

    def item(self, key: str) -> Item | None:
        """Return the object of that name, or None if there is none."""
        if key not in self.value:
            return None
        where = f"{self.where}.{key}" if self.where else key
        return self._at(self.value[key], where)

    def items(self, key: str) -> Iterator[Item]:
        """Yield the objects of a list, which may be missing."""
        where = f"{self.where}.{key}" if self.where else key
        for index, value in enumerate(self._list(self.value, key, self.where)):
            yield self._at(value, f"{where}[{index}]")

    def extension(self, name: str) -> Item | None:
        extensions = self.item("extensions")
        return None if extensions is None else extensions.item(name)

    def refuse_extensions(self) -> None:
        """Raise InputError if this object, whose data is not in the file, has extensions, which then hold it."""
        extensions = self.item("extensions")
        if extensions is not None and extensions.value:
            expected = "geometry that needs no extension (export it without compression)"
            raise self.error("extensions", expected, quoted(", ".join(extensions.value)))

    def reference(self, key: str, kind: str) -> int | None:
        """Return the index, in range, that a field holds into the file's list `kind`; None if the field is missing."""
        if key not in self.value:
            return None
        index, count = self.integer(key), len(self._list(self.root, kind, ""))
        if index >= count:
            raise self.error(key, f"an index of the {count} {kind}", str(index))
        return index

    def references(self, key: str, kind: str) -> list[int]:
        """Return the indices, in range, of a field that holds a list of them."""
        count = len(self._list(self.root, kind, ""))
        found = self._list(self.value, key, self.where)
        for index in found:
            if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < count:
                raise self.error(key, f"indices of the {count} {kind}", found_text(index))
        return found

    def entry(self, kind: str, index: int) -> Item:
        """Return the object at an index that is in range of the file's list `kind`."""
        return self._at(self.root[kind][index], f"{kind}[{index}]")

    def count(self, kind: str) -> int:
        """Return the length of one of the file's lists."""
        return len(self._list(self.root, kind, ""))

    def _at(self, value: Any, where: str) -> Item:
        if not isinstance(value, dict):
            raise file_error(self.owner, where, "an object", found_text(value))
        return Item(value, where, self.root, self.owner)

    def _list(self, value: dict[str, Any], key: str, where: str) -> list[Any]:
        found = value.get(key, [])
        if not isinstance(found, list):
            raise file_error(self.owner, f"{where}.{key}" if where else key, "a list", found_text(found))
        return found


def parse(text: bytes, owner: str) -> Item:
    """Parse the JSON of a glTF file and return its top object.

    Raises InputError for text that is not a JSON object, holds NaN or infinity, has a duplicate key (which glTF
    forbids), is nested too deeply, or has too many values.
    """
    value = parse_text(text, owner, "a glTF document", unique=True)
    if not isinstance(value, dict):
        raise file_error(owner, "JSON", "an object", found_text(value))
    return Item(value, "", value, owner)
