"""Radiance HDR images (.hdr, .pic): RGBE pixels, run-length encoded. No library that clshade needs reads them.

The format is that of Ward, Real Pixels, Graphics Gems II, and of Radiance's reference manual: text lines, an empty line,
a line with the size, and scanlines of pixels of three mantissas and a common exponent. A channel is m * 2^(e - 136), and
0 where e is 0. A scanline of 8 to 32767 pixels is run-length encoded if it begins with 2, 2 and its length in two bytes.
"""

from __future__ import annotations

import re
import warnings

import numpy as np

from ..base.arrays import Array, Bytes, Floats, Floats32
from ..base.input_files import file_error, quoted

SIGNATURE = b"#?"  # and the name of the program that wrote it: RADIANCE, RGBE ...
_MAX_HEADER = 1 << 16  # bytes
_END = re.compile(rb"\r?\n\r?\n([-+])([XY])[ \t]+(\d{1,6})[ \t]+([-+])(?!\2)[XY][ \t]+(\d{1,6})[ \t]*\r?\n")
_COUNTS = {b"EXPOSURE": 1, b"COLORCORR": 3}  # numbers that each of these lines multiplies the image by


def decode(data: bytes, owner: str, *, max_side: int, max_pixels: int) -> Floats32:
    """Decode a file to (h, w, 3) linear RGB, row 0 at the top; values in EXPOSURE and COLORCORR lines are divided out.

    Raises InputError, one line that names `owner`, for another format, a damaged file, or too large an image. Warns of
    lines that it ignores.
    """
    if not data.startswith(SIGNATURE):
        raise file_error(owner, "file", "a Radiance HDR image", quoted(data[:16]))
    size = _END.search(data, 0, _MAX_HEADER)
    if size is None:
        expected = "an empty line and one such as -Y 512 +X 1024 at its end"
        raise file_error(owner, "header", expected, quoted(data[:_MAX_HEADER].partition(b"\n\n")[2][:32]) or "none")
    rows, columns = int(size[3]), int(size[5])
    if not (rows and columns) or max(rows, columns) > max_side or rows * columns > max_pixels:
        expected = f"pixels, at most {max_side} a side and {max_pixels} in all"
        raise file_error(owner, "image", expected, f"{rows} scanlines of {columns}")
    if (len(data) - size.end()) * 64 < rows * columns:  # a run of at most 127 values takes 2 bytes
        raise file_error(owner, "image", f"{rows} scanlines of {columns} pixels", f"{len(data) - size.end()} bytes")
    scale = np.ldexp(1.0 / _multipliers(data[: size.start()], owner), np.arange(256)[:, None] - 136)  # by the exponent
    scale[0] = 0.0
    codes = _pixels(data, size.end(), rows, columns, owner)
    image = np.empty((rows, columns, 3), np.float32)
    for row, line in zip(image, codes, strict=True):  # one at a time: float64 takes eight times the memory of codes
        row[:] = np.minimum(line[:, :3] * scale[line[:, 3]], np.finfo(np.float32).max)
    sign = {size[2]: size[1], b"Y" if size[2] == b"X" else b"X": size[4]}
    image = image if size[2] == b"Y" else image.swapaxes(0, 1)
    return image[:: -1 if sign[b"Y"] == b"+" else 1, :: -1 if sign[b"X"] == b"-" else 1]


def _multipliers(header: bytes, owner: str) -> Floats:
    """Return what a header says that red, green and blue have been multiplied by, (3,), positive and finite."""
    product = np.ones(3)
    for line in header.splitlines():
        name, _, value = (part.strip() for part in line.partition(b"="))
        if name == b"FORMAT" and value != b"32-bit_rle_rgbe":
            raise file_error(owner, "FORMAT", "32-bit_rle_rgbe", quoted(value))
        if name in _COUNTS:
            try:
                factors = np.array([float(word) for word in value.split()])
            except ValueError:
                factors = np.zeros(0)
            if len(factors) == _COUNTS[name] and ((product * factors > 1e-30) & (product * factors < 1e30)).all():
                product = product * factors
            else:  # FreeImage and others write EXPOSURE=0 for an unknown one
                problem = f"{quoted(value)} is ignored: expected positive numbers"
                warnings.warn(f"{owner}: {name.decode()}: {problem}", stacklevel=2)
    return product


def _pixels(data: bytes, place: int, rows: int, columns: int, owner: str) -> Bytes:
    """Return the codes (h, w, 4)."""
    codes = np.empty((rows, columns, 4), np.uint8)
    for row in range(rows):
        mark = data[place : place + 3]
        if not (8 <= columns < 32768 and mark[:2] == b"\x02\x02" and mark[2:] < b"\x80"):
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
        line = bytearray()
        while len(line) < columns:
            if place + 1 >= len(data):
                raise file_error(owner, "image", f"{columns} pixels in row {row}", "the end of the file")
            run = data[place] > 128
            count = data[place] - 128 * run
            line += data[place + 1 : place + 2] * count if run else data[place + 1 : place + 1 + count]
            place += 2 if run else 1 + count
            if not count or len(line) > columns:
                raise file_error(owner, "image", f"runs that fill row {row}", "a run of another length")
        target[:, channel] = np.frombuffer(line, np.uint8)
    return place


def _old_pixels(data: bytes, place: int, rows: int, columns: int, owner: str) -> Bytes:
    """Return the codes (h, w, 4) of pixels one by one, where (1, 1, 1, n) repeats the one before n times; the counts of
    several such in a row are the digits of a number with base 256, lowest first."""
    records = min((len(data) - place) // 4, rows * columns)  # of at least one pixel
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
    codes: Array = np.repeat(pixels[source[:used]], counts[:used], axis=0)
    return codes.reshape(rows, columns, 4)
