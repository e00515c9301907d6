"""Parser of PLY files: the header, then the rows of every element as columns, ascii or binary, each checked."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error, quoted, runs
from .text_tokens import is_blank, numbers

MAX_HEADER = 1 << 16  # bytes
MAX_LISTS = 8  # in an element
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LINE_END = re.compile(rb"[ \t]*(?:\r\n|\n|\r|\Z)")
_CHUNK = 1 << 20  # bytes of ascii text taken at once


@dataclass(frozen=True)
class Property:
    """A property. kind: type of the values, such as f4. count: type of a list's length, empty for a scalar."""

    name: str
    kind: str
    count: str = ""

    @property
    def sizes(self) -> tuple[int, int, bool]:
        """Bytes of a value, and of a list's length, 0 for a scalar; whether the length has a sign."""
        width = np.dtype(self.count).itemsize if self.count else 0
        return np.dtype(self.kind).itemsize, width, self.count[:1] == "i"


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
    """The content of a PLY file. elements: by name. Values keep the file's types; ascii gives float64.

    Raises InputError naming the line of the header, or the element and row, for any inconsistency.
    """

    def __init__(self, data: bytes, owner: str) -> None:
        self.data, self.owner = data, owner
        self.byte_order: Literal["little", "big"] = "little"
        self.order = "?"  # `<`, `>`, or empty for ascii
        self.elements: dict[str, Element] = {}
        self.comments: list[str] = []
        if not re.match(rb"ply\s", data):
            raise file_error(owner, "magic", "a first line of ply", quoted(data[:8]))
        end = data.find(b"end_header", 0, MAX_HEADER)
        after = _LINE_END.match(data, end + len(b"end_header"))
        if end < 0 or after is None:
            raise file_error(owner, "header", f"end_header in the first {MAX_HEADER} bytes", "none")
        lines = data[:end].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
        self._read_header(lines)
        if self.order:
            self._read_binary(after.end())
        else:
            self._read_ascii(after.end(), len(lines))

    def _read_header(self, lines: list[str]) -> None:
        names: list[str] = []
        element: Element | None = None
        for number, line in enumerate(lines[1:-1], 2):
            if not line.strip():
                continue
            keyword, *rest = line.split()
            where = f"line {number}: {keyword}"
            if keyword in ("comment", "obj_info"):
                self.comments.append(line.strip()[len(keyword) :].strip())
            elif keyword == "format":
                if len(rest) != 2 or rest[0] not in _FORMATS or rest[1] != "1.0":
                    expected = f"one of {', '.join(_FORMATS)}, and the version 1.0"
                    raise file_error(self.owner, where, expected, quoted(" ".join(rest)))
                self.order = _FORMATS[rest[0]]
                self.byte_order = "big" if self.order == ">" else "little"
            elif keyword == "element":
                if len(rest) != 2 or not re.fullmatch(r"[0-9]{1,18}", rest[1]):
                    where, found = f"{where} {' '.join(rest[:1])[:32]}", quoted(" ".join(rest[1:]))
                    raise file_error(self.owner, where, "a name and a number of rows from 0", found)
                names.append(rest[0])
                element = self.elements[rest[0]] = Element(rest[0], int(rest[1]))
            elif keyword == "property":
                if element is None:
                    raise file_error(self.owner, where, "an element before it", "none")
                self._add_property(element, rest, where)
            else:
                expected = "format, element, property, comment, obj_info or end_header"
                raise file_error(self.owner, f"line {number}", expected, quoted(keyword))
        if self.order == "?":
            raise file_error(self.owner, "header", "a line of format", "none")
        for element in self.elements.values():
            lists = sum(bool(item.count) for item in element.properties)
            if lists > MAX_LISTS:
                raise file_error(self.owner, f"element {element.name}", f"at most {MAX_LISTS} lists", str(lists))
        if len(self.elements) != len(names):
            raise file_error(self.owner, "header", "elements of different names", ", ".join(names)[:80])

    def _add_property(self, element: Element, words: list[str], where: str) -> None:
        listed = words[:1] == ["list"]
        if len(words) != (4 if listed else 2):
            expected = "a type and a name, or list, two types and a name"
            raise file_error(self.owner, where, expected, quoted(" ".join(words)))
        *types, name = words[1:] if listed else words
        for word in types:
            if word not in _TYPES:
                raise file_error(self.owner, where, f"one of the types {' '.join(_TYPES)}", quoted(word))
        if listed and _TYPES[types[0]][0] == "f":
            expected = "a type of whole numbers for the length of a list"
            raise file_error(self.owner, where, expected, quoted(types[0]))
        if any(name == item.name for item in element.properties):
            expected = f"properties of different names in element {element.name}"
            raise file_error(self.owner, where, expected, quoted(name))
        element.properties.append(Property(name, _TYPES[types[-1]], _TYPES[types[0]] if listed else ""))

    def _check_rows(self, element: Element, left: int, least: int, unit: str) -> None:
        """Raise InputError for more rows than `left` bytes or values can hold, of at least so many each."""
        if element.rows * least > left:
            expected = f"{element.rows} rows, of at least {least} {unit} each"
            raise file_error(self.owner, f"element {element.name}", expected, f"{left} {unit} left in the file")

    def _row_error(self, element: Element, row: int, number: int, expected: str, found: str) -> Exception:
        where = f"element {element.name}: row {row}: {element.properties[number].name}"
        return file_error(self.owner, where, expected, found)

    # Binary rows

    def _read_binary(self, place: int) -> None:
        for element in self.elements.values():
            least = sum(width or size for size, width, _ in (item.sizes for item in element.properties))
            self._check_rows(element, len(self.data) - place, least, "bytes")
            if element.rows and element.properties:
                place = self._read_even_rows(place, element) or self._read_ragged_rows(place, element)

    def _read_even_rows(self, place: int, element: Element) -> int:
        """Fill in the columns of an element all of whose rows have lists as long as the first. Returns the position after
        its rows, 0 for other elements."""
        lengths, starts, size = [], [], 0
        for item in element.properties:
            step, width, signed = item.sizes
            text = self.data[place + size : place + size + width]
            length = max(int.from_bytes(text, self.byte_order, signed=signed), 0) if item.count else 1
            lengths.append(length)
            starts.append(place + size + width)
            size += width + step * length
        if size > (len(self.data) - place) // element.rows:
            return 0
        for item, length, start in zip(element.properties, lengths, starts, strict=True):
            if item.count:
                kind = np.dtype(self.order + item.count)
                counts: Array = np.ndarray((element.rows,), kind, self.data, start - kind.itemsize, (size,))
                if (counts != length).any():
                    return 0
        for item, length, start in zip(element.properties, lengths, starts, strict=True):
            kind = np.dtype(self.order + item.kind)
            if item.count:
                values = runs(self.data, start, element.rows, size, kind, length).reshape(-1)
                element.columns[item.name] = values, np.broadcast_to(np.int64(length), element.rows)
            else:  # a view of the data: the only copy is made where the column is used
                single: Array = np.ndarray((element.rows,), kind, self.data, start, (size,))
                element.columns[item.name] = single.astype(kind.newbyteorder("="), copy=False)
        return place + element.rows * size

    def _read_ragged_rows(self, place: int, element: Element) -> int:
        """Read rows of unequal length: locate them one by one, then read their values all at once."""
        steps = [item.sizes for item in element.properties]
        places, counts = ([array("q") for _ in steps] for _ in range(2))
        data, total = self.data, len(self.data)
        for row in range(element.rows):
            for number, (size, width, signed) in enumerate(steps):
                if width == 1 and place < total:
                    count = data[place] if not signed or data[place] < 128 else -1
                else:
                    text = data[place : place + width]
                    count = int.from_bytes(text, self.byte_order, signed=signed) if width else 1
                place += width
                if count < 0 or count * size > total - place:
                    expected = f"values within the {total} bytes of the file"
                    raise self._row_error(element, row, number, expected, f"a length of {count}")
                places[number].append(place)
                counts[number].append(count)
                place += count * size
        for number, item in enumerate(element.properties):
            start, length = np.array(places[number]), np.array(counts[number])
            values = self._gathered(start, length, np.dtype(self.order + item.kind))
            element.columns[item.name] = (values, length) if item.count else values
        return place

    def _gathered(self, start: Array, length: Array, kind: np.dtype) -> Array:
        """Return the values of type `kind` in runs of `length` (R,) from the bytes `start` (R,) on, concatenated."""
        first, last = int(start[0]), int(start[-1] + length[-1] * kind.itemsize)
        changes = np.zeros(last - first + 1, np.int8)
        some = length > 0
        changes[start[some] - first] += 1
        np.subtract.at(changes, start[some] + length[some] * kind.itemsize - first, 1)
        mask = np.cumsum(changes[:-1], dtype=np.int8).view(bool)
        chosen = np.frombuffer(self.data, np.uint8, last - first, first)[mask]
        return np.asarray(chosen.view(kind).astype(kind.newbyteorder("=")))

    # Rows of text

    def _read_ascii(self, start: int, lines: int) -> None:
        """Read the numbers from byte `start` on, after so many lines."""
        data, parts, body = self.data, [np.zeros(0)], start
        while start < len(data):
            end = data.find(b"\n", start + _CHUNK) + 1 or len(data)
            text = b" " + data[start:end]
            blank = is_blank(text)
            part = numbers(text, float, int(np.count_nonzero(blank[:-1] & ~blank[1:])))
            if part is None:
                bad = next((word for word in text.split() if numbers(word, float, 1) is None), b"")
                line = lines + data.count(b"\n", body, data.find(bad, start)) + 1
                raise file_error(self.owner, f"line {line}", "numbers", quoted(bad))
            parts.append(part)
            start = end
        values, place = np.concatenate(parts), 0
        for element in self.elements.values():
            self._check_rows(element, len(values) - place, len(element.properties), "values")
            if element.rows and element.properties:
                place += self._read_ascii_rows(values[place:], element)
        if place != len(values):
            raise file_error(self.owner, "rows", f"{place} values, as the header says", str(len(values)))

    def _read_ascii_rows(self, values: Array, element: Element) -> int:
        """Fill in an element's columns from values that begin with its rows. Returns how many they are."""
        listed = [bool(item.count) for item in element.properties]
        if not any(listed):
            table = values[: element.rows * len(listed)].reshape(element.rows, len(listed))
            element.columns.update({item.name: table[:, k] for k, item in enumerate(element.properties)})
            return int(table.size)
        starts, counts = ([array("q") for _ in listed] for _ in range(2))
        words, place = values.data, 0
        for row in range(element.rows):
            for number, is_list in enumerate(listed):
                length = 1.0
                if is_list:
                    length = words[place] if place < len(words) else len(words) + 1.0
                    place += 1
                if not (length >= 0.0 and length.is_integer() and place + length <= len(words)):
                    found = "the end of the file" if length >= 0.0 and length.is_integer() else f"{length:g}"
                    raise self._row_error(element, row, number, "a length and as many values", found)
                starts[number].append(place)
                counts[number].append(int(length))
                place += int(length)
        for number, item in enumerate(element.properties):
            start, lengths = np.array(starts[number]), np.array(counts[number])
            before = np.cumsum(lengths) - lengths
            chosen = values[np.repeat(start - before, lengths) + np.arange(int(lengths.sum()))]
            element.columns[item.name] = (chosen, lengths) if item.count else chosen
        return place
