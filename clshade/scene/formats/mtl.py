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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import shown
from ...base.input_files import file_error, quoted, read_file, within
from ..framing import AMBIENT
from ..model import Material, Texture
from ..texture import Wrap
from .reading import DEFAULT_MATERIAL, Images
from .text_tokens import numbers

MAX_BYTES = 1 << 24  # of a library
# Keywords of numbers -> what is expected of them, and how many are allowed.
_NUMBERS = {
    **dict.fromkeys(("ka", "kd", "ks"), ("one or three finite numbers", (1, 3))),  # no spectral and xyz colors
    "ns": ("a number up to 1e9", (1,)),
    **dict.fromkeys(("d", "tr", "illum"), ("a number", (1,))),
}
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
_DEFAULTS_IGNORED = {"ke": 0.0, "tf": 1.0, "pr": 1.0, "pm": 0.0, "ps": 0.0, "pc": 0.0, "aniso": 0.0}  # change nothing
# Options of a map -> number of arguments; 0: one to three numbers.
_OPTIONS = {
    **dict.fromkeys(("-s", "-o", "-t"), 0),
    **dict.fromkeys(("-blendu", "-blendv", "-cc", "-clamp", "-texres", "-boost", "-bm", "-imfchan", "-type"), 1),
    "-mm": 2,
}
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_IDENTITY = np.array([[1.0, 1.0], [0.0, 0.0]])  # scale and offset
_WORD = re.compile(r"\S+")
_VALUE = re.compile(r"\s+(\S+)(?=\s)")  # of an option: the name of the file follows


@dataclass(frozen=True)
class _Map:
    """An image that a library names. scale, offset: of u and v."""

    path: str
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamp: bool = False


class _Statements:
    """The statements on one material. numbers: by keyword, colors as lists. maps: its map_kd and map_d, None without the
    image."""

    def __init__(self) -> None:
        self.numbers, self.maps, self.ignored = dict[str, Any](), dict[str, _Map | None](), list[str]()


