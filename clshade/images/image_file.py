"""EXR and PNG files of any program, as channels, and these grouped into layers."""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..base import console
from ..base.arrays import Array
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, first_bytes
from . import decode, exr, exr_limits, png

EXR = exr_limits.MAGIC
SIGNATURES = (EXR, png.SIGNATURE)  # what files that are read begin with
FAMILIES = ("RGB", "XYZ", "UVW")  # components that belong together, by the last part of a channel's name


@dataclass(frozen=True)
class Picture:
    """An image."""

    channels: dict[str, Array]  # (M, N), row 0 at the top, as stored; for PNG code/255 or code/65535, float32
    header: dict[str, Any] = field(default_factory=dict)  # attributes of the file
    bits: int = 0  # per channel of a PNG, whose values are taken as sRGB-encoded; 0 for linear values
    name: str = "image"  # for messages

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns = next(iter(self.channels.values())).shape
        return rows, columns

    def color(self) -> tuple[str, Array] | None:
        """Return the layer that is the image, and its (M, N, 3) linear floats, read-only if gray; None without one."""
        if (group := color_group(self.channels)) is None:
            return None
        name, planes = group
        if planes[0] is planes[1] is planes[2]:  # gray
            return name, np.broadcast_to(self._linear(planes[0])[..., None], (*self.shape, 3))
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


def resolution_of(path: Path) -> tuple[int, int] | None:
    """Return columns and rows of an EXR, a PNG or the .npz of a frame, from its header; None for anything else."""
    try:
        with open(path, "rb") as file:
            signature = file.read(8)
            if signature.startswith(EXR):
                windows = (value for name, _, value in exr_limits.attributes(file) if name == b"displayWindow")
                x0, y0, x1, y1 = struct.unpack("<4i", next(windows))
                return x1 - x0 + 1, y1 - y0 + 1
            if signature == png.SIGNATURE:
                columns, rows = struct.unpack(">8x2I", file.read(16))  # after the first chunk's length and name
                return columns, rows
            if signature.startswith(b"PK"):
                with np.load(path, allow_pickle=False) as arrays:
                    columns, rows = map(int, arrays["resolution"].tolist())
                    return columns, rows
    except Exception:  # damaged files raise exceptions of many types
        pass
    return None


class Group(NamedTuple):
    """A layer: one plane (M, N), or two or three of a family of components, in the family's order."""

    family: str  # `RGB`, `XYZ` or `UVW`; "" for a single channel
    names: tuple[str, ...]
    planes: tuple[Array, ...]

    def part(self, place: Any) -> Group:
        """Return the part of the layer at a place, an index of an array (M, N)."""
        return self._replace(planes=tuple(plane[place] for plane in self.planes))


def group_channels(channels: Mapping[str, Array]) -> dict[str, Group]:
    """Return layers by name, in the order of their first channels.

    R, G, B (X, Y, Z; U, V, W) of one prefix, at least two of them, in either case, form the layer of that prefix: N.X,
    N.Y and N.Z are `N`; without a prefix R, G and B are `RGB`. All other channels, including A, are layers of their
    own.
    """
    families: dict[tuple[str, str], dict[str, str]] = {}
    for name in channels:
        prefix, _, last = name.rpartition(".")
        letter = last.upper()
        family = next((family for family in FAMILIES if letter in family and len(letter) == 1), "")
        members = families.setdefault((prefix, family) if family else (name, ""), {})
        members.setdefault(letter if family and letter not in members else name, name)
    layers: list[tuple[str, str, tuple[str, ...]]] = []  # title, family and names of channels
    for (prefix, family), members in families.items():
        letters = "".join(letter for letter in family if letter in members)
        together = tuple(members[letter] for letter in letters) if len(letters) > 1 else ()
        if together:
            title = prefix or letters
            layers.append((title if title not in channels else f"{title}.{letters}", family, together))
        layers += [(name, "", (name,)) for name in members.values() if name not in together]
    groups: dict[str, Group] = {}
    for title, family, names in layers:
        while title in groups:  # names in a file may collide in any way
            title += "'"
        groups[title] = Group(family, names, tuple(channels[name] for name in names))
    return groups


def color_group(channels: Mapping[str, Array]) -> tuple[str, list[Array]] | None:
    """Return the layer that is the image, and its planes R, G, B.

    It is `RGB`, else a gray `Y` or `L` three times, else the first color layer of any name; None if there is none.
    """
    groups = group_channels(channels)
    colors = {n: list(group.planes) for n, group in groups.items() if group.family == "RGB" and len(group.planes) == 3}
    grays = {n: list(groups[n].planes * 3) for n in ("Y", "L") if n in groups and len(groups[n].planes) == 1}
    name = next((name for name in ("RGB", *grays, *colors) if name in grays | colors), None)
    return None if name is None else (name, (grays | colors)[name])
