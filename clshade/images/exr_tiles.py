"""A tiled OpenEXR file put together from files of one tile each, without decoding them and with little memory.

The layout is that of "The OpenEXR File Layout" (openexr.com): a header, a table of offsets, and chunks, each with the
place of its tile. OpenEXR's own module writes whole images only.
"""

from __future__ import annotations

import io
import shutil
import struct
from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import shown
from ..base.input_files import file_error, reason_of
from . import exr, exr_limits

_MAX_HEADER = 1 << 20  # bytes: names of many instances may be in it
_CHUNK = struct.Struct("<5i")  # column and row of a tile, its levels, bytes of its pixels
_SAME = (b"channels", b"compression")  # attributes that tiles share with the whole


def header(
    channels: Mapping[str, Array],
    resolution: tuple[int, int],
    tile: int,
    *,
    compression: exr.Compression,
    half: bool,
    metadata: Mapping[str, Any],
) -> bytes:
    """Return the header of a tiled file, up to the table of offsets.

    channels: of any size, for names and types. resolution: (N, M) of the whole. tile: pixels a side.
    """
    first = {name: np.asarray(plane)[:1, :1] for name, plane in exr.flatten(channels).items()}
    file = io.BytesIO()
    exr.encode(file, first, compression=compression, half=half, metadata=metadata, tiled=True)
    data = file.getvalue()
    window = struct.pack("<4i", 0, 0, resolution[0] - 1, resolution[1] - 1)
    changed = {b"dataWindow": window, b"displayWindow": window, b"tiles": struct.pack("<2I", tile, tile) + b"\0"}
    written, end = bytearray(data), exr_limits.START
    for name, value, after in exr_limits.attributes(data, exr_limits.START):
        end = after
        if name in changed:
            assert len(value) == len(changed[name])
            written[end - len(value) : end] = changed[name]
    return bytes(written[: end + 1])


def join(file: BinaryIO, start: bytes, tiles: Iterable[str], across: int, down: int) -> None:
    """Write a tiled EXR to an open file.

    start: of `header`. tiles: names of `across` times `down` files of one tile each, row by row from the top, each with
    the channels and the compression of the header. Raises InputError for a file that is not one of them.
    """
    shared = _attributes(start)
    table = len(start)
    file.write(start)
    file.write(bytes(8 * across * down))
    offsets = np.zeros(across * down, np.uint64)
    for number, name in enumerate(tiles):
        offsets[number] = file.tell()
        with open(name, "rb") as one:
            size = _chunk_size(one, shared, name)
            file.write(_CHUNK.pack(number % across, number // across, 0, 0, size))
            shutil.copyfileobj(one, file, 1 << 20)
    end = file.tell()
    file.seek(table)
    file.write(offsets.tobytes())
    file.seek(end)


def _attributes(data: bytes) -> dict[bytes, bytes]:
    return {name: value for name, value, _ in exr_limits.attributes(data, exr_limits.START)}


def _chunk_size(one: BinaryIO, shared: dict[bytes, bytes], name: str) -> int:
    """Return the bytes of the only tile's pixels, with the file at their first. Raises InputError for another file."""
    data = one.read(_MAX_HEADER)
    try:
        if not data.startswith(exr_limits.MAGIC):
            raise ValueError("something else")
        end = exr_limits.START
        for key, value, after in exr_limits.attributes(data, exr_limits.START):
            end = after
            if key in _SAME and value != shared[key]:
                raise ValueError(f"other {key.decode()}")
        (offset,) = struct.unpack_from("<Q", data, end + 1)
        one.seek(offset)
        size: int = _CHUNK.unpack(one.read(_CHUNK.size))[4]
        rest = one.seek(0, io.SEEK_END) - offset - _CHUNK.size
        if rest != size:
            raise ValueError(f"{rest} bytes of its pixels")
        one.seek(offset + _CHUNK.size)
    except (IndexError, struct.error):
        raise file_error(shown(name), "file", "a tile of this image", "a damaged one") from None
    except ValueError as error:
        raise file_error(shown(name), "file", "a tile of this image", reason_of(error)) from None
    return size
