"""Scenes from glTF 2.0 files, .gltf and .glb.

Own code on NumPy, because trimesh 5.2 loses wrap modes, texture transforms, alpha masks, blending, double-sidedness, vertex
colors next to a texture, cameras and lights, and the order of the file; and it accepts indices out of range and
infinite positions.
"""

from __future__ import annotations

import os
from dataclasses import replace

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted
from ...errors import InputError
from .. import fitting, framing
from ..camera import Camera
from ..model import Light, Mesh, Scene
from .gltf_accessors import open_gltf
from .gltf_animations import Animation, NodeValues, names_of, read_animation
from .gltf_json import Item
from .gltf_lights import lights_of
from .gltf_materials import Materials
from .gltf_meshes import MeshBuilder
from .gltf_nodes import Placed, camera_of, placed
from .options import Options, warn_ignored

# Extensions that are rendered, and those that a renderer may ignore.
RENDERED = (
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
)
# What these hold is drawn from the data beside it, or refused where that is missing.
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_SILENT = ("KHR_xmp_json_ld", "KHR_xmp", *_COMPRESSED)
_IMAGES = ("KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds")  # without which the rest is drawn


def read_gltf(path: Path, options: Options) -> Scene:
    """Read a glTF file, a scene of preset pbr. Every triangle primitive of a mesh becomes a Mesh with all its placements.

    At rest, or at options.time of options.animation. README.md lists what is rendered; other features of the file are in
    Scene.ignored and in one warning. Faces without normals are flat, as glTF specifies, unless options.crease is given.

    Raises InputError, one line that names the file and the field, see clshade.scene.formats.load.load.
    """
    file = GltfFile(path, options)
    if options.time is None and options.animation is None:
        return file.scene({})
    return file.scene(file.animation(options.animation).at(options.time or 0.0))


def animations_and_cameras(path: Path) -> tuple[list[float | None], int]:
    """Return the length of each animation of a glTF file, None of a broken one, and how many cameras it has."""
    document, buffers = open_gltf(path)
    lengths: list[float | None] = []
    for number in range(len(names_of(document))):
        try:
            lengths.append(read_animation(document, buffers, number, []).seconds)
        except InputError:
            lengths.append(None)
    return lengths, document.count("cameras")


class GltfFile:
    """An open glTF file and its scene in any pose. What poses have in common, images above all, is read once."""

    def __init__(self, path: Path, options: Options) -> None:
        self.owner, self.options = shown(path), options
        self.name = os.path.splitext(os.path.basename(os.fspath(path)))[0]
        self.document, self.buffers = open_gltf(path)
        self.ignored = _check_asset(self.document)
        self._materials = Materials(self.document, self.buffers, options.texture, self.ignored)
        self._builder = MeshBuilder(self.document, self.buffers, self._materials, options, self.ignored)

    def animation(self, wanted: str | int | None) -> Animation:
        """Read an animation, see `read_animation`."""
        return read_animation(self.document, self.buffers, wanted, self.ignored)

    def nodes(self, pose: NodeValues) -> Placed:
        """Return what the nodes of the scene place in a pose."""
        return placed(self.document, pose)

    def meshes(self, pose: NodeValues) -> tuple[tuple[Mesh, ...], Placed]:
        """Return the meshes in a pose, and its nodes."""
        nodes = self.nodes(pose)
        meshes = self._builder.meshes(nodes)
        if not meshes:
            found = f"none besides {', '.join(dict.fromkeys(self.ignored))}" if self.ignored else "none"
            raise file_error(self.owner, "meshes", "at least one triangle in the scene", found)
        if self.options.texture is not None and all(mesh.uvs is None for mesh in meshes):
            raise file_error(self.owner, "TEXCOORD_0", "texture coordinates for the texture", "none")
        return meshes, nodes

    def camera(self, nodes: Placed, sphere: tuple[Array, float]) -> Camera | None:
        """Return the file's camera, None if it has none or the options ignore it. sphere: of the meshes."""
        if self.options.fit:
            return None
        return camera_of(self.document, nodes, sphere, self.options.resolution)

    def lights(self, nodes: Placed, sphere: tuple[Array, float], scale: float | None = None) -> tuple[Light, ...]:
        """Return the file's lights, their intensities times `scale`, default: as `lights_of` exposes them."""
        return lights_of(nodes.lights, sphere, self.ignored, scale)[0]

    def scene(self, pose: NodeValues) -> Scene:
        """Return the scene in a pose, and warn of what is not rendered."""
        meshes, nodes = self.meshes(pose)
        return self.framed(meshes, nodes, fitting.bounding_sphere(meshes))

    def framed(self, meshes: tuple[Mesh, ...], nodes: Placed, sphere: tuple[Array, float]) -> Scene:
        """Return the scene of these meshes with camera and lights. sphere: of the meshes."""
        camera = self.camera(nodes, sphere)
        if len(nodes.cameras) > 1 and not self.options.fit:
            self.ignored.append("cameras but the first")
        lights, light_scale = lights_of(nodes.lights, sphere, self.ignored)
        scene = framing.framed(
            meshes,
            self.name,
            self.options.resolution,
            up=self.options.up,
            camera=camera,
            lights=lights,
            sphere=sphere,
        )
        scene = replace(scene, preset="pbr", light_scale=light_scale, animations=names_of(self.document))
        return warn_ignored(scene, self.owner, self.ignored)


def _check_asset(document: Item) -> list[str]:
    """Return the extensions of the file that are not rendered.

    Raises InputError for another version, and for an extension that is required and unknown.
    """
    asset = document.item("asset")
    version = "" if asset is None else asset.text("version")
    if version.split(".")[0] != "2":
        raise document.error("asset.version", "2.0", quoted(version) if version else "none")
    for name in _names(document, "extensionsRequired"):
        if name not in (*RENDERED, *_SILENT, *_IMAGES):
            raise document.error("extensionsRequired", "known ones (" + ", ".join(RENDERED) + ")", quoted(name))
    used = _names(document, "extensionsUsed")
    return [name for name in used if name not in RENDERED and name not in _SILENT]


def _names(document: Item, key: str) -> list[str]:
    names = document.value.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) and name.isprintable() for name in names):
        raise document.error(key, "a list of names", quoted(repr(names)))
    return [name if len(name) <= 64 else name[:64] + "..." for name in names[:64]]
