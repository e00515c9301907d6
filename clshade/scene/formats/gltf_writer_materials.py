"""Materials and textures of a glTF file that is written."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np

from ...base.arrays import Bytes, Floats
from ...images import png
from ...images.tonemap import srgb_curve
from ..material import COMPONENTS, is_unlit
from ..model import Material, MetallicRoughness, Texture, Wrap
from .glb import Glb
from .gltf_writer_meshes import named

_WRAPS: dict[Wrap, int] = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_FILTERS = {"nearest": 9728, "linear": 9729}
_PNG_LEVEL = 6  # of zlib


class MaterialWriter:
    """Writes materials into a file, equal ones once.

    ambient: light by which unlit materials show their color, (3,). lost: collects a few words for what the file does not
    say. decode: for scenes whose image is shown without a curve: colors and texels are sRGB then.
    """

    def __init__(self, glb: Glb, ambient: Floats, lost: list[str], *, decode: bool) -> None:
        self.glb, self.ambient, self.lost, self.decode = glb, ambient, lost, decode
        self._images: dict[bytes, int] = {}
        self._textures: dict[tuple[int, str], tuple[int, float]] = {}
        self._materials: dict[str, int] = {}

    def write(self, material: Material, sets: int) -> int:
        """Return the index of a material, for a mesh with so many sets of texture coordinates."""
        unlit = is_unlit(material) and bool(material.ka.any())
        facets = material.microfacets
        color = np.asarray(material.color) * (material.ka * self.ambient if unlit else material.diffuse)
        counts = material.blend or material.alpha_cutoff is not None
        reflection: dict[str, Any] = {
            "metallicFactor": 0.0 if unlit else facets.metallic,
            "roughnessFactor": 1.0 if unlit else facets.roughness,
        }
        entry = {**named(material.name), "pbrMetallicRoughness": reflection, **self._alpha(material)}
        if material.sides == "both":
            entry["doubleSided"] = True
        color = color * self._put(reflection, "baseColorTexture", material.texture, sets, "color")
        reflection["baseColorFactor"] = [*self._clamped(color).tolist(), material.opacity if counts else 1.0]
        self._put(reflection, "metallicRoughnessTexture", facets.metallic_roughness_texture, sets, "numbers")
        if unlit:
            entry["extensions"] = self.glb.use("KHR_materials_unlit", {})
        else:
            extensions = self._maps(entry, facets, sets)
            if extensions:
                entry["extensions"] = extensions
        entry["extras"] = {"clshade": _phong(material)}
        text = json.dumps(entry)
        if text not in self._materials:
            self._materials[text] = self.glb.add("materials", entry)
        return self._materials[text]

    def _alpha(self, material: Material) -> dict[str, Any]:
        if material.blend:
            if material.alpha_cutoff is not None:
                self.lost.append("alpha tests of materials that blend")
            return {"alphaMode": "BLEND"}
        if material.alpha_cutoff is None:
            return {}
        return {"alphaMode": "MASK", "alphaCutoff": max(material.alpha_cutoff, 0.0)}

    def _maps(self, entry: dict[str, Any], facets: MetallicRoughness, sets: int) -> dict[str, Any]:
        """Add maps and emission to a material; return its extensions."""
        normal, occlusion = facets.normal_texture, facets.occlusion_texture
        self._put(entry, "normalTexture", normal, sets, "numbers", scale=facets.normal_scale)
        self._put(entry, "occlusionTexture", occlusion, sets, "numbers", strength=facets.occlusion_strength)
        extensions: dict[str, Any] = {}
        emission = np.asarray(facets.emission) * self._put(
            entry, "emissiveTexture", facets.emission_texture, sets, "color"
        )
        strength = max(float(emission.max()), 1.0)
        if emission.any():
            entry["emissiveFactor"] = (emission / strength).tolist()
        if strength > 1.0:
            extensions |= self.glb.use("KHR_materials_emissive_strength", {"emissiveStrength": strength})
        if facets.ior != 1.5:
            extensions |= self.glb.use("KHR_materials_ior", {"ior": facets.ior})
        color = np.asarray(facets.specular_color)
        if facets.specular != 1.0 or (color != 1.0).any():
            dielectric = {"specularFactor": facets.specular, "specularColorFactor": color.tolist()}
            extensions |= self.glb.use("KHR_materials_specular", dielectric)
        return extensions

    def _put(
        self, entry: dict[str, Any], name: str, texture: Texture | None, sets: int, kind: str, **fields: float
    ) -> float:
        """Add a texture to an object, if there is one and the mesh has its coordinates; return what its texels are to be
        multiplied by."""
        if texture is None or texture.coordinates >= sets:
            return 1.0
        index, scale = self._texture(texture, kind)
        found: dict[str, Any] = {"index": index}
        if texture.coordinates:
            found["texCoord"] = texture.coordinates
        found |= {key: value for key, value in fields.items() if value != 1.0}
        if texture.lookup == "course":  # u (w-1) + 0.5 texels from the left edge
            height, width = texture.image.shape[:2]
            sizes = np.array([width, height], np.float64)
            moved = {"offset": (0.5 / sizes).tolist(), "scale": ((sizes - 1.0) / sizes).tolist()}
            found["extensions"] = self.glb.use("KHR_texture_transform", moved)
        entry[name] = found
        return scale

    def _texture(self, texture: Texture, kind: str) -> tuple[int, float]:
        """Return the index of a texture, and what its texels are to be multiplied by. kind: color or numbers."""
        key = id(texture), kind
        if key not in self._textures:
            codes, scale = self._codes(texture, kind)
            file = io.BytesIO()
            png.encode(file, codes, _PNG_LEVEL)
            image = self._image(file.getvalue(), texture.name)
            wraps: Any = ("clamp", "clamp") if texture.lookup == "course" else texture.wrap
            sampler = {
                "magFilter": _FILTERS[texture.filter],
                "wrapS": _WRAPS[wraps[0]],
                "wrapT": _WRAPS[wraps[1]],
            }
            entry = {**named(texture.name), "sampler": self.glb.shared("samplers", sampler), "source": image}
            self._textures[key] = self.glb.shared("textures", entry), scale
        return self._textures[key]

    def _image(self, data: bytes, name: str) -> int:
        if data not in self._images:
            entry = {**named(name), "bufferView": self.glb.view(data), "mimeType": "image/png"}
            self._images[data] = self.glb.add("images", entry)
        return self._images[data]

    def _codes(self, texture: Texture, kind: str) -> tuple[Bytes, float]:
        """Return the codes (h, w, 3 or 4) of a texture, and what they are to be multiplied by."""
        image = texture.image.astype(np.float64)
        most = float(image[..., :3].max())
        scale = 1.0
        if kind == "color" and most > 1.0 and not self.decode:
            scale = most
            image[..., :3] /= scale
        image = self._clamped(image)
        if kind == "color" and not self.decode:
            image[..., :3] = srgb_curve(image[..., :3])
        return np.rint(image * 255.0).astype(np.uint8), scale

    def _clamped(self, values: Floats) -> Floats:
        clamped = np.clip(values, 0.0, 1.0)
        if (clamped != values).any():
            self.lost.append("colors beyond 0 to 1 (clamped)")
        return clamped


def _phong(material: Material) -> dict[str, Any]:
    """Return what glTF cannot say of a material."""
    found: dict[str, Any] = {name: np.asarray(getattr(material, name)).tolist() for name in COMPONENTS.values()}
    return {**found, "n": material.n, "color": np.asarray(material.color).tolist(), "two_sided": material.two_sided}
