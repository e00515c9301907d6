"""Gray and RGB images of the PNM family, text and binary, with any maximum value: Pillow keeps only 8 bits of color."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array
from ..base.input_files import file_error, quoted

_MAX_HEADER = 1 << 16  # bytes, mostly for comments
_CHUNK = 1 << 20  # bytes of text taken at once
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_NUMBER = rb"(\d{1,9})"
# A comment may follow the last number directly; a single white space precedes the pixels.
_HEADER = re.compile(rb"P([2356])" + (_GAP + _NUMBER) * 3 + rb"(?:#[^\r\n]*)?\s")
_COMMENT = re.compile(rb"#[^\r\n]*")
_SPACE, _LINE_END = re.compile(rb"\s"), re.compile(rb"[\r\n]")


@dataclass(frozen=True)
class Header:
    """The header of a PNM image. channels: 1 or 3. most: the maximum value. start: byte offset of the pixels."""

    width: int
    height: int
    channels: int
    most: int
    is_text: bool
    start: int


def header(data: bytes, owner: str) -> Header | None:
    """Parse the header of a PGM or PPM file (P2, P3, P5, P6); None for anything else.

    Raises InputError if it is malformed, and if the file has fewer bytes than its pixels take.
    """
    if data[:1] != b"P" or data[1:2] not in (b"2", b"3", b"5", b"6"):
        return None
    match = _HEADER.match(data, 0, _MAX_HEADER)
    if match is None:
        raise file_error(owner, "image", "width, height and largest value of a PNM image", quoted(data[:32]))
    kind, width, height, most = (int(number) for number in match.groups())
    if not (width and height and 0 < most < 1 << 16):
        expected = "a PNM image with pixels and a largest value from 1 to 65535"
        raise file_error(owner, "image", expected, f"{width} x {height} with {most}")
    found = Header(width, height, 3 if kind in (3, 6) else 1, most, kind < 4, match.end())
    count = width * height * found.channels
    least = 2 * count - 1 if found.is_text else count * (1 if most < 256 else 2)
    if least > len(data) - found.start:
        expected = f"at least {least} bytes for {width} x {height} pixels"
        raise file_error(owner, "image", expected, f"{len(data) - found.start} bytes")
    return found


def codes(data: bytes, found: Header, owner: str) -> Array:
    """Return (h, w, 1 or 3) uint8 or uint16 values from 0 to found.most. Data after the first image is ignored.

    Raises InputError for text in place of a number, and for values above found.most.
    """
    count = found.width * found.height * found.channels
    kind = np.dtype(np.uint8 if found.most < 256 else ">u2")
    if found.is_text:
        values = _text_values(data, found, count, kind.newbyteorder("="), owner)
    else:
        values = np.frombuffer(data, kind, count, found.start).astype(kind.newbyteorder("="), copy=False)
    if values.max() > found.most:
        raise file_error(owner, "image", f"values up to {found.most}", str(values.max()))
    return values.reshape(found.height, found.width, found.channels)


def _text_values(data: bytes, found: Header, count: int, kind: np.dtype, owner: str) -> Array:
    values, place, start = np.empty(count, kind), 0, found.start
    while place < count:
        if start >= len(data):
            raise file_error(owner, "image", f"{count} values", str(place))
        end = _end(_SPACE, data, start + _CHUNK)  # at a space: never within a number
        line = max(data.rfind(b"\n", start, end), data.rfind(b"\r", start, end)) + 1
        if data.find(b"#", max(line, start), end) >= 0:  # or a comment
            end = _end(_LINE_END, data, end + 1)
        part = _numbers(_COMMENT.sub(b"", data[start:end]), count - place, owner)
        if len(part) and part.max() > found.most:
            raise file_error(owner, "image", f"values up to {found.most}", str(part.max()))
        values[place : place + len(part)] = part
        place, start = place + len(part), end
    return values


def _end(pattern: re.Pattern[bytes], data: bytes, least: int) -> int:
    """Return the end of the first match of a one-byte pattern that ends at `least` bytes or later, or of the data."""
    found = pattern.search(data, least - 1)
    return found.end() if found else len(data)


def _numbers(text: bytes, most: int, owner: str) -> Array:
    """Return the integers in text, at most `most`."""
    words = text.split(None, most)[:most]
    bad = next((word for word in words if not (word.isdigit() and len(word) < 10)), None)
    if bad is not None:
        raise file_error(owner, "image", "whole numbers", quoted(bad))
    return np.array(words, dtype="S9").astype(np.int64)
