"""Wavefront MTL libraries, converted to Phong coefficients.

The color of MTL's own formula, Ka*Ia + sum_l Ip_l*(Kd*(N.L) + Ks*(R.V)^Ns), is kept: ka = Ka, kd = Kd, ks = Ks and
n = Ns, as most viewers read it; the surface color stays white, so that Kd does not tint the highlight. A material
without Ka gets its Kd. illum 0 shows Kd independent of the lights, illum 1 has no highlight, nor has Ns 0.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import shown
from ...base.input_files import file_error, quoted, read_file, within
from ..framing import AMBIENT
from ..model import Material, Texture, Wrap
from .options import DEFAULT_MATERIAL
from .text_tokens import numbers
from .texture import Images

MAX_BYTES = 1 << 24  # of a library
# Defaults of a material in an MTL file: no highlight.
DEFAULTS = {"kd": [0.8] * 3, "ks": 0.0, "n": 20.0}
# Keywords -> features that are not rendered.
_IGNORED = {
    **dict.fromkeys(("bump", "map_bump", "norm", "map_kn"), "normal maps"),
    **dict.fromkeys(("ke", "map_ke"), "emission"),
    "tf": "transmission",
    **dict.fromkeys(("map_ka", "map_ks", "map_ns"), "maps of Ka, Ks and Ns"),
    **dict.fromkeys(("map_pr", "map_pm", "pr", "pm"), "metallic-roughness"),
    **dict.fromkeys(("map_ps", "ps", "pc", "aniso"), "sheen, clearcoat and anisotropy"),
    **dict.fromkeys(("disp", "map_disp", "decal"), "displacement and decals"),
    "refl": "reflection maps",
}
# Options of a map -> number of arguments; 0: one to three numbers.
_OPTIONS = {
    **dict.fromkeys(("-s", "-o", "-t"), 0),
    **dict.fromkeys(("-blendu", "-blendv", "-cc", "-clamp", "-texres", "-boost", "-bm", "-imfchan", "-type"), 1),
    "-mm": 2,
}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_WORD = re.compile(r"\S+")


@dataclass(frozen=True)
class _Map:
    """An image that a library refers to. scale, offset: of u and v."""

    path: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False


@dataclass
class _Found:
    """The statements of a library on one material. image, mask: its map_Kd and map_d. mapped: whether it has a map_Kd, be
    the image there or not. transparency: its Tr."""

    values: dict[str, Any] = field(default_factory=lambda: dict(DEFAULTS))
    image: _Map | None = None
    mask: _Map | None = None
    mapped: bool = False
    transparency: float | None = None
    model: int = 2
    ignored: list[str] = field(default_factory=list)


class Library:
    """The materials of the libraries named by the mtllib lines of an OBJ file. Images are decoded on first use.

    path: of the OBJ file. references: (line number, text after mtllib). own: a texture in place of the files'. Files are
    found and left out as by `Images`. Raises InputError for malformed numbers.
    """

    def __init__(self, path: str, references: list[tuple[int, str]], own: Texture | None) -> None:
        self.images, self.owner = Images(path), shown(path)
        self.own, self.found = own, dict[str, _Found]()
        self.textures: dict[tuple[_Map | None, _Map | None], tuple[Texture | None, bool]] = {}
        self.ignored: list[str] = []
        self.undefined: list[str] = []
        self.warned: set[str] = set()
        seen = set()
        for line, text in references:
            if text in seen:
                continue
            seen.add(text)
            where = f"line {line}: mtllib"
            for library in filter(None, self._libraries(text, where)):
                with within(self.owner):
                    self._read(library)

    def _libraries(self, text: str, where: str) -> list[str | None]:
        """Return the paths of the libraries that a mtllib line names: one whose name may have blanks, or several."""
        names, at = text.split(), (self.owner, where)
        if re.match(r"[A-Za-z]:|[\\/]", text) or len(names) == 1:
            return [self.images.find(text, *at)]
        if self.images.has(text, *at) or not any(self.images.has(name, *at) for name in names):
            whole = self.images.find(text, *at, optional=True)
            if whole is not None:
                return [whole]
        return [self.images.find(name, *at) for name in names]

    def _read(self, library: str) -> None:
        material = None
        for number, line in enumerate(read_file(library, MAX_BYTES).splitlines(), 1):
            words = line.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace").split(None, 1)
            if len(words) < 2:
                continue
            keyword, rest, where = words[0].lower(), words[1].strip(), f"line {number}: {words[0][:16]}"
            if keyword == "newmtl":
                material = self.found.setdefault(rest, _Found())
            elif material is not None:
                self._statement(material, keyword, rest, library, where)

    def _statement(self, material: _Found, keyword: str, rest: str, library: str, where: str) -> None:
        owner = shown(library)
        if keyword in ("ka", "kd", "ks"):
            material.values[keyword] = _color(rest, owner, where)
        elif keyword == "ns":
            (value,) = _floats(rest, owner, where, (1,), "a number up to 1e9")
            if value > 1e9:
                raise file_error(owner, where, "a number up to 1e9", f"{value:g}")
            if value < 0.0:  # Blender 2.7 wrote -1.960784
                self._warn("Ns below 0 is read as 0")
            material.values["n"] = max(value, 0.0)
        elif keyword == "d":
            material.values["opacity"] = _opacity(rest, owner, where)
        elif keyword == "tr":
            material.transparency = _opacity(rest, owner, where)
        elif keyword == "illum":
            (value,) = _floats(rest, owner, where, (1,), "a number")
            material.model = int(min(max(value, 0.0), 99.0))
            if material.model > 2:
                material.ignored.append("reflection and refraction (illum)")
        elif keyword == "map_kd":
            material.mapped, material.image = True, self._map(rest, library, where, material)
        elif keyword == "map_d":
            material.mask = self._map(rest, library, where, material)
        elif keyword in _IGNORED and not _is_default(keyword, rest):
            material.ignored.append(_IGNORED[keyword])
        elif keyword.startswith("map_") and keyword not in _IGNORED:
            material.ignored.append(keyword[:32])

    def _map(self, text: str, library: str, where: str, material: _Found) -> _Map | None:
        """Return a map's image and those of its options that are rendered; None, with a warning, without an image."""
        name, options = _split_options(text, material.ignored, shown(library), where)
        path = self.images.find(name, shown(library), where, os.path.dirname(library))
        return None if path is None else _Map(path, **options)

    def material(self, name: str | None, textured: bool) -> tuple[Material, Array | None]:
        """Return the material of that name, the default one if no library has it, and (2, 2) scale and offset of its texture
        coordinates or None. textured: whether faces have texture coordinates."""
        found, own = self.found.get(name or ""), self.own if textured else None
        if found is None:
            if name is not None and name not in self.undefined:
                self.undefined.append(name)
            return replace(DEFAULT_MATERIAL, texture=own), None
        self.ignored += found.ignored
        if found.mapped and not any(found.values["kd"]):  # exporters mean the map alone, by which others multiply it
            found.values["kd"] = [1.0, 1.0, 1.0]
            self._warn("materials with Kd 0 0 0 and a map_Kd are read with Kd 1 1 1")
        values = {"ka": found.values["kd"], "opacity": self._opacity_of(found), **found.values}
        values["blend"] = values["opacity"] < 1.0
        # (R.V)^0 is no highlight but a white half of the surface with a hard edge. Exporters that know none write Ks 1 and
        # Ns 0; Blender, Unity and Asset Forge draw these without (github.com/castle-engine/castle-engine/issues/178).
        if found.model == 1 or values["n"] == 0.0:
            values["ks"] = 0.0
        if found.model == 0:
            values.update(color=values["kd"], ka=1.0 / AMBIENT, kd=0.0, ks=0.0)
        source = found.image or found.mask
        if source is None or not textured or own is not None:
            if source is not None and not textured:
                self.ignored.append("textures of faces without texture coordinates")
            return Material(**values, texture=own, name=name or ""), None
        key = (found.image, found.mask)
        if key not in self.textures:
            self.textures[key] = self._texture(found)
        texture, masked = self.textures[key]
        moved = np.array([source.scale, source.offset])
        material = Material(**{**values, "blend": values["blend"] or masked}, texture=texture, name=name or "")
        return material, None if (moved == [[1.0, 1.0], [0.0, 0.0]]).all() else moved

    def _opacity_of(self, found: _Found) -> float:
        """Return 1 - Tr for a material without d. Tr 1 alone counts as opaque, with a warning: MeshLab and OpenMVS wrote and
        read it so, where tinyobjloader, Assimp and three.js find the object invisible."""
        if found.transparency != 1.0:
            return 1.0 - (found.transparency or 0.0)
        if "opacity" not in found.values:
            self._warn("materials with Tr 1 and without d are read as opaque")
        return 1.0

    def _warn(self, remark: str) -> None:
        """Warn of how materials are read, once."""
        if remark not in self.warned:
            self.warned.add(remark)
            warnings.warn(f"{self.owner}: {remark}", stacklevel=2)

    def _texture(self, found: _Found) -> tuple[Texture | None, bool]:
        """Return the texture of map_Kd, with map_d as its alpha, and whether it has a map_d; None if neither can be read."""
        source = found.image or found.mask
        wrap: Wrap = "clamp" if source is not None and source.clamp else "repeat"
        image = None if found.image is None else self.images.at(found.image.path, srgb=True)
        mask = None if found.mask is None else self._alpha(found.mask.path)
        name = "" if source is None else os.path.basename(source.path)
        if image is not None and mask is not None and image.shape[:2] != mask.shape:
            self.ignored.append("map_d of another size than map_Kd")
            mask = None
        if mask is None and image is not None:
            if image.shape[2] == 4 and found.image is not None:
                warnings.warn(f"{shown(found.image.path)}: image: its alpha channel is left out", stacklevel=2)
            return Texture(image[:, :, :3], wrap=wrap, name=name), False
        if mask is None:
            return None, False
        colors = np.ones((*mask.shape, 3), np.float32) if image is None else image[:, :, :3]
        return Texture(np.concatenate([colors, mask[:, :, None]], axis=2), wrap=wrap, name=name), True

    def _alpha(self, path: str) -> Array | None:
        """Return (h, w) of a map_d: its alpha channel, or its mean color if it has none."""
        image = self.images.at(path, srgb=False)
        if image is None:
            return None
        numbers = np.asarray(image)
        return numbers[:, :, 3] if image.shape[2] == 4 else numbers.mean(axis=2)


