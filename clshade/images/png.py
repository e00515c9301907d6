"""PNG files of 8-bit display images, through Pillow (imported on first use)."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterable
from typing import BinaryIO

import numpy as np

from ..base import atomic_files
from ..base.atomic_files import Path
from ..errors import InputError
from .decode import read_png

_LEVEL = 1  # of zlib: the filters take most of the time, and higher levels gain little on renders
PAGE_LEVEL = 6  # of pictures in a page, which may be enlarged pixels, zlib's own default
SIGNATURE = b"\x89PNG\r\n\x1a\n"


def write(path: Path, rgb8: np.ndarray) -> None:
    """Write an image as PNG, atomically; the same image gives the same bytes.

    rgb8: uint8 (M, N, 3), or with straight alpha (M, N, 4), row 0 at the top, as `Frame.to_png8` returns it; need not be
    contiguous.
    Raises InputError for another shape or type, OutputError if the file cannot be written.
    """
    rgb8 = np.asarray(rgb8)
    if rgb8.ndim != 3 or rgb8.shape[2] not in (3, 4) or 0 in rgb8.shape or rgb8.dtype != np.uint8:
        found = f"{rgb8.dtype} of shape {rgb8.shape}"
        raise InputError(f"png: rgb8: expected uint8 of shape (M, N, 3) or (M, N, 4), found {found}")
    with atomic_files.replacing(path) as file:
        encode(file, rgb8)


def encode(file: BinaryIO, rgb8: np.ndarray, level: int = _LEVEL) -> None:
    """Encode an image as PNG into an open file, see `write`. level: of zlib."""
    from PIL import Image

    Image.fromarray(np.ascontiguousarray(rgb8)).save(file, "PNG", compress_level=level)


def encode_bands(file: BinaryIO, columns: int, rows: int, bands: Iterable[np.ndarray]) -> None:
    """Encode an image of any size as PNG into an open file, holding one band of it at a time: Pillow takes whole images.

    bands: uint8 (K, columns, 3), or (K, columns, 4) with straight alpha, from the top, `rows` rows in all.
    """

    def chunk(kind: bytes, data: bytes) -> None:
        check = zlib.crc32(data, zlib.crc32(kind))
        file.write(len(data).to_bytes(4, "big") + kind + data + check.to_bytes(4, "big"))

    packed = zlib.compressobj(_LEVEL)
    above, left = None, rows
    for band in bands:
        if above is None:
            above = np.zeros((columns, band.shape[2]), np.uint8)
            file.write(SIGNATURE)
            chunk(b"IHDR", struct.pack(">2I5B", columns, rows, 8, {3: 2, 4: 6}[band.shape[2]], 0, 0, 0))
        for row in band:
            # Of the filters Sub and Up the one whose differences are smaller, as the PNG specification recommends.
            sub = row.copy()
            sub[1:] -= row[:-1]
            choices = (b"\1", sub), (b"\2", row - above)  # with the filter's type
            kind, filtered = min(
                choices, key=lambda pair: np.abs(pair[1].view(np.int8), dtype=np.int16).sum(dtype=np.int64)
            )
            if data := packed.compress(kind + filtered.tobytes()):
                chunk(b"IDAT", data)
            above = row
        above, left = above.copy(), left - len(band)  # not a view, which would keep the band
        del band, row
    assert left == 0
    chunk(b"IDAT", packed.flush())
    chunk(b"IEND", b"")


def to_bytes(rgb8: np.ndarray, level: int = _LEVEL) -> bytes:
    file = io.BytesIO()
    encode(file, rgb8, level)
    return file.getvalue()


def read(path: Path, *, alpha: bool = False) -> np.ndarray:
    """Read a PNG as uint8 (M, N, 3), row 0 at the top.

    Gray and palette images are expanded, alpha is dropped, 16 bits are rounded to 8.
    alpha: keep that of an image that has one, (M, N, 4).
    Raises InputError as `decode.read_png`.
    """
    codes, _ = read_png(path)
    if codes.dtype == np.uint16:
        codes = ((codes.astype(np.uint32) + 128) // 257).astype(np.uint8)
    if codes.shape[2] < 3:
        codes = np.concatenate([np.repeat(codes[:, :, :1], 3, axis=2), codes[:, :, 1:]], axis=2)
    return np.array(codes if alpha else codes[:, :, :3])