class Library:
    """The materials of the libraries named by the mtllib lines of an OBJ file. Images are decoded on first use.

    path: of the OBJ file. references: (line number, text after mtllib). replacement: a texture in place of the files'.
    Files are found and left out as by `Images`. Raises InputError for malformed numbers.
    """

    def __init__(self, path: str, references: list[tuple[int, str]], replacement: Texture | None) -> None:
        self.images, self.owner = Images(path), shown(path)
        self.replacement, self.materials = replacement, dict[str, _Statements]()
        self.textures: dict[tuple[_Map | None, _Map | None], tuple[Texture | None, bool]] = {}
        self.ignored, self.undefined, self.warned = list[str](), list[str](), set[str]()
        lines: dict[str, int] = {}
        for line, text in references:
            lines.setdefault(text, line)
        for text, line in lines.items():
            for library in filter(None, self._libraries(text, f"line {line}: mtllib")):
                with within(self.owner):
                    self._read(library)

    def _libraries(self, text: str, where: str) -> list[str | None]:
        """Return the paths of the libraries that a mtllib line names: one whose name may have blanks, or several."""
        names, at = text.split(), (self.owner, where)
        if re.match(r"[A-Za-z]:|[\\/]", text) or len(names) == 1:
            return [self.images.find(text, *at)]
        if self.images.has(text, *at) or not any(self.images.has(name, *at) for name in names):
            path = self.images.find(text, *at, optional=True)
            if path is not None:
                return [path]
        return [self.images.find(name, *at) for name in names]

    def _read(self, library: str) -> None:
        material = None
        for number, line in enumerate(read_file(library, MAX_BYTES).splitlines(), 1):
            words = line.removeprefix(b"\xef\xbb\xbf").decode("utf-8", "replace").split(None, 1)
            if len(words) < 2:
                continue
            keyword, value, where = words[0].lower(), words[1].strip(), f"line {number}: {words[0][:16]}"
            if keyword == "newmtl":
                material = self.materials.setdefault(value, _Statements())
            elif material is not None:
                self._statement(material, keyword, value, library, where)

    def _statement(self, material: _Statements, keyword: str, rest: str, library: str, where: str) -> None:
        if keyword in _NUMBERS:
            expected, counts = _NUMBERS[keyword]
            rest = rest.removeprefix("-halo") if keyword in ("d", "tr") else rest  # opaque where seen from the front
            text = rest.split("#", 1)[0]
            values = numbers(text.encode(), float, len(text.split()))
            if values is None or len(values) not in counts or not np.isfinite(values).all():
                raise file_error(shown(library), where, expected, quoted(text))
            first, *_ = channels = (values.tolist() * 3)[:3]
            material.numbers[keyword] = channels if 3 in counts else first
            if keyword == "ns" and first > 1e9:
                raise file_error(shown(library), where, expected, f"{first:g}")
            if keyword == "ns" and first < 0.0:  # Blender 2.7 wrote -1.960784
                self._warn("Ns below 0 is read as 0")
            if keyword == "illum" and first >= 3.0:
                material.ignored.append("reflection and refraction (illum)")
        elif keyword in ("map_kd", "map_d"):
            name, options = _split_options(rest, material.ignored, shown(library), where)
            path = self.images.find(name, shown(library), where, os.path.dirname(library))
            material.maps[keyword] = None if path is None else _Map(path, **options)
        elif keyword in _IGNORED:
            words = rest.split("#", 1)[0].split()
            default = _DEFAULTS_IGNORED.get(keyword)
            if default is None or not all(_NUMBER.fullmatch(word) and float(word) == default for word in words):
                material.ignored.append(_IGNORED[keyword])
        elif keyword.startswith("map_"):
            material.ignored.append(keyword[:32])

    def material(self, name: str | None, textured: bool) -> tuple[Material, Array]:
        """Return the material of that name, the default one if no library has it, and (2, 2) scale and offset of its texture
        coordinates. textured: whether faces have texture coordinates."""
        statements, texture = self.materials.get(name or ""), self.replacement if textured else None
        if statements is None:
            if name is not None and name not in self.undefined:
                self.undefined.append(name)
            return replace(DEFAULT_MATERIAL, texture=texture), _IDENTITY
        self.ignored += statements.ignored
        values = self._values(statements)
        image, mask = statements.maps.get("map_kd"), statements.maps.get("map_d")
        source, transform = image or mask, _IDENTITY
        if source is not None and not textured:
            self.ignored.append("textures of faces without texture coordinates")
        elif source is not None and texture is None:
            if (image, mask) not in self.textures:
                self.textures[image, mask] = self._texture(source, image, mask)
            texture, masked = self.textures[image, mask]
            values["blend"] = values["blend"] or masked
            transform = np.array([source.scale, source.offset])
        return Material(**values, texture=texture, name=name or ""), transform

    def _values(self, statements: _Statements) -> dict[str, Any]:
        """Return the fields of a Material without its texture."""
        numbers = statements.numbers
        kd = numbers.get("kd", [0.8] * 3)
        if "map_kd" in statements.maps and not any(kd):  # exporters mean the map alone, by which others multiply it
            kd = [1.0, 1.0, 1.0]
            self._warn("materials with Kd 0 0 0 and a map_Kd are read with Kd 1 1 1")
        transparency = min(max(numbers.get("tr", 0.0), 0.0), 1.0)
        if transparency == 1.0:
            # MeshLab and OpenMVS wrote and read it so; tinyobjloader, Assimp and three.js find the object invisible.
            transparency = 0.0
            if "d" not in numbers:
                self._warn("materials with Tr 1 and without d are read as opaque")
        opacity = min(max(numbers.get("d", 1.0 - transparency), 0.0), 1.0)
        values = {"ka": numbers.get("ka", kd), "kd": kd, "ks": numbers.get("ks", 0.0)}
        values["n"] = max(numbers.get("ns", 20.0), 0.0)
        model = max(int(numbers.get("illum", 2.0)), 0)
        # (R.V)^0 is no highlight but a white half of the surface with a hard edge. Exporters that know none write Ks 1 and
        # Ns 0; Blender, Unity and Asset Forge draw these without (github.com/castle-engine/castle-engine/issues/178).
        if model == 1 or values["n"] == 0.0:
            values["ks"] = 0.0
        if model == 0:
            values.update(color=kd, ka=1.0 / AMBIENT, kd=0.0, ks=0.0)
        return {**values, "opacity": opacity, "blend": opacity < 1.0}

    def _warn(self, remark: str) -> None:
        """Warn of how materials are read, once."""
        if remark not in self.warned:
            self.warned.add(remark)
            warnings.warn(f"{self.owner}: {remark}", stacklevel=2)

    def _texture(self, source: _Map, map_kd: _Map | None, map_d: _Map | None) -> tuple[Texture | None, bool]:
        """Return the texture of map_Kd, with map_d as its alpha, and whether it has a map_d; None if neither can be read.

        source: the one of them whose options count.
        """
        wrap: Wrap = "clamp" if source.clamp else "repeat"
        image = None if map_kd is None else self.images.at(map_kd.path, srgb=True)
        mask, alpha = None, None if map_d is None else self.images.at(map_d.path, srgb=False)
        if alpha is not None:  # its alpha channel, or its mean color
            values = np.asarray(alpha)
            mask = values[:, :, 3] if values.shape[2] == 4 else values.mean(axis=2)
        if image is not None and mask is not None and image.shape[:2] != mask.shape:
            self.ignored.append("map_d of another size than map_Kd")
            mask = None
        if mask is not None:
            name = os.path.basename(source.path)
            colors = np.ones((*mask.shape, 3), np.float32) if image is None else image[:, :, :3]
            return Texture(np.concatenate([colors, mask[:, :, None]], axis=2), wrap=wrap, name=name), True
        return None if map_kd is None else self.images.texture(map_kd.path, wrap), False


def _split_options(text: str, ignored: list[str], owner: str, where: str) -> tuple[str, dict[str, Any]]:
    """Return the file name after the options of a map, which may contain blanks, and those options that are rendered.

    Raises InputError for a number that float64 cannot hold.
    """
    options: dict[str, Any] = {}
    place = 0
    while (word := _WORD.match(text, place)) and word.group().lower() in _OPTIONS:
        name, place = word.group().lower(), word.end()
        values: list[str] = []
        while len(values) < (_OPTIONS[name] or 3) and (match := _VALUE.match(text, place)):
            is_number = _NUMBER.fullmatch(match[1])
            if not _OPTIONS[name] and not is_number:
                break
            if is_number and math.isinf(float(match[1])):
                raise file_error(owner, f"{where}: {name}", "finite numbers", quoted(match[1]))
            values.append(match[1])
            place = match.end()
        if name in ("-s", "-o") and values:
            first, second = float(values[0]), float((values[1:] or ["1" if name == "-s" else "0"])[0])
            options["scale" if name == "-s" else "offset"] = (first, second)
        elif name == "-clamp":
            options["clamp"] = values == ["on"]
        else:
            ignored.append(f"option {name} of maps")
        place += len(text[place:]) - len(text[place:].lstrip())
    return text[place:], options
