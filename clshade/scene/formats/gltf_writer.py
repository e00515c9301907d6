"""Writing scenes as binary glTF 2.0 files, .glb."""

from __future__ import annotations

import io
import json
import math
import os
import struct
import warnings
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np

from ...base import atomic_files, validation
from ...base.arrays import Array, Faces, Floats, Floats32
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error
from ...images import png
from ...images.decode import srgb_to_linear
from ...images.tonemap import srgb_curve
from ..contents import object_numbers
from ..framing import bounding_sphere
from ..geometry import camera_axes, normalized, vertex_normals
from ..lights import PlacedLight
from ..material import COMPONENTS, is_unlit
from ..model import Light, Material, Mesh, MetallicRoughness, Scene, Texture
from ..scalar_colors import at_vertices
from ..texture import Wrap

ENDING = ".glb"
MAX_BYTES = (1 << 32) - 1  # of a GLB file, whose lengths have 32 bits
_OWNER = "to_glb"
_VERTICES, _INDICES = 34962, 34963  # targets of buffer views
_COMPONENTS = {"uint16": 5123, "uint32": 5125, "float32": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_WRAPS: dict[Wrap, int] = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_FILTERS = {"nearest": 9728, "linear": 9729}
_PNG_LEVEL = 6  # of zlib
_MAX_UV = 2.0**40  # as Mesh.uvs says
_RESTART = 65535  # as an index of 16 bits restarts strips
_EXPONENTS = range(-60, 61)  # of the largest coordinate: others are scaled by a power of two
_SQUARE = 1e-6  # cosine between the axes of a matrix that is a rotation and a scale
_MAX_NUMBER = 1e300  # of a number in the file: readers refuse larger ones
_MIN_CONE = 1e-6  # radians, of a cone
_CAMERA = ("eye", "lookat", "up", "plane", "resolution", "principal", "focal")  # its fields
_IN_GLTF = ("kind", "position", "direction", "intensity", "inner_cone", "outer_cone", "range")  # fields of lights
# Rows of an attribute, and their indices (F, 3); None: those of vertices.
Source: TypeAlias = tuple[Array, Faces | None]
Json: TypeAlias = dict[str, Any]


def write_glb(scene: Scene, path: Path) -> None:
    """Write a scene as a binary glTF 2.0 file, see `Scene.to_glb`."""
    validation.path(_OWNER, "path", path)
    if os.path.splitext(path)[1].lower() != ENDING:
        raise file_error(_OWNER, "path", f"a name ending in {ENDING}", shown(path))
    atomic_files.check(path)
    writer = _SceneWriter(scene)
    writer.write(path)
    if writer.lost:
        line = f"{shown(path)}: not in the file as in the scene: {', '.join(dict.fromkeys(writer.lost))}"
        warnings.warn(line if line.isprintable() else ascii(line), stacklevel=3)


class Glb:
    """Lists of JSON objects by name, and one binary chunk. lost: what the file does not say of a scene, in a few words."""

    def __init__(self) -> None:
        self.lost: list[str] = []
        self.lists: dict[str, list[Json]] = {}
        self.extensions: dict[str, Json] = {}
        self.used: set[str] = set()
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, kind: str, entry: Json, *, shared: bool = False) -> int:
        """Append an object to a list such as `meshes`, unless an equal one is there and `shared`; return its index."""
        entries = self.lists.setdefault(kind, [])
        if shared and entry in entries:
            return entries.index(entry)
        entries.append(entry)
        return len(entries) - 1

    def use(self, extension: str, entry: Json) -> Json:
        """Note that the file uses an extension; return the `extensions` of an object, {extension: entry}."""
        self.used.add(extension)
        return {extension: entry}

    def view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes, from a multiple of four on, and return the index of their buffer view."""
        padding = bytes(-self._length % 4)
        start = self._length + len(padding)
        self._parts += [padding, data]
        self._length = start + len(data)
        entry = {"buffer": 0, "byteOffset": start, "byteLength": len(data)}
        return self.add("bufferViews", entry if target is None else {**entry, "target": target})

    def accessor(self, values: Array, target: int = _VERTICES, *, extent: bool = False) -> int:
        """Append an array, (K,) or (K, 2 to 4), of uint16, uint32 or float32. extent: with the minimum and maximum of each
        column, which positions need."""
        columns = values.reshape(len(values), -1)
        little = np.ascontiguousarray(columns, columns.dtype.newbyteorder("<"))
        component, kind = _COMPONENTS[values.dtype.name], _TYPES[columns.shape[1]]
        view = self.view(little.tobytes(), target)
        entry: Json = {"bufferView": view, "componentType": component, "count": len(values), "type": kind}
        if extent:
            entry |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def write(self, path: Path) -> None:
        """Write the file atomically. Raises InputError for one of 4 GiB or more and for numbers beyond float64, OutputError
        if it cannot be written."""
        document: Json = {"asset": {"version": "2.0", "generator": "clshade"}}
        if self.used:
            document["extensionsUsed"] = sorted(self.used)
        if self.extensions:
            document["extensions"] = self.extensions
        document |= {"scene": 0, **self.lists}
        length = self._length + -self._length % 4
        if length:
            document["buffers"] = [{"byteLength": length}]
        try:
            text = json.dumps(document, allow_nan=False, separators=(",", ":")).encode("ascii")
        except ValueError:
            raise file_error(_OWNER, "scene", "materials and lights within the range of float64", "others") from None
        text += b" " * (-len(text) % 4)
        size = 12 + 8 + len(text) + (8 + length if length else 0)
        if size > MAX_BYTES:
            raise file_error(_OWNER, "scene", f"a file of at most {MAX_BYTES} bytes", f"{size} bytes")
        with atomic_files.replacing(path) as file:
            file.write(struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON") + text)
            if length:
                file.write(struct.pack("<I4s", length, b"BIN\0"))
                file.writelines((*self._parts, bytes(length - self._length)))


class _SceneWriter(Glb):
    """A scene as a glTF file. Equal materials, images and samplers are written once.

    decode: whether colors and texels are sRGB codes, in scenes whose image is shown without a curve. sphere: center and
    radius of the meshes.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.scene, self.decode = scene, scene.preset == "course"
        self._images: dict[bytes, int] = {}
        self._textures: dict[tuple[int, str], tuple[int, float]] = {}
        self._materials: dict[str, int] = {}
        if scene.environment is not None:
            self.lost.append("the environment (none)")
        nodes = self._add_meshes()
        self.sphere = bounding_sphere(scene.meshes)
        nodes += [self._add_camera(), *(self._add_lights() if scene.lights and scene.own_lights else ())]
        background = None if scene.background is None else np.asarray(scene.background).tolist()
        unsaid = {"preset": scene.preset, "ambient": np.asarray(scene.ambient).tolist(), "background": background}
        self.add("scenes", {**_named(scene.name), "nodes": nodes, "extras": {"clshade": unsaid}})

    def _add_meshes(self) -> list[int]:
        """Add the meshes that have triangles and placements; return the indices of their nodes."""
        objects: dict[int, list[Mesh]] = {}
        for number, mesh in zip(object_numbers(self.scene), self.scene.meshes, strict=True):
            objects.setdefault(number, []).append(mesh)
        with np.errstate(over="ignore", invalid="ignore"):
            return [node for parts in objects.values() for node in self._add_object(parts)]

    def _add_object(self, parts: list[Mesh]) -> Iterator[int]:
        """Add an object, whose parts become primitives of one mesh where they have the same placements."""
        middle, exponent = float32_frame([mesh.verts[_used(mesh.faces, len(mesh.verts))] for mesh in parts])
        matrix = np.diag([*[np.ldexp(1.0, exponent)] * 3, 1.0])
        matrix[:3, 3] = middle
        instance_names = next((mesh.instance_names for mesh in parts if mesh.instance_names), ())
        written: dict[bytes, Json] = {}  # by placements
        for mesh in parts:
            placements = np.asarray(mesh.instances)
            if not len(mesh.faces) or not len(placements):
                continue
            material = self._material(mesh.material, 0 if mesh.uvs is None else 1 + len(mesh.more_uvs))
            primitive = {**self._primitive(mesh, middle, exponent), "material": material}
            if (key := placements.tobytes()) in written:
                written[key]["primitives"].append(primitive)
                continue
            written[key] = {**_named(mesh.name), "primitives": [primitive]}
            index, names = self.add("meshes", written[key]), instance_names or (mesh.name,) * len(placements)
            for placement, name in zip(placements, names, strict=True):
                yield self._add_placement(placement @ matrix, {"mesh": index, **_named(name)})

    def _add_placement(self, matrix: Floats, content: Json) -> int:
        """Add a node, in two steps where its matrix shears, which nodes may not; return the index of the outer one."""
        placed = self._placed(content, matrix, "meshes")
        linear = matrix[:3, :3]
        columns = linear / (np.abs(linear).max() or 1.0)
        lengths = np.sqrt((columns * columns).sum(axis=0))
        cosines = np.abs(columns.T @ columns) - np.diag(lengths * lengths)
        if (cosines <= _SQUARE * np.outer(lengths, lengths)).all():
            return self.add("nodes", placed)
        left, sizes, right = np.linalg.svd(linear)
        outer, inner = matrix.copy(), np.eye(4)
        outer[:3, :3], inner[:3, :3] = left * sizes, right
        child = self.add("nodes", self._placed(content, inner, "meshes"))
        return self.add("nodes", self._placed({"children": [child]}, outer, "meshes"))

    def _placed(self, node: Json, matrix: Floats, field: str) -> Json:
        """Return a node with its placement, as short as it can be said exactly. Raises InputError, naming the scene's field,
        for one beyond what readers take."""
        if not (np.isfinite(matrix).all() and np.abs(matrix).max() <= _MAX_NUMBER):
            raise validation.value_error(_OWNER, field, f"placements within {_MAX_NUMBER:g}", matrix.tolist())
        if (matrix[:3, :3] != np.eye(3)).any():
            return {**node, "matrix": (matrix.T.reshape(-1) + 0.0).tolist()}
        return {**node, "translation": (matrix[:3, 3] + 0.0).tolist()} if matrix[:3, 3].any() else node

    def _add_camera(self) -> int:
        """Add the camera, whose near and far plane enclose the meshes; return the index of its node."""
        camera, (center, radius) = self.scene.camera, self.sphere
        (height, width), (right, up, forward) = camera.plane, camera_axes(camera)
        if camera.principal != (0.5, 0.5):
            self.lost.append("the camera's principal point (the middle of the image)")
        depth = float((center - camera.eye) @ forward)
        facts = {name: np.asarray(getattr(camera, name)).tolist() for name in _CAMERA}
        if camera.orthographic:
            kind, near = "orthographic", max(depth - 1.5 * radius, 0.0)
            lens = {"xmag": width / 2.0, "ymag": height / 2.0, "znear": near, "zfar": max(depth, 0.0) + 2.0 * radius}
        else:
            kind, near = "perspective", max(0.5 * (depth - radius), 1e-3 * radius)
            fov, aspect = 2.0 * math.atan(height / camera.focal / 2.0), width / height
            if not (0.0 < fov < math.pi and 0.0 < aspect <= _MAX_NUMBER):
                expected = "angles of view above 0 and below 180 degrees"
                raise validation.value_error(_OWNER, "camera", expected, camera.plane)
            lens = {"yfov": fov, "aspectRatio": aspect, "znear": near}
        entry = {"type": kind, kind: lens, "extras": {"clshade": facts}}
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.stack([right, up, -forward], axis=1), camera.eye
        node = {"name": "camera", "camera": self.add("cameras", entry)}
        return self.add("nodes", self._placed(node, matrix, "camera"))

    def _add_lights(self) -> list[int]:
        nodes: list[int] = []
        entries = self.extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        for number, light in enumerate(self.scene.lights):
            entry, matrix = self._light(light)
            entries.append(entry)
            node = {"name": f"light {number}", "extensions": self.use("KHR_lights_punctual", {"light": number})}
            nodes.append(self.add("nodes", self._placed(node, matrix, "lights")))
        return nodes

    def _light(self, light: Light) -> tuple[Json, Floats]:
        """Return a light of the file and its (4, 4) matrix in the world."""
        intensity = np.maximum(light.intensity, 0.0)
        if (light.intensity < 0.0).any():
            self.lost.append("negative light (none)")
        strength = float(intensity.max())
        color = (intensity / strength).tolist() if strength else [1.0, 1.0, 1.0]
        strength /= self.scene.light_scale
        entry: Json = {"type": light.gltf, "color": color, "intensity": strength}
        matrix = np.eye(4)
        if light.axis is not None:  # a rotation that turns -z into it
            back = -np.asarray(light.axis)
            right = np.cross(np.eye(3)[int(np.argmin(np.abs(back)))], back)
            right /= np.linalg.norm(right)
            matrix[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        if not isinstance(light, PlacedLight):
            return entry, matrix
        if light.gltf_loss:
            self.lost.append(light.gltf_loss)
        if not light.attenuates:  # as bright at the center of the meshes
            distance = max(math.dist(light.position, self.sphere[0]), self.sphere[1])
            entry["intensity"] = min(strength * distance * distance, _MAX_NUMBER)
        if light.range is not None:
            entry["range"] = light.range
        if light.gltf == "spot":
            angles = np.radians(light.cone or (0.0, 90.0)).tolist()
            outer = max(min(angles[1], math.pi / 2), _MIN_CONE)
            entry["spot"] = {"innerConeAngle": min(angles[0], outer * (1.0 - _MIN_CONE)), "outerConeAngle": outer}
        matrix[:3, 3] = light.position
        unsaid = {name: value for name, value in light.facts().items() if name not in _IN_GLTF}
        return {**entry, "extras": {"clshade": unsaid}}, matrix

    def _material(self, material: Material, sets: int) -> int:
        """Return the index of a material, for a mesh with so many sets of texture coordinates."""
        unlit = is_unlit(material) and bool(material.ka.any())
        facets = material.microfacets
        ambient = np.asarray(self.scene.ambient)  # by which unlit materials show their color
        color = np.asarray(material.color) * (material.ka * ambient if unlit else material.diffuse)
        metallic, roughness = (0.0, 1.0) if unlit else (facets.metallic, facets.roughness)
        reflection: Json = {"metallicFactor": metallic, "roughnessFactor": roughness}
        entry: Json = {**_named(material.name), "pbrMetallicRoughness": reflection}
        if material.blend:
            entry["alphaMode"] = "BLEND"
            if material.alpha_cutoff is not None:
                self.lost.append("alpha tests of materials that blend")
        elif material.alpha_cutoff is not None:
            entry |= {"alphaMode": "MASK", "alphaCutoff": max(material.alpha_cutoff, 0.0)}
        if material.sides == "both":
            entry["doubleSided"] = True
        color = color * self._put(reflection, "baseColorTexture", material.texture, sets, "color")
        opacity = material.opacity if material.blend or material.alpha_cutoff is not None else 1.0
        reflection["baseColorFactor"] = [*self._clamped(color).tolist(), opacity]
        self._put(reflection, "metallicRoughnessTexture", facets.metallic_roughness_texture, sets, "numbers")
        extensions = self.use("KHR_materials_unlit", {}) if unlit else self._maps(entry, facets, sets)
        if extensions:
            entry["extensions"] = extensions
        # What glTF cannot say of a material.
        phong: Json = {name: np.asarray(getattr(material, name)).tolist() for name in COMPONENTS.values()}
        phong |= {"n": material.n, "color": np.asarray(material.color).tolist(), "two_sided": material.two_sided}
        entry["extras"] = {"clshade": phong}
        text = json.dumps(entry)
        if text not in self._materials:
            self._materials[text] = self.add("materials", entry)
        return self._materials[text]

    def _maps(self, entry: Json, facets: MetallicRoughness, sets: int) -> Json:
        """Add maps and emission to a material; return its extensions."""
        normal, occlusion = facets.normal_texture, facets.occlusion_texture
        self._put(entry, "normalTexture", normal, sets, "numbers", scale=facets.normal_scale)
        self._put(entry, "occlusionTexture", occlusion, sets, "numbers", strength=facets.occlusion_strength)
        extensions: Json = {}
        scale = self._put(entry, "emissiveTexture", facets.emission_texture, sets, "color")
        emission = np.asarray(facets.emission) * scale
        strength = max(float(emission.max()), 1.0)
        if emission.any():
            entry["emissiveFactor"] = (emission / strength).tolist()
        if strength > 1.0:
            extensions |= self.use("KHR_materials_emissive_strength", {"emissiveStrength": strength})
        if facets.ior != 1.5:
            extensions |= self.use("KHR_materials_ior", {"ior": facets.ior})
        color = np.asarray(facets.specular_color)
        if facets.specular != 1.0 or (color != 1.0).any():
            dielectric = {"specularFactor": facets.specular, "specularColorFactor": color.tolist()}
            extensions |= self.use("KHR_materials_specular", dielectric)
        return extensions

    def _put(self, entry: Json, name: str, texture: Texture | None, sets: int, kind: str, **fields: float) -> float:
        """Add a texture to an object, if there is one and the mesh has its coordinates; return the factor of its texels."""
        if texture is None or texture.coordinates >= sets:
            return 1.0
        index, factor = self._texture(texture, kind)
        info: Json = {"index": index}
        if texture.coordinates:
            info["texCoord"] = texture.coordinates
        info |= {key: value for key, value in fields.items() if value != 1.0}
        if texture.lookup == "course":  # u (w-1) + 0.5 texels from the left edge
            height, width = texture.image.shape[:2]
            sizes = np.array([width, height], np.float64)
            transform = {"offset": (0.5 / sizes).tolist(), "scale": ((sizes - 1.0) / sizes).tolist()}
            info["extensions"] = self.use("KHR_texture_transform", transform)
        entry[name] = info
        return factor

    def _texture(self, texture: Texture, kind: str) -> tuple[int, float]:
        """Return the index of a texture, and the factor of its texels. kind: color or numbers."""
        key = id(texture), kind
        if key not in self._textures:
            is_linear = kind == "color" and not self.decode
            image = texture.image.astype(np.float64)
            factor = max(float(image[..., :3].max()), 1.0) if is_linear else 1.0
            image[..., :3] /= factor
            image = self._clamped(image)
            if is_linear:
                image[..., :3] = srgb_curve(image[..., :3])
            file = io.BytesIO()
            png.encode(file, np.rint(image * 255.0).astype(np.uint8), _PNG_LEVEL)
            data = file.getvalue()
            if data not in self._images:
                view = {"bufferView": self.view(data), "mimeType": "image/png"}
                self._images[data] = self.add("images", {**_named(texture.name), **view})
            wraps: Any = ("clamp", "clamp") if texture.lookup == "course" else texture.wrap
            sampler = {"magFilter": _FILTERS[texture.filter], "wrapS": _WRAPS[wraps[0]], "wrapT": _WRAPS[wraps[1]]}
            entry = {"sampler": self.add("samplers", sampler, shared=True), "source": self._images[data]}
            self._textures[key] = self.add("textures", {**_named(texture.name), **entry}, shared=True), factor
        return self._textures[key]

    def _clamped(self, values: Array) -> Array:
        clamped = np.clip(values, 0.0, 1.0)
        if (clamped != values).any():
            self.lost.append("colors beyond 0 to 1 (clamped)")
        return clamped

    def _primitive(self, mesh: Mesh, middle: Floats, exponent: int) -> Json:
        """Write a mesh with triangles; return a primitive without material. middle, exponent: its `float32_frame`."""
        used = _used(mesh.faces, len(mesh.verts))
        verts = mesh.verts if used.all() else np.where(used[:, None], mesh.verts, mesh.verts[mesh.faces[0, 0]])
        positions = verts if verts.dtype == np.float32 else np.ldexp(verts - middle, -exponent).astype(np.float32)
        sources = {"POSITION": (positions, None), **_directions_and_uvs(mesh)}
        texture, colors = mesh.material.texture, mesh.colors
        if texture is not None and texture.lookup == "course" and mesh.uvs is not None:
            colors = None  # the texels replace them
        if colors is not None:
            colors = self._clamped(colors)
            colors = (srgb_to_linear(colors) if self.decode else colors).astype(np.float32)
        if mesh.alphas is not None:
            white = np.ones((len(mesh.verts), 3), np.float32)
            colors = np.hstack([white if colors is None else colors, mesh.alphas[:, None].astype(np.float32)])
        if colors is not None:
            sources["COLOR_0"] = colors, None
        for name, values in mesh.scalars.items():
            if np.isnan(values).any():
                self.lost.append(f"NaN in scalars {name} (kept, though glTF forbids it)")
            with np.errstate(over="ignore"):
                rows = values.astype(np.float32)
            indices = None
            if not at_vertices(mesh, name):  # per face (F,) or corner (F, 3)
                rows, index = np.unique(rows, return_inverse=True)
                corners = index.reshape(len(values), -1).astype(np.int32)
                indices = np.ascontiguousarray(np.broadcast_to(corners, (len(values), 3)))
            sources[f"_{_in_utf8(name)}"] = rows, indices
        tables, faces = unify_vertices(mesh.faces, len(mesh.verts), sources)
        attributes = {name: self.accessor(rows, extent=name == "POSITION") for name, rows in tables.items()}
        kind = np.uint16 if int(faces.max()) < _RESTART else np.uint32
        return {"attributes": attributes, "indices": self.accessor(faces.reshape(-1).astype(kind), _INDICES)}


def _directions_and_uvs(mesh: Mesh) -> dict[str, Source]:
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


def _named(name: str) -> dict[str, str]:
    """Return the name of an object of the file; nothing for an empty one."""
    return {"name": _in_utf8(name)} if name else {}


def _in_utf8(name: str) -> str:
    """Return a text with escapes for what UTF-8 cannot say, halves of surrogate pairs, which other readers refuse."""
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def float32_frame(parts: list[Array]) -> tuple[Floats, int]:
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


def unify_vertices(faces: Faces, count: int, sources: dict[str, Source]) -> tuple[dict[str, Array], Faces]:
    """Return attributes with one row per vertex of the file, and the faces (F, 3) that index all of them.

    count: of the vertices. Vertices are split only where an attribute differs between the faces around them. They keep
    their order, and those without faces are left out.
    """
    columns: list[Faces] = []
    for _, index in sources.values():
        if index is not None and not any(np.array_equal(index, column) for column in (faces, *columns)):
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


def _unit(vectors: Array, otherwise: tuple[float, float, float]) -> Floats32:
    """Return vectors (K, 3) at length 1; `otherwise` for those of length 0, which glTF forbids."""
    nonzero = vectors.any(axis=1, keepdims=True)
    return normalized(np.where(nonzero, vectors, otherwise).astype(np.float64)).astype(np.float32)
