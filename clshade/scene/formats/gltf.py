"""Scenes from glTF 2.0 files, .gltf and .glb; and their animations played: one scene, and what each frame changes in it.

Own code on NumPy, because trimesh 5.2 loses wrap modes, texture transforms, alpha masks, blending, double-sidedness, vertex
colors next to a texture, cameras and lights, and the order of the file; and it accepts indices out of range and
infinite positions.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, quoted
from ...base.validation import integer, number
from ...errors import InputError
from .. import fitting, framing
from ..camera import Camera
from ..geometry import bounding_box
from ..model import Mesh, Scene
from ..pose import PerFrame, Pose, Poses, changes_of, pose_between
from .gltf_animations import Animation, NodeValues, names_of, read_animation, shortened
from .gltf_data import Item, open_gltf
from .gltf_meshes import MeshBuilder
from .gltf_nodes import Placed, camera_of, lights_of, place_nodes
from .options import FPS, Options, warn_ignored

MAX_FRAMES = 1_000_000
_T = TypeVar("_T")
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
    """
    file = GltfFile(path, options)
    at_rest = options.time is None and options.animation is None
    pose = {} if at_rest else read_animation(file.buffers, options.animation).at(options.time or 0.0)
    meshes, nodes = file.meshes(pose)
    return file.framed(meshes, nodes, fitting.bounding_sphere(meshes))


def animations_and_cameras(path: Path) -> tuple[list[float | None], int]:
    """Return the length of each animation of a glTF file, None of a broken one, and how many cameras it has."""
    buffers = open_gltf(path)
    lengths: list[float | None] = []
    for index in range(len(names_of(buffers.document))):
        try:
            lengths.append(read_animation(buffers, index).seconds)
        except InputError:
            lengths.append(None)
    return lengths, buffers.document.count("cameras")


class GltfFile:
    """An open glTF file and its scene in any pose. What poses have in common, images above all, is read once."""

    def __init__(self, path: Path, options: Options) -> None:
        self.owner, self.options = shown(path), options
        self.name = os.path.splitext(os.path.basename(os.fspath(path)))[0]
        self.buffers = open_gltf(path)
        self.document, self.ignored = self.buffers.document, self.buffers.ignored
        self.ignored += _check_asset(self.document)
        self._builder = MeshBuilder(self.buffers, options)

    def meshes(self, pose: NodeValues) -> tuple[tuple[Mesh, ...], Placed]:
        """Return the meshes in a pose, and what its nodes place."""
        nodes = place_nodes(self.document, pose)
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

    def framed(self, meshes: tuple[Mesh, ...], nodes: Placed, sphere: tuple[Array, float]) -> Scene:
        """Return the scene of these meshes with camera and lights, and warn of what is not rendered. sphere: of the
        meshes."""
        camera = self.camera(nodes, sphere)
        if len(nodes.cameras) > 1 and not self.options.fit:
            self.ignored.append("cameras but the first")
        lights, light_scale = lights_of(nodes.lights, sphere, self.ignored)
        resolution, up = self.options.resolution, self.options.up
        scene = framing.framed(meshes, self.name, resolution, up=up, camera=camera, lights=lights, sphere=sphere)
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
    return [name for name in _names(document, "extensionsUsed") if name not in (*RENDERED, *_SILENT)]


def _names(document: Item, key: str) -> list[str]:
    names = document.value.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) and name.isprintable() for name in names):
        raise document.error(key, "a list of names", quoted(repr(names)))
    return [shortened(name) for name in names[:64]]


