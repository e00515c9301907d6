"""Writing scenes as binary glTF 2.0 files, .glb: their materials and textures, and meshes with one row per vertex."""

from __future__ import annotations

import io
import json
import os
import warnings
from typing import Any, TypeAlias

import numpy as np

from ...base import atomic_files
from ...base.arrays import Array, Bytes, Faces, Floats, Floats32
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error
from ...base.validation import path as checked_path
from ...images import png
from ...images.decode import srgb_to_linear
from ...images.tonemap import srgb_curve
from ..fitting import bounding_sphere
from ..geometry import vertex_normals
from ..material import COMPONENTS, is_unlit
from ..model import Material, Mesh, MetallicRoughness, Scene, Texture, Wrap
from ..objects import object_numbers
from ..scalar_colors import at_vertices
from .glb import INDICES, Glb, add_camera, add_lights, add_placement

ENDING = ".glb"
_OWNER = "to_glb"
_WRAPS: dict[Wrap, int] = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_FILTERS = {"nearest": 9728, "linear": 9729}
_PNG_LEVEL = 6  # of zlib
# Rows of an attribute, and their indices (F, 3); None: those of vertices.
Source: TypeAlias = tuple[Array, Faces | None]
_MAX_UV = 2.0**40  # as Mesh.uvs says
_RESTART = 65535  # as an index of 16 bits restarts strips
_EXPONENTS = range(-60, 61)  # of the largest coordinate: others are scaled by a power of two


def write_glb(scene: Scene, path: Path) -> None:
    """Write a scene as a binary glTF 2.0 file, see `Scene.to_glb`."""
    checked_path(_OWNER, "path", path)
    if os.path.splitext(path)[1].lower() != ENDING:
        raise file_error(_OWNER, "path", f"a name ending in {ENDING}", shown(path))
    atomic_files.check(path)
    glb, decode = Glb(), scene.preset == "course"
    if scene.environment is not None:
        glb.lost.append("the environment (none)")
    nodes = _add_meshes(glb, scene, MaterialWriter(glb, np.asarray(scene.ambient), decode=decode), decode=decode)
    sphere = bounding_sphere(scene.meshes)
    nodes.append(add_camera(glb, scene.camera, sphere))
    if scene.lights and scene.own_lights:
        nodes += add_lights(glb, scene.lights, sphere, scene.light_scale)
    background = None if scene.background is None else np.asarray(scene.background).tolist()
    unsaid = {"preset": scene.preset, "ambient": np.asarray(scene.ambient).tolist(), "background": background}
    glb.add("scenes", {**named(scene.name), "nodes": nodes, "extras": {"clshade": unsaid}})
    glb.write(path, _OWNER)
    if glb.lost:
        line = f"{shown(path)}: not in the file as in the scene: {', '.join(dict.fromkeys(glb.lost))}"
        warnings.warn(line if line.isprintable() else ascii(line), stacklevel=3)


def _add_meshes(glb: Glb, scene: Scene, materials: MaterialWriter, *, decode: bool) -> list[int]:
    """Add the meshes that have triangles and placements; return the indices of their nodes."""
    nodes: list[int] = []
    written: dict[Any, dict[str, Any]] = {}  # by object and nodes: the parts of an object become primitives of one mesh
    numbers = object_numbers(scene)
    parts: dict[int, list[Mesh]] = {}
    for number, mesh in zip(numbers, scene.meshes, strict=True):
        parts.setdefault(number, []).append(mesh)
    frames = {
        number: in_float32([mesh.verts[_used(mesh.faces, len(mesh.verts))] for mesh in meshes])
        for number, meshes in parts.items()
    }
    for number, mesh in zip(numbers, scene.meshes, strict=True):
        placements = np.asarray(mesh.instances)
        if not len(mesh.faces) or not len(placements):
            continue
        sets = 0 if mesh.uvs is None else 1 + len(mesh.more_uvs)
        of_parts = (part.instance_names for part in parts[number] if part.instance_names)
        names = next(of_parts, (mesh.name,) * len(placements))
        with np.errstate(over="ignore", invalid="ignore"):
            material = materials.write(mesh.material, sets)
            primitive = {**_primitive(glb, mesh, frames[number], decode=decode), "material": material}
            key = number, placements.tobytes()
            if key in written:
                written[key]["primitives"].append(primitive)
                continue
            written[key] = {**named(mesh.name), "primitives": [primitive]}
            index = glb.add("meshes", written[key])
            middle, exponent = frames[number]
            matrix = np.diag([*[np.ldexp(1.0, exponent)] * 3, 1.0])
            matrix[:3, 3] = middle
            nodes += [
                add_placement(glb, placement @ matrix, mesh=index, **named(name))
                for placement, name in zip(placements, names, strict=True)
            ]
    return nodes


