"""EXR and PNG files of any program, as channels."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import console
from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, first_bytes, read_file
from ..errors import InputError
from . import decode, exr
from .channels import color_group

EXR, _PNG = b"\x76\x2f\x31\x01", b"\x89PNG\r\n\x1a\n"
SIGNATURES = (EXR, _PNG)  # what files that are read begin with
_MAX_BYTES = 1 << 31  # size of a PNG
_MAX_PIXELS = 1 << 28  # 16384 x 16384, as for EXR


@dataclass(frozen=True)
class Picture:
    """An image. channels: name -> (M, N), row 0 at the top, as stored; for PNG code/255 or code/65535, float32.

    header: attributes of the file. bits: per channel of a PNG, whose values are taken as sRGB-encoded; 0 for EXR and
    arrays, whose values are linear. name: for messages.
    """

    channels: dict[str, Array]
    header: dict[str, Any] = field(default_factory=dict)
    bits: int = 0
    name: str = "image"

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = next(iter(self.channels.values())).shape
        return rows, columns

    def color(self) -> tuple[str, Array] | None:
        """Return the layer that is the image, and its (M, N, 3) linear floats, read-only if gray; None without one."""
        found = color_group(self.channels)
        if found is None:
            return None
        name, planes = found
        if planes[0] is planes[1] is planes[2]:  # gray
            gray = self._linear(planes[0])[..., None]
            return name, np.broadcast_to(gray, (*self.shape, 3))
        return name, self._linear(np.stack(planes, axis=-1))

    def _linear(self, values: Array) -> Array:
        if self.bits:
            return decode.srgb_to_linear(values)
        return values if values.dtype.kind == "f" else values.astype(np.float64)


def read_picture(path: Path) -> Picture:
    """Read an EXR or PNG file, recognized by its signature. Raises InputError, one line that names it, for others."""
    start = time.perf_counter()
    picture = _read(path, shown(path))
    taken = (time.perf_counter() - start) * 1e3
    console.detail(f"read {picture.name}: {len(picture.channels)} channels, {taken:.0f} ms")
    return picture


def _read(path: Path, owner: str) -> Picture:
    begin = first_bytes(path, len(_PNG))
    if begin.startswith(EXR):
        return Picture(*exr.read(path), name=owner)
    if begin != _PNG:
        raise file_error(owner, "file", "an OpenEXR or PNG image", "something else")
    codes, header = decode.decode_png(read_file(path, _MAX_BYTES), owner, most_pixels=_MAX_PIXELS)
    names = {1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}[codes.shape[2]]
    most = np.iinfo(codes.dtype).max
    table = (np.arange(most + 1) / most).astype(np.float32)
    channels = {name: table[codes[:, :, k]] for k, name in enumerate(names)}
    return Picture(channels, header, codes.dtype.itemsize * 8, owner)


def picture_of(source: Path | Mapping[str, Array] | Array | Picture) -> Picture:
    """Return a Picture from a file's path, from input of `exr.flatten` (linear), or the Picture itself."""
    if isinstance(source, Picture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return read_picture(source)
    return Picture(exr.flatten(source))


def named_pixel(picture: Picture, x: int, y: int) -> dict[str, Any]:
    """Return the values of all channels, NumPy scalars, in column x from the left and row y from the TOP, both from 0.

    Raises InputError for a pixel outside the image.
    """
    rows, columns = picture.shape
    if not (0 <= x < columns and 0 <= y < rows):
        raise InputError(
            f"{picture.name}: pixel: expected X from 0 to {columns - 1} and Y from 0 to {rows - 1}, found {x},{y}"
        )
    return {name: plane[y, x] for name, plane in picture.channels.items()}
