"""Materials and textures of glTF files, converted to the Phong model."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any, TypeAlias
from urllib.parse import unquote

import numpy as np

from ...base.arrays import Array
from ...base.input_files import read_file
from ...images.decode import MAX_BYTES, CodedImage
from ..framing import AMBIENT
from ..material import MAPS, MAX_NORMAL_SCALE
from ..model import Material, MetallicRoughness, Texture
from ..texture import Filter, Wrap
from .gltf_data import GltfData, Item, data_of
from .reading import Images

_REPEAT = 10497
_WRAPS: dict[int, Wrap] = {_REPEAT: "repeat", 33071: "clamp", 33648: "mirror"}
_MAX_EMISSION = float(np.finfo(np.float32).max)
_NEAREST, _LINEAR = 9728, 9729
MIN_LOBE_EXPONENT = 12.0  # the exponent from which on lobes stay as they are

Coordinates: TypeAlias = tuple[int, tuple[float, ...] | None]  # number of the attribute, rows of the transform


@dataclass(frozen=True)
class Surface:
    """A material, and the texture coordinates of its textures.

    coordinates: for each set that its textures look up, the number of the TEXCOORD attribute and the transform, (2, 3) for
    (u, v, 1), or None. alpha_counts: whether alpha, also of vertices, has an effect.
    """

    material: Material
    coordinates: tuple[Coordinates, ...]
    alpha_counts: bool


def phong(metallic: float, roughness: float, base: float) -> tuple[float, float, float]:
    """Return Phong's kd, ks and n for metallic-roughness, under a surface color that multiplies all of them.

    metallic, roughness: 0 to 1. base: mean of the base color, by which ks is divided, because the color of a Material
    also tints the highlight. Returns (kd, ks, n).

    The microfacet model of glTF 2.0 (appendix B) has alpha = roughness^2, and 2/alpha^2 - 2 is the exponent of the
    half vector whose lobe is as wide (Blinn's form of Beckmann's distribution). The mirrored direction moves twice as
    fast as the half vector, so Phong's exponent is a quarter of that: m = (1/alpha^2 - 1) / 2, at most 4999.5, as a
    roughness below 0.1 counts as 0.1. A normalized lobe beside a diffuse term of 1/pi has the peak
    F0 * (m+2)/2 with F0 = 0.04 + metallic * (base - 0.04); it is limited to 1, the brightness of a white diffuse
    surface.
    Diffuse is 1 - metallic of the base color; metals keep 0.4 of it, for the environment that they would reflect and
    that a scene of point lights lacks.

    A wide lobe (m below MIN_LOBE_EXPONENT) would end at N.L = 0 with a bright edge, for Phong's highlight is not weighted
    by N.L. It becomes a lobe with that exponent and diffuse light, which together have its peak and its energy, see
    README.md; diffuse light is at most 1 then, as more than all cannot be reflected.
    """
    alpha = max(roughness * roughness, 1e-2)
    wide = (1.0 / (alpha * alpha) - 1.0) / 2.0
    reflectance = 0.04 + metallic * (base - 0.04)
    peak = min(reflectance * (wide + 2.0) / 2.0, 1.0)
    diffuse, exponent = 1.0 - 0.6 * metallic, max(wide, MIN_LOBE_EXPONENT)
    if wide < MIN_LOBE_EXPONENT:
        total, peak = peak, peak * (wide / (wide + 2.0)) * ((MIN_LOBE_EXPONENT + 2.0) / MIN_LOBE_EXPONENT)
        diffuse = min(diffuse + (total - peak) / max(base, 0.04), 1.0)
    return diffuse, peak / max(base, 0.04), exponent


class Materials:
    """The materials of a glTF file by index. Images are decoded on first use.

    replacement: a texture in place of the file's. Raises InputError for broken fields.
    """

    def __init__(self, file: GltfData, replacement: Texture | None) -> None:
        self.document, self.file, self.replacement = file.document, file, replacement
        self._surfaces: dict[int | None, Surface] = {}
        self._images = Images(file.path)
        self._textures: dict[tuple[int, bool, bool, int], Texture | None] = {}

    def surface(self, index: int | None) -> Surface:
        """Return the material with that index; None is glTF's default material."""
        if index not in self._surfaces:
            default = Item({}, "material", self.file)
            self._surfaces[index] = self._surface(default if index is None else self.document.entry("materials", index))
        return self._surfaces[index]

    def _surface(self, item: Item) -> Surface:
        reflection = item.part("pbrMetallicRoughness")
        *color, opacity = reflection.numbers("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0)).tolist()
        metallic, roughness = _factor(reflection, "metallicFactor"), _factor(reflection, "roughnessFactor")
        mode = item.choice("alphaMode", ("OPAQUE", "MASK", "BLEND"), "OPAQUE")
        cutoff = item.number("alphaCutoff", 0.5) if mode == "MASK" else 0.0
        alpha_counts = mode == "BLEND" or cutoff > 0.0
        sets: list[Coordinates] = []
        info, texture = reflection.item("baseColorTexture"), self.replacement
        if self.replacement is not None:
            sets.append((0 if info is None else info.integer("texCoord", 0), None))
        elif info is not None:
            texture = self._texture(info, True, sets, alpha_counts)
        base = float(np.mean(color))
        if texture is not None:
            with np.errstate(over="ignore"):
                base = float(np.mean(texture.mean() * color))
        kd, ks, n = phong(metallic, roughness, base)
        double = item.value.get("doubleSided") is True
        material = Material(
            ka=1.0,
            kd=kd,
            ks=ks,
            n=n,
            color=color,
            texture=texture,
            name=item.text("name"),
            sides="both" if double else "front",
            two_sided=double,
            alpha_cutoff=cutoff if cutoff > 0.0 else None,
            pbr=MetallicRoughness(metallic, roughness, **self._maps(item, reflection, sets)),
            blend=mode == "BLEND",
            opacity=_clamped(reflection, "baseColorFactor", opacity, 0.0, 1.0) if alpha_counts else 1.0,
        )
        if item.extension("KHR_materials_unlit") is not None:  # the color itself, independent of the lights
            material = replace(material, ka=1.0 / AMBIENT, kd=0.0, ks=0.0, pbr=None)
        return Surface(material, tuple(sets), alpha_counts)

    def _maps(self, item: Item, reflection: Item, sets: list[Coordinates]) -> dict[str, Any]:
        """Return the fields of MetallicRoughness for maps, emission and extensions."""
        fields: dict[str, Any] = {}
        ior, specular = item.extension("KHR_materials_ior"), item.extension("KHR_materials_specular")
        if ior is not None:
            index = ior.number("ior", 1.5, minimum=0.0)
            fields["ior"] = _clamped(ior, "ior", index, 1.0, math.inf) if index else 0.0
        if specular is not None:
            fields["specular"] = _factor(specular, "specularFactor")
            tint = specular.numbers("specularColorFactor", 3, (1.0, 1.0, 1.0))
            fields["specular_color"] = _clamped(specular, "specularColorFactor", tint, 0.0, math.inf)
            if "specularTexture" in specular.value or "specularColorTexture" in specular.value:
                self.file.ignored.append("maps of KHR_materials_specular")
        surface = reflection.item("metallicRoughnessTexture")
        if surface is not None:
            fields["metallic_roughness_texture"] = self._texture(surface, False, sets)
        normal, occlusion, emission = (item.item(f"{name}Texture") for name in ("normal", "occlusion", "emissive"))
        if normal is not None:
            fields["normal_texture"] = self._texture(normal, False, sets)
            scale = normal.number("scale", 1.0)
            fields["normal_scale"] = _clamped(normal, "scale", scale, -MAX_NORMAL_SCALE, MAX_NORMAL_SCALE)
        if occlusion is not None:
            fields["occlusion_texture"] = self._texture(occlusion, False, sets)
            fields["occlusion_strength"] = _factor(occlusion, "strength")
        color = item.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0))
        color = _clamped(item, "emissiveFactor", color, 0.0, _MAX_EMISSION)
        strength = item.extension("KHR_materials_emissive_strength")
        scale = 1.0 if strength is None else strength.number("emissiveStrength", 1.0, minimum=0.0)
        emitted = color * min(scale, 1e200)
        fields["emission"] = _clamped(strength or item, "emissiveStrength", emitted, 0.0, _MAX_EMISSION)
        if emission is not None and color.any():
            fields["emission_texture"] = self._texture(emission, True, sets)
        return fields

    def _texture(self, item: Item, srgb: bool, sets: list[Coordinates], alpha: bool = False) -> Texture | None:
        """Return a texture; its coordinates are added to `sets`. srgb: whether its colors are; else numbers. alpha: whether
        to keep that channel."""
        index = item.index("index", "textures")
        coordinates: Coordinates = item.integer("texCoord", 0), None
        transform = item.extension("KHR_texture_transform")
        if transform is not None:
            coordinates = transform.integer("texCoord", coordinates[0]), _transform(transform)
        if coordinates not in sets:
            sets.append(coordinates)
        key = index, srgb, alpha, sets.index(coordinates)
        if key not in self._textures:
            self._textures[key] = self._loaded(self.document.entry("textures", index), *key[1:])
        return self._textures[key]

    def _loaded(self, entry: Item, srgb: bool, alpha: bool, coordinates: int) -> Texture | None:
        webp = entry.extension("EXT_texture_webp")
        source = (webp or entry).reference("source", "images")
        image = None if source is None else self._image(source, srgb)
        if source is None or image is None:
            return None
        index = entry.reference("sampler", "samplers")
        sampler = Item({}, "sampler", self.file) if index is None else entry.entry("samplers", index)
        wrap_u, wrap_v = (_WRAPS[sampler.choice(key, _WRAPS, _REPEAT)] for key in ("wrapS", "wrapT"))
        # The filter of magnification: minification is a setting.
        filter: Filter = "nearest" if sampler.integer("magFilter", _LINEAR) == _NEAREST else "linear"
        name = entry.text("name") or self.document.entry("images", source).text("name")
        rgb = image if alpha else image[:, :, :3]
        return Texture(rgb, wrap=(wrap_u, wrap_v), name=name, filter=filter, coordinates=coordinates)

    def _image(self, index: int, srgb: bool) -> CodedImage | None:
        """Return (h, w, 3 or 4), row 0 at the top, colors linear; None, with a warning, if it cannot be had."""
        item = self.document.entry("images", index)

        def read() -> bytes | memoryview | None:
            view = item.reference("bufferView", "bufferViews")
            if view is not None:
                return self.file.view(view)[0]
            text = item.text("uri")
            if not text:
                raise item.error("uri", "a file, data or a bufferView", "none")
            if text.startswith("data:"):
                return data_of(item, text)
            where = self.file.owner, item.path("uri")
            if "%" not in text or not self._images.has(text, *where):  # exporters forget to encode it
                text = unquote(text)
            path = self._images.find(text, *where)
            return None if path is None else read_file(path, MAX_BYTES)

        return self._images.decoded(f"{self.file.owner}: {item.where}", read, srgb=srgb)


