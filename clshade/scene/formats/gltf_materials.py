"""Materials and textures of glTF files, converted to the Phong model."""

from __future__ import annotations

import math
import os
import warnings
from dataclasses import dataclass, replace

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import shown
from ...base.input_files import file_error, quoted, read_file
from ...images.decode import MAX_BYTES as MAX_IMAGE_BYTES
from ...images.decode import decode_image
from ..framing import AMBIENT
from ..model import Material, Texture, Wrap
from .gltf_accessors import Buffers
from .gltf_json import Item
from .mtl import MAX_PIXELS

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_SMALLEST_ALPHA = 1.0 / 512.0  # the least that is visible with blending
_MAPS = {
    "normalTexture": "normal maps",
    "occlusionTexture": "occlusion maps",
    "emissiveTexture": "emission",
}


@dataclass(frozen=True)
class Surface:
    """A material, and the texture coordinates of its texture.

    coordinates: the number of the TEXCOORD set. transform: (2, 3) for (u, v, 1), or None. visible: False if its alpha
    is too low everywhere. alpha_counts: whether alpha decides where it is seen.
    """

    material: Material
    coordinates: int
    transform: Array | None
    visible: bool
    alpha_counts: bool


def phong(metallic: float, roughness: float, base: float) -> tuple[float, float, float]:
    """Return Phong's kd, ks and n for metallic-roughness, under a surface color that multiplies all of them.

    metallic, roughness: 0 to 1. base: mean of the base color, by which ks is divided, because the color of a Material
    also tints the highlight. Returns (kd, ks, n).

    The microfacet model of glTF 2.0 (appendix B) has alpha = roughness^2, and 2/alpha^2 - 2 is the exponent of the
    half vector whose lobe is as wide (Blinn's form of Beckmann's distribution). The mirrored direction moves twice as
    fast as the half vector, so Phong's exponent is a quarter of that: n = (1/alpha^2 - 1) / 2, at least 1 and, as a
    roughness below 0.1 counts as 0.1, at most 4999.5. A normalized lobe beside a diffuse term of 1/pi has the peak
    F0 * (n+2)/2 with F0 = 0.04 + metallic * (base - 0.04); it is limited to 1, the brightness of a white diffuse
    surface.
    Diffuse is 1 - metallic of the base color; metals keep 0.4 of it, for the environment that they would reflect and
    that a scene of point lights lacks.
    """
    alpha = max(roughness * roughness, 1e-2)
    exponent = max((1.0 / (alpha * alpha) - 1.0) / 2.0, 1.0)
    reflectance = 0.04 + metallic * (base - 0.04)
    peak = min(reflectance * (exponent + 2.0) / 2.0, 1.0)
    return 1.0 - 0.6 * metallic, peak / max(base, 0.04), exponent


