"""What tells a user how an image differs from its reference: a line for each layer, and files to look at."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import Array, Bytes
from ...base.atomic_files import folder_made, shown, write_bytes
from ...base.input_files import read_file
from ...base.json_values import in_line
from ...errors import InputError
from ...images import compare, exr, png
from ...images.channels import Group
from ...images.image_file import Picture, read_picture
from ...pipeline.frame import Frame
from ...scene.model import default_tonemap
from .. import page
from .library import HASHES, Entry

_MOST_BYTES = 1 << 31  # of a reference image


class Failure:
    """A frame, and the image that it should be if that is at hand.

    reference: None without a file, or if it is that of other hashes. lacking: why there is none.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        channels = {name: _storable(plane) for name, plane in exr.flatten(frame.channels()).items()}
        self.result = Picture(channels, frame.metadata(deterministic=True), name="result")
        self.reference: Picture | None = None
        self.lacking = ""
        self._path: Path | None = None

    def read_reference(self, path: Path, entry: Entry) -> None:
        """Read the reference image, if it is that of `entry`."""
        if not path.exists():
            self.lacking = f"there is no reference image {shown(path)}"
            return
        try:
            found = read_picture(path)
        except InputError as error:
            self.lacking = f"no reference image: {error}"
            return
        if found.header.get(HASHES) != json.dumps(entry):
            self.lacking = f"{shown(path)} is not the image of the library, and is not shown"
            return
        self._path, self.reference = path, Picture(found.channels, found.header, name="reference")

    def write(self, folder: Path) -> str:
        """Write result, reference, difference and their page into a folder, and return a line that names them.

        Raises OutputError.
        """
        names = ["result"]
        with folder_made(folder):
            self.frame.write(folder / "result", deterministic=True)
            if self.reference is not None and self._path is not None:
                names.append("reference")
                write_bytes(folder / "reference.exr", read_file(self._path, _MOST_BYTES))
                png.write(folder / "reference.png", self._codes(self.reference))
                if self.reference.shape == self.result.shape:
                    names.append("difference")
                    self._write_difference(folder)
            pictures = {each.name: each for each in (self.result, self.reference) if each is not None}
            title = f"result and reference of {self.frame.scene.name or 'an image'}"
            page.view(pictures, title, tonemap=default_tonemap(self.frame.scene)).save(folder / "index.html")
        return f"{', '.join(names)} as EXR and PNG, and index.html, which shows them: {shown(folder)}"

    def _codes(self, picture: Picture) -> Bytes:
        """Return the 8-bit image of a picture, as the frame's."""
        names = "RGBA" if self.frame.scene.background is None else "RGB"
        pixels = np.stack([picture.channels[name] for name in names], axis=-1)
        operator = default_tonemap(self.frame.scene)
        if names == "RGBA":
            from ...images.transparency import tonemap_rgba

            return tonemap_rgba(pixels, operator, 0.0)
        from ...images.tonemap import tonemap

        return tonemap(pixels, operator, 0.0)

    def _write_difference(self, folder: Path) -> None:
        from ...images import compare_figure, figures

        assert self.reference is not None
        layers = compare.chosen_layers(self.result, self.reference)
        channels = [
            {name: Group("", (name,), (plane,)) for name, plane in each.channels.items()}
            for each in (self.result, self.reference)
        ]
        shared = [name for name in channels[0] if name in channels[1]]
        exr.write(folder / "difference.exr", {n: compare.errors_of(*(each[n] for each in channels)) for n in shared})
        figure = compare_figure.draw(layers, encoded=False, titles=(self.result.name, self.reference.name))
        figures.save(figure, folder / "difference.png")


def _storable(plane: Array) -> Array:
    """Return a plane in the type in which an EXR stores it."""
    with np.errstate(over="ignore"):
        return plane.astype(np.float32) if plane.dtype == np.float64 else plane


def difference_lines(expected: Entry, found: Entry, failure: Failure) -> list[str]:
    """Return a line for each array that differs, for a header that does, and on a reference that is not at hand."""
    lines = []
    for name in sorted({*expected, *found}, key=[*found, *expected].index):
        before, now = (entry[name].rpartition(" ")[0] if name in entry else "none" for entry in (expected, found))
        if before != now:
            lines.append(f"{name}: expected {before}, found {now}")
    different = [name for name, text in found.items() if name in expected and expected[name] != text]
    reference = failure.reference
    if reference is None:
        return [*lines, f"{', '.join(different)}: other bits; {failure.lacking}"] if different else lines
    if reference.shape != failure.result.shape:
        return lines
    pairs = compare.chosen_layers(failure.result, reference)
    worst = [line for name, pair in pairs.items() if (line := _worst_line(name, pair))]
    if different and not worst:
        worst = [f"{', '.join(different)}: other bits, the same values in float32"]
    return [*lines, *worst, *_header_lines(reference, failure.result)]


def _header_lines(expected: Picture, found: Picture) -> list[str]:
    """Return a line for each of the settings, and for the scene, that differ."""
    was, now = ({**_settings(each), "scene": each.header.get("scene", "none")} for each in (expected, found))
    return [
        f"{name}: expected {in_line(was.get(name, 'none'))}, found {in_line(now.get(name, 'none'))}"
        for name in {**was, **now}
        if was.get(name) != now.get(name)
    ]


def _settings(picture: Picture) -> dict[str, str]:
    """Return the settings in a header by name; those that have their usual value may be left out."""
    pieces = re.split(r", (?=\w+=)", str(picture.header.get("settings", "")))
    return {f"settings, {name}": value for name, _, value in (piece.partition("=") for piece in pieces) if value}


def _worst_line(name: str, pair: tuple[Any, Any]) -> str:
    """Return how many pixels of a layer differ, and the values where they do most; "" if none does."""
    errors = compare.errors_of(*pair)
    count = int(np.count_nonzero(errors))
    if not count:
        return ""
    y, x = np.unravel_index(np.argmax(errors), errors.shape)
    values, wanted = (" ".join(f"{plane[y, x]:.7g}" for plane in group.planes) for group in pair)
    return (
        f"{name}: {count} of {errors.size} pixels differ, most at column {x}, row {y} from the top: "
        f"expected {wanted}, found {values}"
    )
