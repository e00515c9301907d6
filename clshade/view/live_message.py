"""Pictures as binary messages: a JSON header, padded to whole 8 bytes, then arrays one after another.

uint64, little-endian: the header's length with its padding; the header; the arrays, each padded to 8 bytes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.arrays import Array, Bytes
from ..images import exr
from ..images.tonemap import JOINT, Operator, mapped
from ..pipeline.frame import Frame

_ALIGNED = 8  # bytes: typed arrays of a browser begin at multiples of their elements' size


def rgba8(frame: Frame, operator: Operator, exposure: float) -> Bytes:
    """Return the tone-mapped image, (M, N, 4) uint8 with alpha 255, as a canvas takes it; its colors are the PNG's."""
    if operator in JOINT:
        return np.dstack([mapped(frame.rgb, operator, exposure), np.full(frame.alpha.shape, 255, np.uint8)])
    codes = mapped(frame.rgba, operator, exposure)  # alpha too: that is faster than leaving it out
    codes[..., 3] = 255
    return codes


def planes(frame: Frame) -> dict[str, Array]:
    """Return the channels by their names in an EXR, (M, N) each: float32, numbers uint32."""
    with np.errstate(over="ignore", invalid="ignore"):
        return {
            name: np.ascontiguousarray(plane, np.uint32 if plane.dtype.kind in "iu" else np.float32)
            for name, plane in exr.flatten(frame.channels()).items()
        }


def enlarged(plane: Array, shape: tuple[int, int]) -> Array:
    """Return a coarse channel at the full number of rows and columns, each pixel repeated."""
    if plane.shape == shape:
        return plane
    rows, columns = (np.arange(full) * coarse // full for full, coarse in zip(shape, plane.shape, strict=True))
    found: Array = plane[rows[:, None], columns]
    return found


def pixel(frame: Frame, column: int, row: int) -> dict[str, float | int | str]:
    """Return the values of a pixel by channel, as an EXR holds them. JSON lacks infinity and NaN: they are text."""
    found: dict[str, float | int | str] = {}
    for name, plane in exr.flatten(frame.channels()).items():
        if plane.dtype.kind in "iu":
            found[name] = int(plane[row, column])
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            value = float(np.float32(plane[row, column]))
        found[name] = value if np.isfinite(value) else str(value)
    return found


def packed(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    """Return the message. The header lists the arrays with their name, type and offset behind the header."""
    listed, at = [], 0
    for name, array in arrays.items():
        listed.append({"name": name, "type": array.dtype.name, "offset": at})
        at += -(-array.nbytes // _ALIGNED) * _ALIGNED
    text = json.dumps({**header, "arrays": listed}).encode()
    text += b" " * (-len(text) % _ALIGNED)
    start = _ALIGNED + len(text)
    message = bytearray(start + at)
    message[:start] = len(text).to_bytes(_ALIGNED, "little") + text
    for each, array in zip(listed, arrays.values(), strict=True):
        np.frombuffer(message, array.dtype, array.size, start + each["offset"])[:] = array.reshape(-1)
    return bytes(message)