class MaterialWriter:
    """Writes materials into a file, equal ones once.

    ambient: light by which unlit materials show their color, (3,). decode: for scenes whose image is shown without a
    curve: colors and texels are sRGB then.
    """

    def __init__(self, glb: Glb, ambient: Floats, *, decode: bool) -> None:
        self.glb, self.ambient, self.decode = glb, ambient, decode
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
        entry: dict[str, Any] = {**named(material.name), "pbrMetallicRoughness": reflection}
        if material.blend:
            entry["alphaMode"] = "BLEND"
            if material.alpha_cutoff is not None:
                self.glb.lost.append("alpha tests of materials that blend")
        elif material.alpha_cutoff is not None:
            entry |= {"alphaMode": "MASK", "alphaCutoff": max(material.alpha_cutoff, 0.0)}
        if material.sides == "both":
            entry["doubleSided"] = True
        color = color * self._put(reflection, "baseColorTexture", material.texture, sets, "color")
        reflection["baseColorFactor"] = [*_clamped(self.glb, color).tolist(), material.opacity if counts else 1.0]
        self._put(reflection, "metallicRoughnessTexture", facets.metallic_roughness_texture, sets, "numbers")
        if unlit:
            entry["extensions"] = self.glb.use("KHR_materials_unlit", {})
        else:
            extensions = self._maps(entry, facets, sets)
            if extensions:
                entry["extensions"] = extensions
        # What glTF cannot say of a material.
        phong: dict[str, Any] = {name: np.asarray(getattr(material, name)).tolist() for name in COMPONENTS.values()}
        phong |= {"n": material.n, "color": np.asarray(material.color).tolist(), "two_sided": material.two_sided}
        entry["extras"] = {"clshade": phong}
        text = json.dumps(entry)
        if text not in self._materials:
            self._materials[text] = self.glb.add("materials", entry)
        return self._materials[text]

    def _maps(self, entry: dict[str, Any], facets: MetallicRoughness, sets: int) -> dict[str, Any]:
        """Add maps and emission to a material; return its extensions."""
        normal, occlusion = facets.normal_texture, facets.occlusion_texture
        self._put(entry, "normalTexture", normal, sets, "numbers", scale=facets.normal_scale)
        self._put(entry, "occlusionTexture", occlusion, sets, "numbers", strength=facets.occlusion_strength)
        extensions: dict[str, Any] = {}
        scale = self._put(entry, "emissiveTexture", facets.emission_texture, sets, "color")
        emission = np.asarray(facets.emission) * scale
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
        info: dict[str, Any] = {"index": index}
        if texture.coordinates:
            info["texCoord"] = texture.coordinates
        info |= {key: value for key, value in fields.items() if value != 1.0}
        if texture.lookup == "course":  # u (w-1) + 0.5 texels from the left edge
            height, width = texture.image.shape[:2]
            sizes = np.array([width, height], np.float64)
            transform = {"offset": (0.5 / sizes).tolist(), "scale": ((sizes - 1.0) / sizes).tolist()}
            info["extensions"] = self.glb.use("KHR_texture_transform", transform)
        entry[name] = info
        return scale

    def _texture(self, texture: Texture, kind: str) -> tuple[int, float]:
        """Return the index of a texture, and what its texels are to be multiplied by. kind: color or numbers."""
        key = id(texture), kind
        if key not in self._textures:
            codes, scale = self._codes(texture, kind)
            file = io.BytesIO()
            png.encode(file, codes, _PNG_LEVEL)
            data = file.getvalue()
            if data not in self._images:
                view = {"bufferView": self.glb.view(data), "mimeType": "image/png"}
                self._images[data] = self.glb.add("images", {**named(texture.name), **view})
            wraps: Any = ("clamp", "clamp") if texture.lookup == "course" else texture.wrap
            sampler = {"magFilter": _FILTERS[texture.filter], "wrapS": _WRAPS[wraps[0]], "wrapT": _WRAPS[wraps[1]]}
            entry = {"sampler": self.glb.shared("samplers", sampler), "source": self._images[data]}
            self._textures[key] = self.glb.shared("textures", {**named(texture.name), **entry}), scale
        return self._textures[key]

    def _codes(self, texture: Texture, kind: str) -> tuple[Bytes, float]:
        """Return the codes (h, w, 3 or 4) of a texture, and what they are to be multiplied by."""
        image = texture.image.astype(np.float64)
        scale = max(float(image[..., :3].max()), 1.0) if kind == "color" and not self.decode else 1.0
        image[..., :3] /= scale
        image = _clamped(self.glb, image)
        if kind == "color" and not self.decode:
            image[..., :3] = srgb_curve(image[..., :3])
        return np.rint(image * 255.0).astype(np.uint8), scale


