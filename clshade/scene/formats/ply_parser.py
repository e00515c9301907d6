"""Parser of PLY files: the header, then the rows of every element as columns, ascii or binary, each checked."""

from __future__ import annotations

import re
from array import array
from dataclasses import dataclass, field
from typing import Any

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


@dataclass
class Element:
    """An element of `rows` rows. columns: by property, (rows,) values, or (values, lengths) of lists, row by row."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)
    columns: dict[str, Any] = field(default_factory=dict)


@dataclass
class Header:
    """The header. order: `<`, `>`, or empty for ascii. size: bytes of the header."""

    order: str
    elements: list[Element]
    comments: list[str]
    size: int
    lines: int


def read_ply_rows(data: bytes, owner: str) -> tuple[dict[str, Element], list[str]]:
    """Return the elements of a PLY file by name, and its comments. Values keep the file's types; ascii gives float64.

    Raises InputError naming the line of the header, or the element and row, for any inconsistency.
    """
    header = _header(data, owner)
    if header.order:
        _binary(data, header, owner)
    else:
        _ascii(data, header, owner)
    return {element.name: element for element in header.elements}, header.comments


def _header(data: bytes, owner: str) -> Header:
    if not re.match(rb"ply\s", data):
        raise file_error(owner, "magic", "a first line of ply", quoted(data[:8]))
    end = data.find(b"end_header", 0, MAX_HEADER)
    after = _LINE_END.match(data, end + len(b"end_header"))
    if end < 0 or after is None:
        raise file_error(owner, "header", f"end_header in the first {MAX_HEADER} bytes", "none")
    lines = data[:end].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header = Header("?", [], [], after.end(), len(lines))
    for number, line in enumerate(lines[1:-1], 2):
        words = line.split()
        if words[:1] in (["comment"], ["obj_info"]):
            header.comments.append(line.strip()[len(words[0]) :].strip())
        elif words:
            _header_line(header, words, owner, f"line {number}")
    if header.order == "?":
        raise file_error(owner, "header", "a line of format", "none")
    for element in header.elements:
        lists = sum(bool(item.count) for item in element.properties)
        if lists > MAX_LISTS:
            raise file_error(owner, f"element {element.name}", f"at most {MAX_LISTS} lists", str(lists))
    names = [element.name for element in header.elements]
    if len(set(names)) != len(names):
        raise file_error(owner, "header", "elements of different names", ", ".join(names)[:80])
    return header


def _header_line(header: Header, words: list[str], owner: str, where: str) -> None:
    keyword, *rest = words
    if keyword == "format":
        if len(rest) != 2 or rest[0] not in _FORMATS or rest[1] != "1.0":
            expected = f"one of {', '.join(_FORMATS)}, and the version 1.0"
            raise file_error(owner, f"{where}: format", expected, quoted(" ".join(rest)))
        header.order = _FORMATS[rest[0]]
    elif keyword == "element":
        if len(rest) != 2 or not re.fullmatch(r"[0-9]{1,18}", rest[1]):
            found = quoted(" ".join(rest[1:]))
            raise file_error(
                owner, f"{where}: element {' '.join(rest[:1])[:32]}", "a name and a number of rows from 0", found
            )
        header.elements.append(Element(rest[0], int(rest[1])))
    elif keyword == "property":
        if not header.elements:
            raise file_error(owner, f"{where}: property", "an element before it", "none")
        _property(header.elements[-1], rest, owner, f"{where}: property")
    else:
        expected = "format, element, property, comment, obj_info or end_header"
        raise file_error(owner, where, expected, quoted(keyword))


def _property(element: Element, words: list[str], owner: str, where: str) -> None:
    listed = words[:1] == ["list"]
    if len(words) != (4 if listed else 2):
        raise file_error(owner, where, "a type and a name, or list, two types and a name", quoted(" ".join(words)))
    *types, name = words[1:] if listed else words
    for word in types:
        if word not in _TYPES:
            raise file_error(owner, where, f"one of the types {' '.join(_TYPES)}", quoted(word))
    if listed and _TYPES[types[0]][0] == "f":
        raise file_error(owner, where, "a type of whole numbers for the length of a list", quoted(types[0]))
    if any(name == item.name for item in element.properties):
        raise file_error(owner, where, f"properties of different names in element {element.name}", quoted(name))
    element.properties.append(Property(name, _TYPES[types[-1]], _TYPES[types[0]] if listed else ""))


def _rows_left(element: Element, units: int, least: int, owner: str, unit: str) -> None:
    if element.rows * least > units:
        expected = f"{element.rows} rows, of at least {least} {unit} each"
        raise file_error(owner, f"element {element.name}", expected, f"{units} {unit} left in the file")


def _binary(data: bytes, header: Header, owner: str) -> None:
    place = header.size
    for element in header.elements:
        sizes = [np.dtype(p.count or p.kind).itemsize for p in element.properties]
        _rows_left(element, len(data) - place, sum(sizes), owner, "bytes")
        if element.rows and element.properties:
            place = _binary_rows(data, place, element, header.order, owner)


def _binary_rows(data: bytes, place: int, element: Element, order: str, owner: str) -> int:
    """Fill in an element's columns. Returns the position after its rows."""
    lengths = _first_lengths(data, place, element, order)
    starts, size = [], 0
    for item, length in zip(element.properties, lengths, strict=True):
        size += np.dtype(item.count).itemsize if item.count else 0
        starts.append(place + size)
        size += np.dtype(item.kind).itemsize * (length if item.count else 1)
    if size > (len(data) - place) // element.rows:
        return _ragged_rows(data, place, element, order, owner)
    for item, length, start in zip(element.properties, lengths, starts, strict=True):
        if item.count:
            counted = np.dtype(order + item.count)
            found: Array = np.ndarray((element.rows,), counted, data, start - counted.itemsize, (size,))
            if (found != length).any():
                return _ragged_rows(data, place, element, order, owner)
    for item, length, start in zip(element.properties, lengths, starts, strict=True):
        kind = np.dtype(order + item.kind)
        if item.count:
            values = runs(data, start, element.rows, size, kind, length).reshape(-1)
            element.columns[item.name] = values, np.broadcast_to(np.int64(length), element.rows)
        else:  # a view of the data: the only copy is made where the column is used
            single: Array = np.ndarray((element.rows,), kind, data, start, (size,))
            element.columns[item.name] = single.astype(kind.newbyteorder("="), copy=False)
    return place + element.rows * size


