"""Parser of PLY files: the header, then the rows of every element as columns, ascii or binary, each checked."""

from __future__ import annotations

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
    if data[:3] != b"ply" or data[3:4] not in (b"\n", b"\r"):
        raise file_error(owner, "magic", "a first line of ply", quoted(data[:8]))
    end = data.find(b"end_header", 0, MAX_HEADER)
    if end < 0:
        raise file_error(owner, "header", f"end_header in the first {MAX_HEADER} bytes", "none")
    stop = end + 10
    if data[stop : stop + 2] == b"\r\n":
        stop += 2
    elif data[stop : stop + 1] in (b"\n", b"\r"):
        stop += 1
    elif len(data) > stop:
        raise file_error(owner, "header", "a line of end_header", quoted(data[end : end + 20]))
    lines = data[:end].decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    header = Header("?", [], [], stop, len(lines))
    for number, line in enumerate(lines[1:-1], 2):
        _header_line(header, line, owner, f"line {number}")
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


def _header_line(header: Header, line: str, owner: str, where: str) -> None:
    words = line.split()
    if not words:
        return
    if words[0] in ("comment", "obj_info"):
        header.comments.append(line.strip().partition(" ")[2])
    elif words[0] == "format" and len(words) == 3 and words[1] in _FORMATS and words[2] == "1.0":
        header.order = _FORMATS[words[1]]
    elif words[0] == "element" and len(words) == 3:
        count = words[2] if words[2].isascii() and words[2].isdigit() and len(words[2]) < 19 else "-1"
        if int(count) < 0:
            raise file_error(owner, f"{where}: element {words[1][:32]}", "a number of rows from 0", quoted(words[2]))
        header.elements.append(Element(words[1], int(count)))
    elif words[0] == "property" and header.elements and _property(header.elements[-1], words[1:]):
        return
    else:
        raise file_error(owner, where, "a line of a PLY header (format, element, property ...)", quoted(line))


def _property(element: Element, words: list[str]) -> bool:
    """Add a property; return whether its words define one, with a new name."""
    single = len(words) == 2 and words[0] in _TYPES
    listed = len(words) == 4 and words[0] == "list" and words[1] in _TYPES and words[2] in _TYPES
    listed = listed and _TYPES[words[1]][0] in "iu"
    if not (single or listed) or any(words[-1] == known.name for known in element.properties):
        return False
    kinds = [_TYPES[word] for word in (words[:-1] if single else words[1:-1])]
    element.properties.append(Property(words[-1], kinds[-1], "" if single else kinds[0]))
    return True


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
    values: Array = chosen.view(kind).astype(kind.newbyteorder("="))
    return values


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
                length = words[place] if place < len(words) else -1.0
                place += 1
            if not (length >= 0.0 and length.is_integer() and place + length <= len(words)):
                where = f"element {element.name}: row {row}: {element.properties[number].name}"
                raise file_error(owner, where, "a length and as many values", f"{length:g}, or the end of the file")
            starts[number].append(place)
            counts[number].append(int(length))
            place += int(length)
    for number, item in enumerate(element.properties):
        start, length_of = np.array(starts[number]), np.array(counts[number])
        chosen = _gathered_values(values[first:], start, length_of)
        element.columns[item.name] = (chosen, length_of) if item.count else chosen
    return first + place


def _gathered_values(values: Array, start: Array, length: Array) -> Array:
    before = np.cumsum(length) - length
    return values[np.repeat(start - before, length) + np.arange(int(length.sum()))]