def _primitive(glb: Glb, mesh: Mesh, frame: tuple[Floats, int], *, decode: bool) -> dict[str, Any]:
    """Write a mesh that has triangles; return it as a primitive without material.

    frame: see `in_float32`. decode: whether vertex colors are decoded from sRGB, as for `MaterialWriter`.
    """
    used, (middle, exponent) = _used(mesh.faces, len(mesh.verts)), frame
    verts = mesh.verts if used.all() else np.where(used[:, None], mesh.verts, mesh.verts[mesh.faces[0, 0]])
    positions = verts if verts.dtype == np.float32 else np.ldexp(verts - middle, -exponent).astype(np.float32)
    sources = {"POSITION": (positions, None), **_sources(mesh)}
    colors = _colors(glb, mesh, decode=decode)
    if colors is not None:
        sources["COLOR_0"] = colors, None
    for name, values in mesh.scalars.items():
        if np.isnan(values).any():
            glb.lost.append(f"NaN in scalars {name} (kept, though glTF forbids it)")
        with np.errstate(over="ignore"):
            rows = values.astype(np.float32)
        sources[f"_{in_utf8(name)}"] = (rows, None) if at_vertices(mesh, name) else _by_value(rows)
    tables, faces = unified(mesh.faces, len(mesh.verts), sources)
    attributes = {name: glb.accessor(rows, extent=name == "POSITION") for name, rows in tables.items()}
    kind = np.uint16 if int(faces.max()) < _RESTART else np.uint32
    return {"attributes": attributes, "indices": glb.accessor(faces.reshape(-1).astype(kind), INDICES)}


def _sources(mesh: Mesh) -> dict[str, Source]:
    """Return normals, tangents and texture coordinates, by their names in the file."""
    normals = vertex_normals(mesh.verts, mesh.faces) if mesh.normals is None else mesh.normals
    sources: dict[str, Source] = {"NORMAL": (_unit(normals, (0.0, 0.0, 1.0)), mesh.normal_faces)}
    if mesh.tangents is not None:
        signs = np.where(mesh.tangents[:, 3:] < 0.0, -1.0, 1.0).astype(np.float32)
        tangents = np.hstack([_unit(mesh.tangents[:, :3], (1.0, 0.0, 0.0)), signs])
        sources["TANGENT"] = tangents, mesh.tangent_faces
    if mesh.uvs is not None:
        for number, uvs in enumerate((mesh.uvs, *mesh.more_uvs)):
            finite = np.clip(np.where(np.isfinite(uvs), uvs, 0.0), -_MAX_UV, _MAX_UV)
            sources[f"TEXCOORD_{number}"] = finite.astype(np.float32), mesh.uv_faces
    return sources