def _first_lengths(data: bytes, place: int, element: Element, order: str) -> list[int]:
    """Return the lengths of the lists in the first row, 0 for a scalar or where the data ends."""
    lengths = []
    for item in element.properties:
        size, count = np.dtype(item.kind).itemsize, 0
        if item.count:
            width = np.dtype(item.count).itemsize
            count = max(_length(data[place : place + width], order, item.count[0] == "i"), 0)
            place += width + count * size
        else:
            place += size
        lengths.append(count)
    return lengths


def _length(text: bytes, order: str, signed: bool) -> int:
    return int.from_bytes(text, "big" if order == ">" else "little", signed=signed)


def _ragged_rows(data: bytes, place: int, element: Element, order: str, owner: str) -> int:
    """Read rows of unequal length: locate them one by one, then read their values all at once."""
    steps = [
        (np.dtype(p.kind).itemsize, np.dtype(p.count).itemsize if p.count else 0, p.count[:1] == "i")
        for p in element.properties
    ]
    places, counts = ([array("q") for _ in steps] for _ in range(2))
    total = len(data)
    for row in range(element.rows):
        for number, (size, width, signed) in enumerate(steps):
            if width == 1 and place < total:
                count = data[place] if not signed or data[place] < 128 else -1
            else:
                count = _length(data[place : place + width], order, signed) if width else 1
            place += width
            if count < 0 or count * size > total - place:
                where = f"element {element.name}: row {row}: {element.properties[number].name}"
                raise file_error(owner, where, f"values within the {total} bytes of the file", f"a length of {count}")
            places[number].append(place)
            counts[number].append(count)
            place += count * size
    for number, item in enumerate(element.properties):
        start, length = np.array(places[number]), np.array(counts[number])
        values = _gathered(data, start, length, np.dtype(order + item.kind))
        element.columns[item.name] = (values, length) if item.count else values
    return place


