"""A tiled OpenEXR file put together from files of one tile each, without decoding them and with little memory.

The layout is that of "The OpenEXR File Layout" (openexr.com): a header, a table of offsets, and chunks, each with the
place of its tile. OpenEXR's own module writes whole images only.
"""

from __future__ import annotations

import io
import shutil
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from ..base.atomic_files import shown
from ..base.input_files import file_error, reason_of
from . import exr, exr_limits

_CHUNK = struct.Struct("<5i")  # column and row of a tile, its levels, bytes of its pixels
_SHARED = (b"channels", b"compression")  # attributes that a tile has in common with the whole

Attributes: TypeAlias = dict[bytes, tuple[bytes, bytes]]  # name -> type and value


def _header(file: BinaryIO, name: str) -> tuple[int, Attributes]:
    """Read the version, the file's second word, and the header. Raises InputError, naming the file, if it has none."""
    if file.read(4) != exr_limits.MAGIC:
        raise file_error(shown(name), "file", "a tile of this image", "something else")
    version = int.from_bytes(file.read(4), "little")
    try:
        return version, {key: (kind, value) for key, kind, value in exr_limits.attributes(file)}
    except ValueError:
        raise file_error(shown(name), "file", "a tile of this image", "a damaged one") from None


@contextmanager
def _opened(name: str) -> Iterator[BinaryIO]:
    try:
        file = open(name, "rb")  # noqa: SIM115  (errors of the block are not those of opening)
    except OSError as error:
        raise file_error(shown(name), "file", "a tile of this image", reason_of(error)) from None
    with file:
        yield file


def header(tile_name: str, resolution: tuple[int, int], tile: int, metadata: Mapping[str, Any]) -> bytes:
    """Return the header of a tiled file, up to the table of offsets.

    tile_name: a file of one of the tiles, which has their channels and compression. resolution: (N, M) of the whole. tile:
    pixels a side. metadata: as for `exr.write`. Raises InputError if the file cannot be read.
    """
    with _opened(tile_name) as one:
        tile_version, shared = _header(one, tile_name)
    file = io.BytesIO()
    exr.encode(file, np.zeros((1, 1, 3), np.float32), metadata=metadata, tiled=True)
    file.seek(0)
    version, attributes = _header(file, "")
    attributes |= {name: shared[name] for name in _SHARED}
    window = struct.pack("<4i", 0, 0, resolution[0] - 1, resolution[1] - 1)
    size = struct.pack("<2I", tile, tile) + attributes[b"tiles"][1][8:]
    for name, value in ((b"dataWindow", window), (b"displayWindow", window), (b"tiles", size)):
        attributes[name] = attributes[name][0], value
    start = exr_limits.MAGIC + (version | tile_version).to_bytes(4, "little")  # a bit of it tells of long names
    stored = (
        b"\0".join([name, kind, len(value).to_bytes(4, "little") + value]) for name, (kind, value) in attributes.items()
    )
    return start + b"".join(stored) + b"\0"


def join(file: BinaryIO, start: bytes, tiles: Iterable[str], across: int, down: int) -> None:
    """Write a tiled EXR to an open file.

    start: from `header`. tiles: names of `across` times `down` files of one tile each, row by row from the top, each with
    the channels and the compression of the header. Raises InputError for a file that is not one of them.
    """
    _, shared = _header(io.BytesIO(start), "")
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


def _seek_pixels(file: BinaryIO, shared: Attributes, name: str) -> int:
    """Go to the pixels of a file's only tile, which end with the file; return their bytes. Raises InputError for another
    file."""
    _, own = _header(file, name)
    for key in _SHARED:
        if own.get(key) != shared[key]:
            raise file_error(shown(name), "file", "a tile of this image", f"one with other {key.decode()}")
    offset = int.from_bytes(file.read(8), "little")
    rest = file.seek(0, io.SEEK_END) - offset - _CHUNK.size
    if offset and rest >= 0:
        file.seek(offset)
        size: int = _CHUNK.unpack(file.read(_CHUNK.size))[4]
        if size == rest:
            return size
    raise file_error(shown(name), "file", "a tile of this image", "one that does not end with its pixels")
