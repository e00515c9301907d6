"""A tiled OpenEXR file put together from files of one tile each, without decoding them and with little memory.

The layout is that of "The OpenEXR File Layout" (openexr.com): a header, a table of offsets, and chunks, each with the
place of its tile. OpenEXR's own module writes whole images only.
"""

from __future__ import annotations

import io
import shutil
import struct
from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from ..base.atomic_files import shown
from ..base.input_files import file_error, reason_of
from . import exr, exr_limits

_READ = 1 << 16  # bytes of a file that are read at first; names of many instances make headers longer
_CHUNK = struct.Struct("<5i")  # column and row of a tile, its levels, bytes of its pixels
_SHARED = (b"channels", b"compression")  # attributes that a tile has in common with the whole


class _Header(NamedTuple):
    """version: the file's second word. values, raw: of each attribute, its value, and all that is stored of it. end: where
    the header ends, with its null byte."""

    version: int
    values: dict[bytes, bytes]
    raw: dict[bytes, bytes]
    end: int


def _parsed(data: bytes) -> _Header:
    """Return the header at the beginning of a file. Raises IndexError or ValueError if it is not whole."""
    begin, values, raw = exr_limits.START, {}, {}
    for name, value, after in exr_limits.attributes(data, begin):
        values[name], raw[name] = value, data[begin:after]
        begin = after
    return _Header(int.from_bytes(data[4:8], "little"), values, raw, begin + 1)


def _read(file: BinaryIO, name: str) -> _Header:
    """Return the header of an open file. Raises InputError, naming it, if it has none."""
    size = _READ
    while True:
        file.seek(0)
        data = file.read(size)
        if not data.startswith(exr_limits.MAGIC):
            raise file_error(shown(name), "file", "a tile of this image", "something else")
        try:
            return _parsed(data)
        except (IndexError, ValueError):
            if len(data) < size:
                raise file_error(shown(name), "file", "a tile of this image", "a damaged one") from None
        size *= 4


def _opened(name: str) -> BinaryIO:
    try:
        return open(name, "rb")
    except OSError as error:
        raise file_error(shown(name), "file", "a tile of this image", reason_of(error)) from None


def header(tile_name: str, resolution: tuple[int, int], tile: int, metadata: Mapping[str, Any]) -> bytes:
    """Return the header of a tiled file, up to the table of offsets.

    tile_name: a file of one of the tiles, which has their channels and compression. resolution: (N, M) of the whole. tile:
    pixels a side. metadata: as for `exr.write`. Raises InputError if the file cannot be read.
    """
    with _opened(tile_name) as one:
        shared = _read(one, tile_name)
    file = io.BytesIO()
    exr.encode(file, np.zeros((1, 1, 3), np.float32), metadata=metadata, tiled=True)
    own = _parsed(file.getvalue())
    raw = {**own.raw, **{name: shared.raw[name] for name in _SHARED}}
    window = struct.pack("<4i", 0, 0, resolution[0] - 1, resolution[1] - 1)
    size = struct.pack("<2I", tile, tile) + own.values[b"tiles"][8:]
    for name, value in ((b"dataWindow", window), (b"displayWindow", window), (b"tiles", size)):
        raw[name] = raw[name][: -len(value)] + value
    # A bit of the version tells of long names.
    return exr_limits.MAGIC + (own.version | shared.version).to_bytes(4, "little") + b"".join(raw.values()) + b"\0"


def join(file: BinaryIO, start: bytes, tiles: Iterable[str], across: int, down: int) -> None:
    """Write a tiled EXR to an open file.

    start: of `header`. tiles: names of `across` times `down` files of one tile each, row by row from the top, each with
    the channels and the compression of the header. Raises InputError for a file that is not one of them.
    """
    shared = _parsed(start).values
    file.write(start)
    file.write(bytes(8 * across * down))
    offsets = np.zeros(across * down, np.uint64)
    for number, name in enumerate(tiles):
        offsets[number] = file.tell()
        with _opened(name) as one:
            size = _seek_pixels(one, shared, name)
            file.write(_CHUNK.pack(number % across, number // across, 0, 0, size))
            shutil.copyfileobj(one, file, 1 << 20)
    end = file.tell()
    file.seek(len(start))
    file.write(offsets.tobytes())
    file.seek(end)


def _seek_pixels(one: BinaryIO, shared: dict[bytes, bytes], name: str) -> int:
    """Go to the pixels of a file's only tile, which end with the file; return their bytes. Raises InputError for another
    file."""
    found = _read(one, name)
    for key in _SHARED:
        if found.values.get(key) != shared[key]:
            raise file_error(shown(name), "file", "a tile of this image", f"one with other {key.decode()}")
    one.seek(found.end)
    table = one.read(8)
    offset = int.from_bytes(table, "little")
    one.seek(0, io.SEEK_END)
    rest = one.tell() - offset - _CHUNK.size
    if len(table) == 8 and rest >= 0:
        one.seek(offset)
        size: int = _CHUNK.unpack(one.read(_CHUNK.size))[4]
        if size == rest:
            return size
    raise file_error(shown(name), "file", "a tile of this image", "one that does not end with its pixels")