class Materials:
    """The materials of a glTF file by index. Images are decoded on first use.

    own: a texture in place of the file's. ignored: collects a few words for each feature that is not rendered.
    Raises InputError for broken fields and images, references out of the folder, and more than MAX_PIXELS pixels.
    """

    def __init__(self, document: Item, buffers: Buffers, own: Texture | None, ignored: list[str]) -> None:
        self.document, self.buffers, self.own, self.ignored = document, buffers, own, ignored
        self._surfaces: dict[int | None, Surface] = {}
        self._images: dict[int, Array | None] = {}
        self._textures: dict[tuple[int, bool], Texture | None] = {}
        self._pixels = 0

    def surface(self, index: int | None) -> Surface:
        """Return the material with that index; None is glTF's default material."""
        if index not in self._surfaces:
            empty = Item({}, "material", self.document.root, self.document.owner)
            item = empty if index is None else self.document.entry("materials", index)
            self._surfaces[index] = self._surface(item)
        return self._surfaces[index]

    def _surface(self, item: Item) -> Surface:
        reflection = item.item("pbrMetallicRoughness") or Item({}, item.where, item.root, item.owner)
        *color, opacity = reflection.numbers("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0)).tolist()
        metallic = min(reflection.number("metallicFactor", 1.0, least=0.0), 1.0)
        roughness = min(reflection.number("roughnessFactor", 1.0, least=0.0), 1.0)
        self._note_maps(item, reflection)
        cutoff = self._cutoff(item)
        texture, coordinates, transform = self._texture(reflection.item("baseColorTexture"), cutoff is not None)
        base = float(np.mean(color))
        if texture is not None:
            with np.errstate(over="ignore"):
                base = float(np.mean(texture.image[..., :3].mean(axis=(0, 1), dtype=np.float64) * color))
        kd, ks, n = phong(metallic, roughness, base)
        double = item.value.get("doubleSided") is True
        material = Material(
            **{"ka": 1.0, "kd": kd, "ks": ks, "n": n},
            color=color,
            texture=texture,
            name=item.text("name"),
            sides="both" if double else "front",
            two_sided=double,
        )
        if item.extension("KHR_materials_unlit") is not None:  # the color itself, independent of the lights
            material = replace(material, ka=1.0 / AMBIENT, kd=0.0, ks=0.0)
        visible, alpha_counts = True, cutoff is not None and cutoff > 0.0
        if cutoff is not None and cutoff > 0.0:
            visible = opacity > 0.0 and (texture is not None or opacity >= cutoff)
            if visible and texture is not None and texture.image.shape[2] == 4:
                material = replace(material, alpha_cutoff=cutoff / opacity)
        return Surface(material, coordinates, transform, visible, alpha_counts)

    def _note_maps(self, item: Item, reflection: Item) -> None:
        for key, words in _MAPS.items():
            if key in item.value:
                self.ignored.append(words)
        if item.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0)).any():
            self.ignored.append("emission")
        if "metallicRoughnessTexture" in reflection.value:
            self.ignored.append("metallic-roughness textures")

    def _cutoff(self, item: Item) -> float | None:
        """Return the alpha below which nothing is drawn, or None for an opaque material."""
        mode = item.text("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return None
        if mode == "BLEND":
            self.ignored.append("blending (opaque where alpha is not 0)")
            return _SMALLEST_ALPHA
        if mode != "MASK":
            raise item.error("alphaMode", "OPAQUE, MASK or BLEND", quoted(mode))
        return item.number("alphaCutoff", 0.5)

    def _texture(self, item: Item | None, alpha: bool) -> tuple[Texture | None, int, Array | None]:
        """Return a texture, the number of its coordinates and their transform. alpha: whether to keep that channel."""
        if self.own is not None:
            return self.own, 0 if item is None else item.integer("texCoord", 0), None
        if item is None:
            return None, 0, None
        index = item.reference("index", "textures")
        if index is None:
            raise item.error("index", "an index", "none")
        coordinates, transform = item.integer("texCoord", 0), None
        moved = item.extension("KHR_texture_transform")
        if moved is not None:
            coordinates = moved.integer("texCoord", coordinates)
            transform = _transform(moved)
        if (index, alpha) not in self._textures:
            self._textures[index, alpha] = self._loaded(self.document.entry("textures", index), alpha)
        return self._textures[index, alpha], coordinates, transform

    def _loaded(self, entry: Item, alpha: bool) -> Texture | None:
        webp = entry.extension("EXT_texture_webp")
        source = (webp or entry).reference("source", "images")
        image = None if source is None else self._image(source)
        if image is None:
            return None
        return Texture(image if alpha else image[:, :, :3], wrap=self._wraps(entry), name=self._name(entry, source))

    def _name(self, entry: Item, source: int | None) -> str:
        return entry.text("name") or ("" if source is None else self.document.entry("images", source).text("name"))

    def _wraps(self, entry: Item) -> tuple[Wrap, Wrap]:
        index = entry.reference("sampler", "samplers")
        if index is None:
            return "repeat", "repeat"
        sampler, found = self.document.entry("samplers", index), []
        for key in ("wrapS", "wrapT"):
            mode = sampler.integer(key, 10497)
            if mode not in _WRAPS:
                raise sampler.error(key, "one of " + ", ".join(map(str, _WRAPS)), str(mode))
            found.append(_WRAPS[mode])
        if 9728 in (sampler.value.get("magFilter"), sampler.value.get("minFilter")):
            self.ignored.append("nearest filters (bilinear)")
        return found[0], found[1]

    def _image(self, index: int) -> Array | None:
        """Return (h, w, 3 or 4) float32, linear, row 0 at the top; None, with a warning, if there is no such file."""
        if index not in self._images:
            image = self._decoded(self.document.entry("images", index))
            self._pixels += 0 if image is None else image.shape[0] * image.shape[1]
            if self._pixels > MAX_PIXELS:
                expected = f"images of at most {MAX_PIXELS} pixels in all"
                raise file_error(self.document.owner, "images", expected, "more")
            self._images[index] = image
        return self._images[index]

    def _decoded(self, item: Item) -> Array | None:
        owner = f"{item.owner}: {item.where}"
        view = item.reference("bufferView", "bufferViews")
        if view is not None:
            return decode_image(self.buffers.view(view)[0], owner, srgb=True)
        text = item.text("uri")
        if not text:
            raise item.error("uri", "a file, data or a bufferView", "none")
        found = self.buffers.resource(item, text)
        if found is None:
            warnings.warn(f"{owner}.uri: there is no file {quoted(text)}", stacklevel=2)
            return None
        if isinstance(found, str):
            owner = f"{item.owner}: {shown(os.path.basename(found))}"
            return decode_image(read_file(found, MAX_IMAGE_BYTES), owner, srgb=True)
        return decode_image(found, owner, srgb=True)


def _transform(item: Item) -> Array | None:
    """Return (2, 3) of a KHR_texture_transform: scale, then rotation, then offset; None for the identity."""
    (su, sv), (du, dv) = item.numbers("scale", 2, (1.0, 1.0)), item.numbers("offset", 2, (0.0, 0.0))
    angle = item.number("rotation", 0.0)
    cosine, sine = math.cos(angle), math.sin(angle)
    matrix = np.array([[cosine * su, sine * sv, du], [-sine * su, cosine * sv, dv]])
    return None if (matrix == np.eye(2, 3)).all() else matrix
