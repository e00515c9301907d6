"""Checks of an OpenEXR header against the file size and the free memory, before any pixel is decoded.

A damaged or forged header of a few KB may claim terabytes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO

from ..base import host_memory
from ..base.input_files import file_error
from .layers import LAYER_TABLE

MAGIC = b"\x76\x2f\x31\x01"
MAX_PIXELS = 1 << 28  # 16384 x 16384: the largest image that can be rendered, and the largest that is read
# Channels -> the header attribute with their value outside the data window.
OUTSIDE: dict[str, str] = {name: f"{name}Background" for name, row in LAYER_TABLE.items() if row.background != 0.0}
OUTSIDE["Z"] = "Zbackground"
# Bytes of all channels of the display window: all layers of the largest image, 32 of 2^30, flows included.
MAX_SHOWN = 1 << 35
_MAX_ATTRIBUTE = 1 << 30  # bytes: names of many instances take megabytes

# The highest compression ratios that the formats allow: RLE has runs of 128 in 2 bytes; deflate (zip) 258 bytes in 2
# bits; PXR24 first drops one byte of 4; PIZ's Huffman code repeats 2 bytes 256 times in 10 bits; B44A has 32 bytes in 3
# where all are the same. DWA runs deflate over the RLE data of alpha, and over the at least 4 bytes of a block of 8x8
# floats of a color; other channels get deflate alone. Zstandard has 128 KiB in a block of 4 bytes; the same is assumed
# of compressions that are not listed.
_DEFLATE = 1032
_DENSEST = {"none": 1, "rle": 64, "zips": _DEFLATE, "zip": _DEFLATE, "pxr24": _DEFLATE * 4 // 3, "piz": 410}
_DENSEST |= {"b44": 11, "b44a": 11, "dwaa": _DEFLATE, "dwab": _DEFLATE}
_DENSEST_OF_OTHERS = 1 << 17
_DWA_COLORS = {"r", "g", "b", "y", "ry", "by", "a", "red", "grn", "green", "blu", "blue"}  # the last part of a name
_TYPE_BYTES = {0: 4, 1: 2, 2: 4}  # uint, half, float


def attributes(file: BinaryIO) -> Iterator[tuple[bytes, bytes, bytes]]:
    """Yield name, type and value of each attribute of a header, which is then read to its end.

    file: where the header begins: the first one follows magic number and version. Raises ValueError if it is not whole.
    """
    while name := _word(file):
        kind, size = _word(file), int.from_bytes(file.read(4), "little")
        value = file.read(min(size, _MAX_ATTRIBUTE))
        if len(value) < size:
            raise ValueError("the file ends within its header")
        yield name, kind, value


def _word(file: BinaryIO) -> bytes:
    """Read text up to a null byte."""
    word = b""
    while (letter := file.read(1)) != b"\0":
        if not letter or len(word) > 255:
            raise ValueError("no name of an attribute")
        word += letter
    return word


def channel_bytes(data: bytes, parts: int) -> list[dict[str, int]]:
    """Return the bytes per value of each channel of each part.

    data: a file whose headers OpenEXR has accepted: its module gives everything in a header but the channel types.
    """
    file = io.BytesIO(data)
    file.seek(8)
    sizes: list[dict[str, int]] = [{} for _ in range(parts)]
    for part in sizes:
        for attribute, _, value in attributes(file):
            channels = io.BytesIO(value if attribute == b"channels" else b"\0")
            while name := _word(channels):
                kind = int.from_bytes(channels.read(16)[:4], "little")  # then a flag and samplings
                part[name.decode("utf-8", "surrogateescape")] = _TYPE_BYTES.get(kind, 4)
    return sizes


def check(headers: Sequence[dict[str, Any]], data: bytes, owner: str) -> None:
    """Raise InputError for parts that are not flat images, are too large, or exceed what file or free memory can hold.

    headers: of the parts of the file `data`; windows as (x0, y0, x1, y1) inclusive.
    """
    smallest = pixels = shown = 0  # bytes: of the file, of the data windows, of the display windows
    # The largest plane copied into a display window of zeros, which takes no memory until written; windows filled with
    # another value.
    copied = filled = 0
    for header, part in zip(headers, channel_bytes(data, len(headers)), strict=True):
        data_window, display = _checked_areas(header, owner)
        for channel, size in part.items():
            densest = _DENSEST.get(header["compression"], _DENSEST_OF_OTHERS)
            if header["compression"].startswith("dwa") and channel.split(".")[-1].lower() in _DWA_COLORS:
                densest *= 64
            smallest += size * data_window // densest
            pixels += size * data_window
            shown += size * display
            if header["dataWindow"] == header["displayWindow"]:
                continue
            if OUTSIDE.get(channel, "") in header:
                filled += size * display
            else:
                copied = max(copied, size * min(data_window, display))
    if shown > MAX_SHOWN:  # a small file may have a large display window
        raise file_error(owner, "channels", f"at most {MAX_SHOWN} bytes in the display window", str(shown))
    if smallest > len(data):
        raise file_error(owner, "dataWindow", f"pixels that {len(data)} bytes can hold", f"{pixels} bytes of them")
    free, needed = host_memory.available(), pixels + copied + filled
    if needed > free:
        expected = f"an image that fits into memory, of which {free:.0f} bytes are free"
        raise file_error(owner, "file", expected, str(needed))


def _checked_areas(header: dict[str, Any], owner: str) -> list[int]:
    """Return the pixels of the data window and the display window of a part."""
    if str(header.get("type", "")).startswith("deep"):
        raise file_error(owner, "type", "a flat image", "a deep one")
    areas = []
    for name in ("dataWindow", "displayWindow"):
        x0, y0, x1, y1 = header[name]
        areas.append((x1 - x0 + 1) * (y1 - y0 + 1))
        if x1 < x0 or y1 < y0 or areas[-1] > MAX_PIXELS:
            raise file_error(owner, name, f"1 to {MAX_PIXELS} pixels", str(header[name]))
    for channel in header["channels"]:
        if (channel.xSampling, channel.ySampling) != (1, 1):
            raise file_error(owner, channel.name, "a value for every pixel", "a subsampled channel")
    return areas
