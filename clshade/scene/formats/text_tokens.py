"""Wavefront OBJ text split into chunks, lines and tokens, and tokens converted to numbers, vectorized."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...base.arrays import Array
from ...base.input_files import file_error

CHUNK = 1 << 20  # bytes of text taken at once
MAX_LINE = 1 << 24  # bytes; a chunk grows up to this, and its tokens take 32 times as much memory

KEYWORDS = {int.from_bytes(text.encode(), "little"): text for text in ("v", "vt", "vn", "f")}
V, VT, VN, F = KEYWORDS
_COMMENT = re.compile(rb"(?<!\S)#")
_LINE_END = re.compile(rb"(?<!\\)(?<!\\\r)\n")
_NUMERIC = tuple(keyword.encode() for keyword in KEYWORDS.values())
_BLANKS = b" \t\r\n\v\f"
# Translation tables: 1 for each blank; a space for each blank, and 255 for other bytes that are not printable ASCII.
_IS_BLANK = bytes(byte in _BLANKS for byte in range(256))
_SPACED = bytes(32 if byte in _BLANKS else byte if 32 < byte < 127 else 255 for byte in range(256))


def is_blank(text: bytes) -> Array:
    """Return (len(text),) bool."""
    return np.frombuffer(text.translate(_IS_BLANK), bool)


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a chunk that are not blank. text: the chunk between two line ends. starts, ends: (T,) of its tokens.
    first: (L,) the token that opens a line. count: (L,) tokens after it. kind: (L,) V, VT, VN, F, or 0 for another keyword.
    """

    text: bytes
    starts: Array
    ends: Array
    first: Array
    count: Array
    kind: Array

    def token(self, index: int) -> bytes:
        return self.text[self.starts[index] : self.ends[index]]


def chunks(data: bytes, owner: str) -> Iterator[tuple[int, bytes]]:
    """Yield (offset, text) pieces of whole lines of the file; lines continued by a backslash are not split. Raises
    InputError for a line, including its continuation, of more than MAX_LINE bytes."""
    start = 0
    while start < len(data):
        last = _LINE_END.search(data, start + CHUNK - 1, start + CHUNK + MAX_LINE)
        end = last.end() if last else len(data)
        if end - start > CHUNK + MAX_LINE:
            raise file_error(owner, "line", f"lines of at most {MAX_LINE} bytes", "a longer one")
        yield start, data[start:end]
        start = end


def blank_comments(chunk: bytes) -> bytes:
    """Return the chunk with comments and continued line ends blanked; every other byte keeps its position.

    In a line of numbers a comment begins at a # after a blank; a line with a name (usemtl ...) has none.
    """
    if b"#" not in chunk and b"\\" not in chunk:
        return chunk
    text = bytearray(chunk)
    place = text.find(b"#")
    while place >= 0:
        start, end = text.rfind(b"\n", 0, place) + 1, text.find(b"\n", place)
        end = end if end >= 0 else len(text)
        keyword = bytes(text[start:place]).split(None, 1)[:1]
        comment = _COMMENT.search(text, place, end)
        if comment and (not keyword or keyword[0] in _NUMERIC):
            text[comment.start() : end] = b" " * (end - comment.start())
        place = text.find(b"#", end)
    return bytes(text).replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")


def tokenize(chunk: bytes) -> Lines:
    text = b"\n" + chunk + b"\n"
    letters, blank = np.frombuffer(text, np.uint8), is_blank(text)
    edges = np.flatnonzero(blank[1:] != blank[:-1]) + 1
    starts, ends = edges[0::2], edges[1::2]
    first = np.searchsorted(starts, np.flatnonzero(letters == ord("\n")))
    first = first[first < len(starts)]
    first = first[np.flatnonzero(np.diff(first, prepend=-1))]
    count = np.diff(first, append=len(starts)) - 1
    start = starts[first]
    length = ends[first] - start
    keyword = letters[start].astype(np.int32)
    keyword += np.where(length == 2, letters[start + 1].astype(np.int32) << 8, 0)
    kind = np.where((length <= 2) & np.isin(keyword, list(KEYWORDS)), keyword, 0)
    return Lines(text, starts, ends, first, count, kind)


def arguments(lines: Lines, chosen: Array) -> bytes:
    """Return the text after the keyword in the lines with the indices `chosen`, each with blanks around it."""
    letters, first = np.frombuffer(lines.text, np.uint8), lines.first[chosen]
    if len(chosen) == len(lines.first):  # the usual case: all but the keywords
        letters = letters.copy()
        letters[lines.starts[first]] = letters[lines.ends[first] - 1] = ord(" ")
        joined: bytes = letters.tobytes()
        return joined
    steps = np.zeros(len(letters) + 1, np.int8)
    steps[lines.ends[first]] = 1
    steps[lines.ends[first + lines.count[chosen]] + 1] = -1
    selected: bytes = letters[np.cumsum(steps[:-1], dtype=np.int8).view(bool)].tobytes()
    return selected


def numbers(text: bytes, dtype: type, count: int) -> Array | None:
    """Parse (count,) numbers from blank-separated text; None if it holds anything else or another number of them.

    `nan` and `inf` are numbers of type float. No `_`, no hexadecimal, no decimal point in a number of type int.
    """
    if count == 0:
        return np.zeros(0, dtype)
    try:
        line = text.translate(_SPACED).decode("ascii")
        if dtype is int and any(letter in line for letter in ".eEnN"):  # NumPy 1 reads an int by way of a float
            return None
        values: Array = np.loadtxt([line], dtype=dtype, comments=None, ndmin=1, encoding=None)
    except ValueError:
        return None
    return values if len(values) == count else None
