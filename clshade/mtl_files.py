"""Wavefront MTL libraries: the parts that a plain OBJ scene needs (Ka, Kd, Ks, Ns, map_Kd)."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .atomic import shown
from .images import as_texture
from .obj_lines import numbers
from .reading import beside, complaint, quoted, read_file, within
from .scene import Material, Texture

MAX_BYTES = 1 << 24  # of a library
MAX_PIXELS = 1 << 28  # of all images of a scene: 3 GiB as linear float32 RGB
_COLORS = {"ka": "ka", "kd": "kd", "ks": "ks"}
# A material that an MTL file defines: nothing shines unless it says so.
DEFAULTS = {"ka": 1.0, "kd": 0.8, "ks": 0.0, "n": 20.0}


@dataclass
class _Found:
    """What a library says of one material. image: path of its map_Kd."""

    values: dict[str, Any] = field(default_factory=lambda: dict(DEFAULTS))
    image: str | None = None


class Library:
    """The materials that the mtllib lines of an OBJ file lead to. Images are decoded when they are first asked for.

    path: of the OBJ file. references: (line number, text after mtllib). No file outside the OBJ file's folder is
    opened. A file that is not there is left out with a warning.

    Raises InputError for a reference that leads out of the folder, for numbers that are none, and for images of more
    than MAX_PIXELS pixels in all.
    """

    def __init__(self, path: str, references: list[tuple[int, str]]) -> None:
        self.root, self.owner = os.path.dirname(path) or ".", shown(path)
        self.found: dict[str, _Found] = {}
        self.textures: dict[str, Texture] = {}
        seen = set()
        for line, text in references:
            if text in seen:
                continue
            seen.add(text)
            where = f"line {line}: mtllib"
            whole = beside(self.root, self.root, text, self.owner, where)
            names = [text] if whole is not None else text.split()
            for name in names:
                library = beside(self.root, self.root, name, self.owner, where)
                if library is None:
                    warnings.warn(f"{self.owner}: {where}: there is no file {quoted(name)}", stacklevel=2)
                    continue
                with within(self.owner):
                    self._read(library)

    def _read(self, library: str) -> None:
        material = None
        for number, line in enumerate(read_file(library, MAX_BYTES).splitlines(), 1):
            words = line.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace").split(None, 1)
            if len(words) < 2:
                continue
            keyword, rest, where = words[0].lower(), words[1].strip(), f"line {number}: {words[0][:16]}"
            if keyword == "newmtl":
                material = self.found.setdefault(rest, _Found())
            elif material is None:
                continue
            elif keyword in _COLORS:
                material.values[_COLORS[keyword]] = _color(rest, shown(library), where)
            elif keyword == "ns":
                material.values["n"] = _exponent(rest, shown(library), where)
            elif keyword == "map_kd":
                material.image = self._image(rest, library, where)

    def _image(self, text: str, library: str, where: str) -> str | None:
        """The path of a map's image; options before the file's name are left out."""
        name = text.split()[-1] if text.startswith("-") else text
        path = beside(self.root, os.path.dirname(library) or ".", name, shown(library), where)
        if path is None:
            warnings.warn(f"{shown(library)}: {where}: there is no file {quoted(name)}", stacklevel=2)
        return path

    def material(self, name: str, textured: bool) -> Material | None:
        """The material of that name, None when no library has it. textured: whether its image is wanted."""
        found = self.found.get(name)
        if found is None:
            return None
        texture = None
        if textured and found.image is not None:
            if found.image not in self.textures:
                with within(self.owner):
                    self.textures[found.image] = as_texture(found.image, srgb=True)
                pixels = sum(known.image.shape[0] * known.image.shape[1] for known in self.textures.values())
                if pixels > MAX_PIXELS:
                    raise complaint(self.owner, "map_Kd", f"images of at most {MAX_PIXELS} pixels in all", "more")
            texture = self.textures[found.image]
        return Material(**found.values, texture=texture, name=name)


def _floats(text: str, owner: str, where: str, allowed: tuple[int, ...], expected: str) -> list[float]:
    text = text.split("#", 1)[0]
    values = numbers(text.encode(), float, len(text.split()))
    if values is None or len(values) not in allowed or not np.isfinite(values).all():
        raise complaint(owner, where, expected, quoted(text))
    return [float(value) for value in values]


def _color(text: str, owner: str, where: str) -> list[float]:
    """Three channels from three numbers or one; spectral and xyz colors are not known."""
    values = _floats(text, owner, where, (1, 3), "one or three finite numbers")
    return values * 3 if len(values) == 1 else values


def _exponent(text: str, owner: str, where: str) -> float:
    (value,) = _floats(text, owner, where, (1,), "a number from 0 to 1e9")
    if not 0.0 <= value <= 1e9:
        raise complaint(owner, where, "a number from 0 to 1e9", f"{value:g}")
    return value