def _is_default(keyword: str, rest: str) -> bool:
    """Return whether a statement that is not rendered has its default value."""
    value = {"ke": 0.0, "tf": 1.0, "pr": 1.0, "pm": 0.0, "ps": 0.0, "pc": 0.0, "aniso": 0.0}.get(keyword)
    words = rest.split("#", 1)[0].split()
    return value is not None and all(_NUMBER.fullmatch(word) is not None and float(word) == value for word in words)


def _split_options(text: str, ignored: list[str], owner: str, where: str) -> tuple[str, dict[str, Any]]:
    """Return the file name after the options of a map, which may contain blanks, and those options that are rendered.

    Raises InputError for a number that float64 cannot hold.
    """
    options: dict[str, Any] = {}
    place = 0
    while (word := _WORD.match(text, place)) and word.group().lower() in _OPTIONS:
        name, place = word.group().lower(), word.end()
        count, numbers_only = _OPTIONS[name], _OPTIONS[name] == 0
        values: list[str] = []
        while len(values) < (3 if numbers_only else count):
            found = re.compile(r"\s+(\S+)(?=\s)").match(text, place)
            if found is None or (numbers_only and not _NUMBER.fullmatch(found.group(1))):
                break
            values.append(found.group(1))
            place = found.end()
            if _NUMBER.fullmatch(values[-1]) and math.isinf(float(values[-1])):
                raise file_error(owner, f"{where}: {name}", "finite numbers", quoted(values[-1]))
        if name in ("-s", "-o") and values:
            first, second = float(values[0]), float((values[1:] or ["1" if name == "-s" else "0"])[0])
            options["scale" if name == "-s" else "offset"] = (first, second)
        elif name == "-clamp":
            options["clamp"] = values == ["on"]
        else:
            ignored.append(f"option {name} of maps")
        place += len(text[place:]) - len(text[place:].lstrip())
    return text[place:], options


def _floats(text: str, owner: str, where: str, allowed: tuple[int, ...], expected: str) -> list[float]:
    text = text.split("#", 1)[0]
    values = numbers(text.encode(), float, len(text.split()))
    if values is None or len(values) not in allowed or not np.isfinite(values).all():
        raise file_error(owner, where, expected, quoted(text))
    return [float(value) for value in values]


def _color(text: str, owner: str, where: str) -> list[float]:
    """Return three channels from three numbers or one; spectral and xyz colors are not supported."""
    values = _floats(text, owner, where, (1, 3), "one or three finite numbers")
    return values * 3 if len(values) == 1 else values


def _opacity(text: str, owner: str, where: str) -> float:
    """Return the number of a d or Tr, clamped to [0, 1]; d's option -halo, opaque where seen from the front, is left out."""
    (value,) = _floats(text.removeprefix("-halo"), owner, where, (1,), "a number")
    return min(max(value, 0.0), 1.0)
