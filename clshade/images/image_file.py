"""EXR and PNG files of any program, as channels."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base import console
from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, first_bytes
from . import decode, exr, exr_limits, png
from .channels import color_group

EXR = exr_limits.MAGIC
SIGNATURES = (EXR, png.SIGNATURE)  # what files that are read begin with


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
        group = color_group(self.channels)
        if group is None:
            return None
        name, planes = group
        if planes[0] is planes[1] is planes[2]:  # gray
            gray = self._linear(planes[0])[..., None]
            return name, np.broadcast_to(gray, (*self.shape, 3))
        return name, self._linear(np.stack(planes, axis=-1))

    def pixel(self, x: int, y: int) -> dict[str, Any]:
        """Return the values of all channels, NumPy scalars, in column x from the left and row y from the TOP, from 0.

        Raises InputError for a pixel outside the image.
        """
        rows, columns = self.shape
        if not (0 <= x < columns and 0 <= y < rows):
            expected = f"X from 0 to {columns - 1} and Y from 0 to {rows - 1}"
            raise file_error(self.name, "pixel", expected, f"{x},{y}")
        return {name: plane[y, x] for name, plane in self.channels.items()}

    def _linear(self, values: Array) -> Array:
        if self.bits:
            return decode.srgb_to_linear(values)
        return values if values.dtype.kind == "f" else values.astype(np.float64)


def read_picture(path: Path) -> Picture:
    """Read an EXR or PNG file, recognized by its signature. Raises InputError, one line that names it, for others."""
    start, owner = time.perf_counter(), shown(path)
    signature = first_bytes(path, len(png.SIGNATURE))
    if signature.startswith(EXR):
        picture = Picture(*exr.read(path), name=owner)
    elif signature == png.SIGNATURE:
        codes, header = decode.read_png(path)
        white = np.iinfo(codes.dtype).max
        table = (np.arange(white + 1) / white).astype(np.float32)
        names = {1: "Y", 2: "YA", 3: "RGB", 4: "RGBA"}[codes.shape[2]]
        channels = {name: table[codes[:, :, k]] for k, name in enumerate(names)}
        picture = Picture(channels, header, codes.itemsize * 8, owner)
    else:
        raise file_error(owner, "file", "an OpenEXR or PNG image", "something else")
    milliseconds = (time.perf_counter() - start) * 1e3
    console.detail(f"read {picture.name}: {len(picture.channels)} channels, {milliseconds:.0f} ms")
    return picture