def _gathered(data: bytes, start: Array, length: Array, kind: np.dtype) -> Array:
    """Return the values of type `kind` in runs of `length` (R,) from the bytes `start` (R,) on, one after the other."""
    first, last = int(start[0]), int(start[-1] + length[-1] * kind.itemsize)
    wanted = np.zeros(last - first + 1, np.int8)
    some = length > 0
    wanted[start[some] - first] += 1
    np.subtract.at(wanted, start[some] + length[some] * kind.itemsize - first, 1)
    mask = np.cumsum(wanted[:-1], dtype=np.int8).view(bool)
    chosen = np.frombuffer(data, np.uint8, last - first, first)[mask]
    return np.asarray(chosen.view(kind).astype(kind.newbyteorder("=")))


def _ascii(data: bytes, header: Header, owner: str) -> None:
    values = _ascii_values(data, header, owner)
    place = 0
    for element in header.elements:
        _rows_left(element, len(values) - place, len(element.properties), owner, "values")
        if element.rows and element.properties:
            place = _ascii_rows(values, place, element, owner)
    if place != len(values):
        raise file_error(owner, "rows", f"{place} values, as the header says", str(len(values)))


def _ascii_values(data: bytes, header: Header, owner: str) -> Array:
    """Return all numbers after the header."""
    parts, start = [], header.size
    while start < len(data):
        end = data.find(b"\n", start + _CHUNK) + 1 or len(data)
        text = b" " + data[start:end]
        blank = is_blank(text)
        values = numbers(text, float, int(np.count_nonzero(blank[:-1] & ~blank[1:])))
        if values is None:
            bad = next((word for word in text.split() if numbers(word, float, 1) is None), b"")
            line = header.lines + data.count(b"\n", header.size, data.find(bad, start)) + 1
            raise file_error(owner, f"line {line}", "numbers", quoted(bad))
        parts.append(values)
        start = end
    return np.concatenate(parts) if parts else np.zeros(0)


def _ascii_rows(values: Array, place: int, element: Element, owner: str) -> int:
    """Fill in an element's columns. Returns the position after its rows, counted in values."""
    listed = [bool(item.count) for item in element.properties]
    if not any(listed):
        table = values[place : place + element.rows * len(listed)].reshape(element.rows, len(listed))
        element.columns.update({item.name: table[:, k] for k, item in enumerate(element.properties)})
        return place + table.size
    starts, counts = ([array("q") for _ in listed] for _ in range(2))
    words, first = values.data[place:], place
    place = 0
    for row in range(element.rows):
        for number, is_list in enumerate(listed):
            length = 1.0
            if is_list:
                length = words[place] if place < len(words) else len(words) + 1.0
                place += 1
            if not (length >= 0.0 and length.is_integer() and place + length <= len(words)):
                where = f"element {element.name}: row {row}: {element.properties[number].name}"
                found = "the end of the file" if length >= 0.0 and length.is_integer() else f"{length:g}"
                raise file_error(owner, where, "a length and as many values", found)
            starts[number].append(place)
            counts[number].append(int(length))
            place += int(length)
    for number, item in enumerate(element.properties):
        start, length_of = np.array(starts[number]), np.array(counts[number])
        before = np.cumsum(length_of) - length_of
        chosen = values[first:][np.repeat(start - before, length_of) + np.arange(int(length_of.sum()))]
        element.columns[item.name] = (chosen, length_of) if item.count else chosen
    return first + place