def _colors(glb: Glb, mesh: Mesh, *, decode: bool) -> Floats32 | None:
    """Return the colors of the vertices, (V, 3) or with alpha (V, 4); None for opaque white."""
    texture = mesh.material.texture
    replaced = texture is not None and texture.lookup == "course" and mesh.uvs is not None
    colors: Floats32 | None = None
    if mesh.colors is not None and not replaced:
        clipped = _clamped(glb, mesh.colors)
        colors = (srgb_to_linear(clipped) if decode else clipped).astype(np.float32)
    if mesh.alphas is None:
        return colors
    white = np.ones((len(mesh.verts), 3), np.float32)
    return np.hstack([white if colors is None else colors, mesh.alphas[:, None].astype(np.float32)])


def _clamped(glb: Glb, values: Array) -> Array:
    clamped = np.clip(values, 0.0, 1.0)
    if (clamped != values).any():
        glb.lost.append("colors beyond 0 to 1 (clamped)")
    return clamped


def named(name: str) -> dict[str, str]:
    """Return the name of an object of the file; nothing for an empty one."""
    return {"name": in_utf8(name)} if name else {}


def in_utf8(name: str) -> str:
    """Return a text with escapes for what UTF-8 cannot say, halves of surrogate pairs, which other readers refuse."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def in_float32(parts: list[Array]) -> tuple[Floats, int]:
    """Return the point (3,), and the exponent of a power of two, by which the positions (V, 3) of an object's parts are
    moved and divided to be held in float32.

    Positions that float32 holds stay as they are. Others are taken relative to the middle of their box where that lies
    farther from the origin than from their ends, and scaled where float32 would over- or underflow.
    """
    with np.errstate(over="ignore", under="ignore"):
        exact = all(verts.dtype == np.float32 or (verts.astype(np.float32) == verts).all() for verts in parts)
    if exact:
        return np.zeros(3), 0
    verts = np.concatenate(parts).astype(np.float64)
    low, high = verts.min(axis=0), verts.max(axis=0)
    middle, half = low / 2 + high / 2, float((high / 2 - low / 2).max())
    if any(part.dtype == np.float32 for part in parts) or float(np.abs(middle).max()) <= half:
        middle = np.zeros(3)
    exponent = int(np.frexp(np.abs(verts - middle).max())[1])
    return middle, 0 if exponent in _EXPONENTS else exponent


def unified(faces: Faces, count: int, sources: dict[str, Source]) -> tuple[dict[str, Array], Faces]:
    """Return attributes with one row per vertex of the file, and the faces (F, 3) that index all of them.

    count: of the vertices. Vertices are split only where an attribute differs between the faces around them. They keep
    their order, and those without faces are left out.
    """
    columns: list[Faces] = []
    for _, index in sources.values():
        if index is not None and not any(np.array_equal(index, other) for other in (faces, *columns)):
            columns.append(index)
    if not columns and _used(faces, count).all():
        return {name: rows[:count] for name, (rows, _) in sources.items()}, faces
    key = faces.reshape(-1).astype(np.int64)
    for column in columns:
        key = np.unique(key * (int(column.max()) + 1) + column.reshape(-1), return_inverse=True)[1].reshape(-1)
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    tables = {
        name: rows[(faces if index is None else index).reshape(-1)[first]] for name, (rows, index) in sources.items()
    }
    return tables, vertex.reshape(-1, 3).astype(np.int32)


def _used(faces: Faces, count: int) -> Array:
    """Return which of so many vertices have faces, (count,) bool."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used


def _by_value(values: Array) -> Source:
    """Return the different numbers of scalars per face (F,) or corner (F, 3), and their indices (F, 3)."""
    numbers, index = np.unique(values, return_inverse=True)
    corners = index.reshape(len(values), -1).astype(np.int32)
    return numbers, np.ascontiguousarray(np.broadcast_to(corners, (len(values), 3)))


def _unit(vectors: Array, otherwise: tuple[float, float, float]) -> Floats32:
    """Return vectors (K, 3) at length 1; `otherwise` for those of length 0, which glTF forbids."""
    wide = vectors.astype(np.float64)
    wide[~wide.any(axis=1)] = otherwise
    wide = np.ldexp(wide, -np.frexp(np.abs(wide).max(axis=1, keepdims=True))[1])
    return np.asarray((wide / np.sqrt((wide * wide).sum(axis=1, keepdims=True))).astype(np.float32))
