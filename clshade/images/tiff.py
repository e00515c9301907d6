"""TIFF images with 16 bits per channel in layouts that Pillow lacks, or truncates to 8 bits, through tifffile."""

from __future__ import annotations

import io
import logging
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.input_files import file_error

_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _ORIENTATION, _SAMPLES = 256, 257, 258, 262, 274, 277
_PLANAR, _EXTRA, _FORMAT = 284, 338, 339
_NONE, _DEFLATE = (1,), (8, 32946)  # compressions
_MAX_PART = 1 << 28  # values in a strip or tile: the largest image that is read may be a single one
_ASSOCIATED = 1  # associated (premultiplied) alpha


@dataclass(frozen=True)
class Layout:
    """The layout of the first image of a file. bits: of the deepest channel. unsigned: unsigned integers."""

    width: int
    height: int
    samples: int
    bits: int
    unsigned: bool
    photometric: int
    planar: bool
    orientation: int
    extra: tuple[int, ...]

    @property
    def is_foreign(self) -> bool:
        """Whether it has 16 bits per channel, and Pillow gives them truncated, wrong or not at all."""
        gray = self.photometric in (0, 1) and (self.samples == 2 or (self.planar and self.samples == 1))
        color = self.photometric == 2 and self.samples in (3, 4)
        return self.bits == 16 and self.unsigned and (gray or (color and (self.planar or _ASSOCIATED in self.extra)))


def layout(data: bytes | memoryview) -> Layout | None:
    """Return the layout of a TIFF file's first image, or None for other files and for ones too damaged to tell."""
    head = bytes(data[:16])
    if head[:4] not in _MAGIC:
        return None
    from PIL import TiffImagePlugin

    try:
        directory: Any = TiffImagePlugin.ImageFileDirectory_v2(head if head[2] == 43 or head[3] == 43 else head[:8])
        file = io.BytesIO(data)
        file.seek(directory.next)
        directory.load(file)
        bits = directory.get(_BITS, (1,))
        return Layout(
            width=int(directory[_WIDTH]),
            height=int(directory[_HEIGHT]),
            samples=int(directory.get(_SAMPLES, 1)),
            bits=max(bits),
            unsigned=set(directory.get(_FORMAT, (1,))) == {1} and len(set(bits)) == 1,
            photometric=int(directory.get(_PHOTOMETRIC, 1)),
            planar=directory.get(_PLANAR, 1) == 2,
            orientation=int(directory.get(_ORIENTATION, 1)),
            extra=tuple(directory.get(_EXTRA, ())),
        )
    except Exception:  # a damaged file raises exceptions of many types; Pillow then reports the fault
        return None


def codes(data: bytes | memoryview, found: Layout, owner: str) -> Array:
    """Return (h, w, C) uint16 gray, gray and alpha, RGB or RGBA of a file with a foreign layout and a checked size.

    Raises InputError if tifffile is not installed, and for a compression other than deflate.
    """
    try:
        import tifffile
    except ImportError:
        expected = "tifffile, for 16 bits a channel in planes, with gray and alpha, or with associated alpha"
        found_none = "none: `pip install tifffile`"
        raise file_error(owner, "image", expected, found_none) from None
    wanted = (found.samples, found.height, found.width) if found.planar else (found.height, found.width, found.samples)
    logger = logging.getLogger("tifffile")  # it reports damaged files on standard error
    before, logger.disabled = logger.disabled, True
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            page: Any = file.pages[0]
            _check_parts(page, wanted, owner)
            _check_compression(page, data, owner)
            pixels = np.asarray(page.asarray(maxworkers=1)).reshape(wanted)
    finally:
        logger.disabled = before
    pixels = np.moveaxis(pixels, 0, -1) if found.planar else pixels
    if found.photometric == 0:
        pixels = np.concatenate([65535 - pixels[:, :, :1], pixels[:, :, 1:]], axis=2)
    if _ASSOCIATED in found.extra:  # colors are divided by alpha; 0 where that is
        alpha = pixels[:, :, -1:].astype(np.uint32)
        straight = (pixels[:, :, :-1].astype(np.uint32) * 65535 + alpha // 2) // np.maximum(alpha, 1)
        straight = np.where(alpha == 0, 0, np.minimum(straight, 65535)).astype(np.uint16)
        pixels = np.concatenate([straight, pixels[:, :, -1:]], axis=2)
    return _upright(pixels, found.orientation)


def _check_parts(page: Any, wanted: tuple[int, int, int], owner: str) -> None:
    """Raise InputError if the file claims more data than an image of the wanted shape has.

    A file of a few bytes may claim more pixels, in depth, or more or larger strips or tiles: tifffile would allocate
    all.
    """
    if page.size != math.prod(wanted) or page.dtype != np.uint16:
        raise file_error(owner, "image", f"16-bit pixels of shape {wanted}", f"{page.dtype} of shape {page.shape}")
    parts, listed = math.prod(page.chunked), len(page.dataoffsets)
    if parts != listed:
        raise file_error(owner, "image", f"{parts} strips or tiles", str(listed))
    if math.prod(page.chunks) > _MAX_PART:
        raise file_error(owner, "image", f"strips or tiles of at most {_MAX_PART} values", str(math.prod(page.chunks)))


def _check_compression(page: Any, data: bytes | memoryview, owner: str) -> None:
    """Raise InputError for an unsupported compression, and for more data than the pixels take."""
    compression = int(page.compression)
    if compression not in _NONE + _DEFLATE:
        expected = "no compression or deflate, for 16 bits in planes, with associated alpha, or gray with alpha"
        raise file_error(owner, "image", expected, page.compression.name)
    if compression in _NONE:
        return
    most = math.prod(page.chunks) * 2
    for start, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        part = zlib.decompressobj().decompress(data[start : start + count], most + 1)
        if len(part) > most:
            raise file_error(owner, "image", f"at most {most} bytes in a strip or tile", "more")


def _upright(pixels: Array, orientation: int) -> Array:
    """Rotate and mirror so that row 0 is the top and column 0 the left, by the orientation of the TIFF standard."""
    if orientation in (5, 6, 7, 8):
        pixels = pixels.transpose(1, 0, 2)
    rows = -1 if orientation in (3, 4, 7, 8) else 1
    columns = -1 if orientation in (2, 3, 6, 7) else 1
    return pixels[::rows, ::columns]
