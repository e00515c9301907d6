"""Radiance HDR images (.hdr, .pic): RGBE pixels, run-length encoded. No library that clshade needs reads them.

The format is that of Ward, Real Pixels, Graphics Gems II, and of Radiance's reference manual: text lines, an empty line,
a line with the size, and rows of pixels of three mantissas and a common exponent. A channel is m * 2^(e - 136), and 0
where e is 0. A row of 8 to 32767 pixels is run-length encoded if it begins with 2, 2 and its length in two bytes.
"""

from __future__ import annotations

import re

import numpy as np

from ..base.arrays import Array, Bytes, Floats32
from ..base.input_files import file_error, quoted

SIGNATURES = (b"#?RADIANCE", b"#?RGBE")
_MAX_HEADER = 1 << 16  # bytes
_SIZE = re.compile(rb"([-+])Y +(\d{1,6}) +([-+])X +(\d{1,6})\n")


def decode(data: bytes, owner: str, *, most_side: int, most_pixels: int) -> Floats32:
    """Decode a file to (h, w, 3) linear RGB, row 0 at the top; values in EXPOSURE lines are divided out.

    Raises InputError, one line that names `owner`, for another format, a damaged file, or too large an image.
    """
    rows, columns, exposure, place, turned = _header(data, owner)
    if not (rows and columns) or max(rows, columns) > most_side or rows * columns > most_pixels:
        expected = f"pixels, at most {most_side} a side and {most_pixels} in all"
        raise file_error(owner, "image", expected, f"{columns} x {rows}")
    if (len(data) - place) * 64 < rows * columns:  # a run of at most 127 values takes 2 bytes
        raise file_error(owner, "image", f"{columns} x {rows} pixels", f"{len(data) - place} bytes")
    codes = _pixels(data, place, rows, columns, owner)
    scale = np.ldexp(1.0 / exposure, np.arange(256) - 136)  # by the exponent's code
    scale[0] = 0.0
    most = float(np.finfo(np.float32).max)
    image = np.empty((rows, columns, 3), np.float32)
    for row, line in zip(image, codes, strict=True):  # one at a time: float64 takes eight times the memory of codes
        row[:] = np.minimum(line[:, :3] * scale[line[:, 3], None], most)
    return image[:: -1 if turned[0] else 1, :: -1 if turned[1] else 1]


def _header(data: bytes, owner: str) -> tuple[int, int, float, int, tuple[bool, bool]]:
    """Return rows, columns, exposure, where the pixels begin, and whether rows and columns run the other way."""
    if not data.startswith(SIGNATURES):
        raise file_error(owner, "file", "a Radiance HDR image", quoted(data[:16]))
    end = data.find(b"\n\n", 0, _MAX_HEADER)
    if end < 0:
        raise file_error(owner, "header", "an empty line at its end", "none")
    exposure = 1.0
    for line in data[:end].split(b"\n"):
        name, _, value = line.partition(b"=")
        if name == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise file_error(owner, "FORMAT", "32-bit_rle_rgbe", quoted(value.strip()))
        if name == b"EXPOSURE":
            try:
                exposure *= float(value)
            except ValueError:
                exposure = 0.0
            if not 1e-30 < exposure < 1e30:
                raise file_error(owner, "EXPOSURE", "a number from 1e-30 to 1e30", quoted(value.strip()))
    size = _SIZE.match(data, end + 2)
    if size is None:
        raise file_error(owner, "size", "a line such as -Y 512 +X 1024", quoted(data[end + 2 : end + 34]))
    turned = size[1] == b"+", size[3] == b"-"
    return int(size[2]), int(size[4]), exposure, size.end(), turned


def _pixels(data: bytes, place: int, rows: int, columns: int, owner: str) -> Bytes:
    """Return the codes (h, w, 4)."""
    codes = np.empty((rows, columns, 4), np.uint8)
    for row in range(rows):
        if not (
            8 <= columns < 32768 and data[place : place + 2] == b"\x02\x02" and data[place + 2 : place + 3] < b"\x80"
        ):
            if row:
                raise file_error(owner, "image", f"run-length encoded row {row}", "something else")
            return _old_pixels(data, place, rows, columns, owner)
        if int.from_bytes(data[place + 2 : place + 4], "big") != columns:
            raise file_error(owner, "image", f"{columns} pixels in row {row}", "another number")
        place = _row(data, place + 4, codes[row], owner, row)
    return codes


def _row(data: bytes, place: int, target: Bytes, owner: str, row: int) -> int:
    """Fill one row (w, 4), channel after channel; return where the next one begins."""
    columns = len(target)
    for channel in range(4):
        parts: list[bytes] = []
        filled = 0
        while filled < columns:
            if place + 1 >= len(data):
                raise file_error(owner, "image", f"{columns} pixels in row {row}", "the end of the file")
            count = data[place]
            if count > 128:
                count -= 128
                parts.append(data[place + 1 : place + 2] * count)
                place += 2
            else:
                parts.append(data[place + 1 : place + 1 + count])
                place += 1 + count
            filled += count
            if not count or filled > columns:
                raise file_error(owner, "image", f"runs that fill row {row}", "a run of another length")
        line = b"".join(parts)
        if len(line) != columns:
            raise file_error(owner, "image", f"{columns} pixels in row {row}", "the end of the file")
        target[:, channel] = np.frombuffer(line, np.uint8)
    return place


def _old_pixels(data: bytes, place: int, rows: int, columns: int, owner: str) -> Bytes:
    """Return the codes (h, w, 4) of pixels one by one, where (1, 1, 1, n) repeats the one before n times; the counts of
    several such in a row are the digits of a number with base 256, lowest first."""
    records = min((len(data) - place) // 4, rows * columns)  # each is a pixel at least
    pixels = np.frombuffer(data, np.uint8, 4 * records, place).reshape(-1, 4)
    counts = np.ones(len(pixels), np.int64)
    repeats = np.flatnonzero((pixels[:, :3] == 1).all(axis=1))
    shift, last = 0, -2
    for index in repeats.tolist():
        shift = shift + 8 if index == last + 1 else 0
        counts[index] = min(int(pixels[index, 3]) << min(shift, 32), rows * columns)
        last = index
    source = np.arange(len(pixels))
    source[repeats] = -1
    source = np.maximum.accumulate(source) if len(source) else source
    filled = np.cumsum(np.minimum(counts, rows * columns))
    used = int(np.searchsorted(filled, rows * columns)) + 1
    if used > len(pixels) or filled[used - 1] != rows * columns or source[0] < 0:
        raise file_error(owner, "image", f"{columns} x {rows} pixels", "another number")
    found: Array = np.repeat(pixels[source[:used]], counts[:used], axis=0)
    return found.reshape(rows, columns, 4)