def _clamped(item: Item, key: str, values: Any, low: float, high: float) -> Any:
    """Return a number or an array, clamped to what the specification allows, with a warning where that changes it."""
    clamped = np.clip(values, low, high)
    if (clamped != values).any():
        words = f"from {low:g} to {high:g}" if high < math.inf else f"from {low:g} on"
        wrong = " ".join(f"{number:g}" for number in np.ravel(values)[np.ravel(clamped != values)])
        line = f"{item.file.owner}: {item.path(key)}: expected numbers {words}, found {wrong}: clamped"
        warnings.warn(line, stacklevel=2)
    return clamped if np.ndim(values) else float(clamped)


def _factor(item: Item, key: str) -> float:
    """Return a factor from 0 to 1, by default 1. Raises InputError if it is below 0."""
    return float(_clamped(item, key, item.number(key, 1.0, minimum=0.0), 0.0, 1.0))


def _transform(item: Item) -> tuple[float, ...] | None:
    """Return the rows of (2, 3) of a KHR_texture_transform: scale, then rotation, then offset; None for the identity."""
    (su, sv), (du, dv) = item.numbers("scale", 2, (1.0, 1.0)), item.numbers("offset", 2, (0.0, 0.0))
    angle = item.number("rotation", 0.0)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.array([[cosine * su, sine * sv, du], [-sine * su, cosine * sv, dv]])
    return None if (matrix == np.eye(2, 3)).all() else tuple(matrix.ravel().tolist())


def transform_uvs(uvs: Array | None, rows: tuple[float, ...] | None) -> Array | None:
    """Return texture coordinates (V, 2) after a transform given by its rows."""
    if uvs is None or rows is None:
        return uvs
    matrix = np.reshape(rows, (2, 3))
    return np.asarray(uvs.astype(np.float64) @ matrix[:, :2].T + matrix[:, 2])


def with_coordinates(material: Material, uvs: list[Array | None]) -> Material:
    """Return the material without the textures whose coordinates, one set after the other, are missing."""
    if all(table is not None for table in uvs):
        return material

    def usable(texture: Texture | None) -> Texture | None:
        return None if texture is None or uvs[texture.coordinates] is None else texture

    facets = material.pbr
    if facets is not None:
        maps: dict[str, Any] = {name: usable(getattr(facets, name)) for name in MAPS}
        facets = replace(facets, **maps)
    return replace(material, texture=usable(material.texture), pbr=facets)