@dataclass(frozen=True, eq=False)
class Played:
    """An animation of a file, as frames 1, 2, ...

    Attributes
    ----------
    scene : Scene
        Its first frame. A camera and lights that the file lacks are chosen for all frames.
    name : str
        Name of the animation, "animation 0" and so on without one.
    seconds : float
        Its length.
    times : tuple of float
        Time of each frame, seconds: evenly spaced over the length, without its end, so that a film of
        them loops.
    poses : mapping of int to Pose
        What each frame changes in `scene`, by frame number; computed when looked up.
    cameras : mapping of int to Camera
        Camera of each frame: the file's, which may move, or `scene.camera`.
    stage : Scene
        `scene` with one mesh more, last, of the boxes that its moving meshes fill in all frames: for
        what is chosen to show everything. Computed when looked up, if the file has a camera and
        lights: that takes all poses.
    """

    scene: Scene
    name: str
    seconds: float
    times: tuple[float, ...]
    poses: Poses
    cameras: Mapping[int, Camera]
    _extent: Callable[[], tuple[Mesh, ...]] = field(repr=False)

    @functools.cached_property
    def stage(self) -> Scene:
        return replace(self.scene, meshes=(*self.scene.meshes, *self._extent()))


def play(path: Path, options: Options, *, count: int | None = None, fps: float = FPS) -> Played:
    """Return the frames of options.animation, `count` of them or `fps` for each second. See `load.load_animation`."""
    file = GltfFile(path, options)
    animation = read_animation(file.buffers, options.animation)
    if count is None:
        count = max(1, round(min(animation.seconds * number("load_animation", "fps", fps, above=0.0), MAX_FRAMES + 1)))
        if count > MAX_FRAMES:
            raise InputError(
                f"load_animation: fps: expected at most {MAX_FRAMES} frames, found {animation.seconds:g} s of {fps:g}"
            )
    count = integer("load_animation", "count", count, 1, MAX_FRAMES)
    times = tuple(animation.seconds * k / count for k in range(count))
    meshes, nodes = file.meshes(animation.at(times[0]))
    extent = functools.cache(lambda: _extent(file, animation, times, meshes))
    sphere = fitting.bounding_sphere(meshes)
    chosen = file.camera(nodes, sphere) is None or not lights_of(nodes.lights, sphere, file.ignored)[0]
    stage_meshes = (*meshes, *extent()) if chosen else meshes
    sphere = fitting.bounding_sphere(stage_meshes) if chosen else sphere
    scene = replace(file.framed(stage_meshes, nodes, sphere), meshes=meshes)

    def pose(frame: int) -> Pose:
        posed, nodes = file.meshes(animation.at(times[frame - 1]))
        scale = scene.light_scale
        lights = lights_of(nodes.lights, sphere, file.ignored, scale)[0] if scene.own_lights else None
        return pose_between(meshes, posed, lights)

    def camera(frame: int) -> Camera:
        at = animation.at(times[frame - 1])
        moved = None if scene.fitted else file.camera(place_nodes(file.document, at), sphere)
        return moved or scene.camera

    frames = range(1, count + 1)
    poses = Poses(frames, pose, lambda: (file.buffers.digest(), options, animation.name, times))
    return Played(scene, animation.name, animation.seconds, times, poses, PerFrame(frames, camera), extent)


def _extent(
    file: GltfFile, animation: Animation, times: tuple[float, ...], meshes: tuple[Mesh, ...]
) -> tuple[Mesh, ...]:
    """Return a mesh whose vertices are the corners of the boxes that the moving meshes fill; nothing if none moves."""
    boxes: dict[int, tuple[Floats, Floats]] = {}
    for time in times[1:]:
        for index, (mesh, posed) in enumerate(zip(meshes, file.meshes(animation.at(time))[0], strict=True)):
            if changes_of(mesh, posed):
                view = Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0))
                low, high = bounding_box(Scene((posed,), view))
                lows, highs = boxes.get(index, (low, high))
                boxes[index] = np.minimum(lows, low), np.maximum(highs, high)
    if not boxes:
        return ()
    ends = np.array(list(boxes.values()))  # (K, 2, 3)
    corners = np.stack([ends[:, [x, y, z], [0, 1, 2]] for x, y, z in np.ndindex(2, 2, 2)], axis=1).reshape(-1, 3)
    faces = np.repeat(np.arange(len(corners), dtype=np.int32)[:, None], 3, axis=1)
    return (Mesh(corners, faces, name="extent of the animation"),)
