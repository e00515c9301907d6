"""Checks of an OpenEXR header against the file size and the free memory, before any pixel is decoded.

A damaged or forged header of a few KB may claim terabytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any

from ..base import host_memory
from ..base.input_files import file_error
from .layers import LAYER_TABLE

MAGIC = b"\x76\x2f\x31\x01"
START = 8  # of the first header, after magic number and version
MAX_PIXELS = 1 << 28  # 16384 x 16384: the largest image that can be rendered, and the largest that is read
# Channels -> the header attribute with their value outside the data window.
OUTSIDE: dict[str, str] = {name: f"{name}Background" for name, row in LAYER_TABLE.items() if row.background != 0.0}
OUTSIDE["Z"] = "Zbackground"
# Bytes of all channels of the display window: all layers of the largest image, 32 of 2^30, flows included.
MAX_SHOWN = 1 << 35

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


def _least(size: int, channel: str, compression: str) -> int:
    """Return the fewest bytes that a channel of this size can take in a file."""
    densest = _DENSEST.get(compression, _DENSEST_OF_OTHERS)
    if compression.startswith("dwa") and channel.split(".")[-1].lower() in _DWA_COLORS:
        densest *= 64
    return size // densest


def _area(window: tuple[int, int, int, int]) -> int:
    return (window[2] - window[0] + 1) * (window[3] - window[1] + 1)


def channel_bytes(data: bytes, parts: int) -> list[dict[str, int]]:
    """Return the bytes per value of each channel of each part.

    data: a file whose headers OpenEXR has accepted: its module gives everything in a header but the channel types.
    """
    found: list[dict[str, int]] = []
    at = START
    for _ in range(parts):
        sizes: dict[str, int] = {}
        for name, value, after in attributes(data, at):
            at = after
            if name == b"channels":
                sizes = _listed_channels(value)
        at += 1
        found.append(sizes)
    return found


def display_size(head: bytes) -> tuple[int, int] | None:
    """Return columns and rows of the display window of a file's first part, or None if it is no OpenEXR file.

    head: the file's first bytes.
    """
    try:
        for name, value, _ in attributes(head, START) if head.startswith(MAGIC) else ():
            if name == b"displayWindow":
                x0, y0, x1, y1 = struct.unpack("<4i", value)
                return x1 - x0 + 1, y1 - y0 + 1
    except (IndexError, ValueError, struct.error):  # shorter than its header says
        return None
    return None


def attributes(data: bytes, at: int) -> Iterator[tuple[bytes, bytes, int]]:
    """Yield name and value of each attribute of the header that begins there, and where the next one begins.

    Raises IndexError or ValueError if the data end before."""
    while data[at]:
        name = data[at : data.index(b"\0", at)]
        at = data.index(b"\0", at + len(name) + 1) + 1  # the end of the attribute's type
        size = int.from_bytes(data[at : at + 4], "little")
        at += 4 + size
        yield name, data[at - size : at], at


def _listed_channels(listed: bytes) -> dict[str, int]:
    """Parse a `chlist`: names, each with type, a flag and samplings, 16 bytes, until an empty name."""
    sizes, at = {}, 0
    while listed[at]:
        end = listed.index(b"\0", at)
        kind = int.from_bytes(listed[end + 1 : end + 5], "little")
        sizes[listed[at:end].decode("utf-8", "surrogateescape")] = _TYPE_BYTES.get(kind, 4)
        at = end + 17
    return sizes


def check(headers: Sequence[dict[str, Any]], sizes: Sequence[dict[str, int]], data: bytes, owner: str) -> None:
    """Raise InputError for parts that are not flat images, are too large, or exceed what file or free memory can hold.

    headers: of the parts; windows as (x0, y0, x1, y1) inclusive. sizes: from `channel_bytes`.
    """
    least = pixels = shown = 0
    # The largest plane copied into a display window of zeros, which takes no memory until written; windows filled with
    # another value.
    copied = filled = 0
    for header, part in zip(headers, sizes, strict=True):
        _check_part(header, owner)
        data_window, display = _area(header["dataWindow"]), _area(header["displayWindow"])
        for channel, size in part.items():
            least += _least(size * data_window, channel, header["compression"])
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
    if least > len(data):
        raise file_error(owner, "dataWindow", f"pixels that {len(data)} bytes can hold", f"{pixels} bytes of them")
    free = host_memory.available()
    needed = pixels + copied + filled
    if needed > free:
        raise file_error(
            owner, "file", f"an image that fits into memory, of which {free:.0f} bytes are free", str(needed)
        )


def _check_part(header: dict[str, Any], owner: str) -> None:
    if str(header.get("type", "")).startswith("deep"):
        raise file_error(owner, "type", "a flat image", "a deep one")
    for name in ("dataWindow", "displayWindow"):
        x0, y0, x1, y1 = header[name]
        if x1 < x0 or y1 < y0 or _area(header[name]) > MAX_PIXELS:
            raise file_error(owner, name, f"1 to {MAX_PIXELS} pixels", str(header[name]))
    for channel in header["channels"]:
        if (channel.xSampling, channel.ySampling) != (1, 1):
            raise file_error(owner, channel.name, "a value for every pixel", "a subsampled channel")
