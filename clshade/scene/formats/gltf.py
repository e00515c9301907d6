"""Scenes from glTF 2.0 files, .gltf and .glb; and their animations played: one scene, and what each frame changes in it.

Own code on NumPy, because trimesh 5.2 loses wrap modes, texture transforms, alpha masks, blending, double-sidedness, vertex
colors next to a texture, cameras and lights, and the order of the file; and it accepts indices out of range and
infinite positions.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import Path
from ...base.input_files import quoted
from ...base.spelling import hint
from ...base.validation import integer, number
from ...errors import InputError
from .. import framing
from ..camera import Camera
from ..geometry import bounding_box
from ..model import Mesh, Scene
from ..pose import PerFrame, Pose, Poses, changes_of, pose_between
from .gltf_data import Item, open_gltf
from .gltf_meshes import MeshBuilder
from .gltf_nodes import NodeValues, Placed, camera_of, lights_of, place_nodes, target_count
from .reading import FPS, Options, framed

MAX_FRAMES = 1_000_000
_OF_MATERIALS = (
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_unlit",
)
RENDERED = ("KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", *_OF_MATERIALS)
# What these hold is drawn from the data beside it, or refused where that is missing.
_COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_SILENT = ("KHR_xmp_json_ld", "KHR_xmp", *_COMPRESSED)
_IMAGES = ("KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds")  # without which the rest is drawn
_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": 0}  # of a value; weights: one for each morph target
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
ALL = "all"  # in place of an animation: some exporters write one for each node
_POINTER = "KHR_animation_pointer"


def read_gltf(path: Path, options: Options) -> Scene:
    """Read a glTF file, a scene of preset pbr. Every triangle primitive of a mesh becomes a Mesh with all its placements.

    At rest, or at options.time of options.animation. README.md lists what is rendered; other features of the file are in
    Scene.ignored and in one warning. Faces without normals are flat, as glTF specifies, unless options.crease is given.
    """
    file = GltfFile(path, options)
    at_rest = options.time is None and options.animation is None
    pose = {} if at_rest else read_animation(file.document, options.animation).at(options.time or 0.0)
    meshes, nodes = file.meshes(pose)
    return file.framed(meshes, nodes, framing.bounding_sphere(meshes))


def animations_and_cameras(path: Path) -> tuple[list[float | None], int]:
    """Return the length of each animation of a glTF file, None of a broken one, and how many cameras it has."""
    document = open_gltf(path).document
    lengths: list[float | None] = [None] * len(names_of(document))
    for index in range(len(lengths)):
        with contextlib.suppress(InputError):
            lengths[index] = _animation(document, index).seconds
    return lengths, document.count("cameras")


class GltfFile:
    """An open glTF file and its scene in any pose. What poses have in common, images above all, is read once."""

    def __init__(self, path: Path, options: Options) -> None:
        self.data, self.options = open_gltf(path), options
        self.document, self.ignored = self.data.document, self.data.ignored
        self.ignored += _check_asset(self.document)
        self._builder = MeshBuilder(self.data, options)

    def meshes(self, pose: NodeValues) -> tuple[tuple[Mesh, ...], Placed]:
        """Return the meshes in a pose, and what its nodes place."""
        nodes = place_nodes(self.document, pose)
        meshes = self._builder.meshes(nodes)
        if not meshes:
            content = f"none besides {', '.join(dict.fromkeys(self.ignored))}" if self.ignored else "none"
            raise self.document.error("meshes", "at least one triangle in the scene", content)
        if self.options.texture is not None and all(mesh.uvs is None for mesh in meshes):
            raise self.document.error("TEXCOORD_0", "texture coordinates for the texture", "none")
        return meshes, nodes

    def camera(self, nodes: Placed, sphere: tuple[Array, float]) -> Camera | None:
        """Return the file's camera, None if it has none or the options ignore it. sphere: of the meshes."""
        if self.options.fit:
            return None
        return camera_of(self.document, nodes, sphere, self.options.resolution)

    def framed(self, meshes: tuple[Mesh, ...], nodes: Placed, sphere: tuple[Array, float]) -> Scene:
        """Return the scene of these meshes with camera and lights, and warn of what is not rendered."""
        camera = self.camera(nodes, sphere)
        if len(nodes.cameras) > 1 and not self.options.fit:
            self.ignored.append("cameras but the first")
        lights, light_scale = lights_of(nodes.lights, sphere)
        fields = {"camera": camera, "lights": lights, "sphere": sphere}
        scene = framed(meshes, self.data.path, self.options, self.ignored, **fields)
        return replace(scene, preset="pbr", light_scale=light_scale, animations=names_of(self.document))


def _check_asset(document: Item) -> list[str]:
    """Return the extensions of the file that are not rendered.

    Raises InputError for another version, and for an extension that is required and unknown.
    """
    version = document.part("asset").text("version")
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
    return [shorten(name) for name in names[:64]]


@dataclass(frozen=True, eq=False)
class Played:
    """An animation of a file, as frames 1, 2, ...

    scene: the first frame. A camera and lights that the file lacks are chosen for all frames.
    name: of the animation, "animation 0" and so on without one.
    seconds: its length. times: of each frame, evenly spaced over the length, without its end, so that a film loops.
    poses: what each frame changes in `scene`, by frame number; computed when looked up.
    cameras: of each frame, by number: the file's, which may move, or `scene.camera`.
    stage: `scene` with one mesh more, last, of the boxes that its moving meshes fill in all frames, for what is chosen to
        show everything. Computed when looked up, if the file has a camera and lights: that takes all poses.
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
    animation = read_animation(file.document, options.animation)
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
    sphere = framing.bounding_sphere(meshes)
    chosen = file.camera(nodes, sphere) is None or not lights_of(nodes.lights, sphere)[0]
    stage_meshes = (*meshes, *extent()) if chosen else meshes
    sphere = framing.bounding_sphere(stage_meshes) if chosen else sphere
    scene = replace(file.framed(stage_meshes, nodes, sphere), meshes=meshes)

    def pose(frame: int) -> Pose:
        posed, nodes = file.meshes(animation.at(times[frame - 1]))
        lights = lights_of(nodes.lights, sphere, scene.light_scale)[0] if scene.own_lights else None
        return pose_between(meshes, posed, lights)

    def camera(frame: int) -> Camera:
        if scene.fitted:
            return scene.camera
        return file.camera(place_nodes(file.document, animation.at(times[frame - 1])), sphere) or scene.camera

    frames = range(1, count + 1)
    poses = Poses(frames, pose, lambda: (file.data.digest(), options, animation.name, times))
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


# Animations: the properties of nodes at a time (glTF 2.0, section 3.11 and appendix C)


@dataclass(frozen=True, eq=False)
class Channel:
    """A property of a node over time.

    times: (n,), seconds, increasing. values: (n, width); quaternions have length 1, but for those of CUBICSPLINE, which
    are the file's. tangents: (n, 2, width) of CUBICSPLINE, arriving at and leaving each value, per second; else None.
    """

    node: int
    path: str
    interpolation: str
    times: Floats
    values: Floats
    tangents: Floats | None

    def at(self, time: float) -> Floats:
        """Return the value (width,) at a time in seconds; before the first and after the last it is theirs."""
        k = int(np.searchsorted(self.times, time, "right")) - 1
        if k < 0 or k >= len(self.times) - 1 or self.interpolation == "STEP":
            return np.asarray(self.values[max(k, 0)])
        step = float(self.times[k + 1] - self.times[k])
        t, before, after = (time - float(self.times[k])) / step, self.values[k], self.values[k + 1]
        if self.tangents is not None:
            value = hermite(t, before, after, step * self.tangents[k, 1], step * self.tangents[k + 1, 0])
            return unit(value) if self.path == "rotation" else value
        if self.path == "rotation":
            return slerp(t, before, after)
        return np.asarray((1.0 - t) * before + t * after)


@dataclass(frozen=True, eq=False)
class Animation:
    """An animation of a file. seconds: the last time of its channels."""

    name: str
    seconds: float
    channels: tuple[Channel, ...]

    def at(self, time: float) -> NodeValues:
        with np.errstate(over="ignore"):
            time = float(np.float32(time))  # as the file's times are: a step at 0.1 s has begun at 0.1
        pose: NodeValues = {}
        for channel in self.channels:
            pose.setdefault(channel.node, {})[channel.path] = channel.at(time)
        return pose


def hermite(t: float, before: Floats, after: Floats, leaving: Floats, arriving: Floats) -> Floats:
    """Return the cubic Hermite spline at t from 0 to 1; tangents are per interval."""
    t2, t3 = t * t, t * t * t
    return (
        (2.0 * t3 - 3.0 * t2 + 1.0) * before
        + (t3 - 2.0 * t2 + t) * leaving
        + (3.0 * t2 - 2.0 * t3) * after
        + (t3 - t2) * arriving
    )


def slerp(t: float, before: Floats, after: Floats) -> Floats:
    """Interpolate unit quaternions, at constant speed, on the shorter of the two arcs (glTF 2.0, appendix C.4)."""
    cosine = float(before @ after)
    after = after if cosine >= 0.0 else -after
    # From the half chords: near 0, where arccos(cosine) would lose half of the digits, this angle keeps them.
    angle = 2.0 * math.atan2(float(np.linalg.norm(after - before)), float(np.linalg.norm(after + before)))
    if angle < 1e-9:
        return unit((1.0 - t) * before + t * after)
    return unit(math.sin((1.0 - t) * angle) * before + math.sin(t * angle) * after)


def unit(quaternion: Floats) -> Floats:
    """Return a quaternion of length 1; 0, through which a spline may pass, is the identity."""
    length = float(np.linalg.norm(quaternion))
    return quaternion / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])


def names_of(document: Item) -> tuple[str, ...]:
    """Return the names of the file's animations, "" where they have none or are broken: `read_animation` refuses those."""
    entries = document.value.get("animations")
    entries = entries if isinstance(entries, list) else []
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    return tuple(n.encode("utf-8", "replace").decode("utf-8") if isinstance(n, str) else "" for n in names)


def read_animation(document: Item, selection: str | int | None) -> Animation:
    """Read an animation: by name, by number from 0, also as text, or the first; or all of them at once, by ALL, of
    which the last counts where several animate one property.

    Raises InputError for an unknown animation, and for broken samplers.
    """
    count = document.count("animations")
    if selection == ALL and count and ALL not in names_of(document):
        animations = [_animation(document, index) for index in range(count)]
        every = (channel for animation in animations for channel in animation.channels)
        channels = {(channel.node, channel.path): channel for channel in every}
        return Animation(ALL, max(animation.seconds for animation in animations), tuple(channels.values()))
    return _animation(document, _chosen(document, selection))


def _animation(document: Item, index: int) -> Animation:
    item = document.entry("animations", index)
    channels: dict[tuple[int, str], Channel] = {}
    for entry in item.items("channels"):
        target = entry.item("target")
        if target is None:
            raise entry.error("target", "an object", "none")
        if target.text("path") == "pointer":
            document.file.ignored.append(_POINTER)
            continue
        path, node = target.choice("path", _WIDTHS), target.reference("node", "nodes")
        if (node, path) in channels:
            raise target.error("path", "one channel for each property", f"another for {path} of nodes[{node}]")
        if node is not None:  # without a node it is the target of an extension
            channels[node, path] = _channel(item, entry, node, path)
    seconds = max((float(channel.times[-1]) for channel in channels.values()), default=0.0)
    return Animation(item.text("name") or f"animation {index}", seconds, tuple(channels.values()))


def _chosen(document: Item, selection: str | int | None) -> int:
    names = names_of(document)
    if not names:
        raise document.error("animations", "an animation to show", "none")
    if selection is None:
        return 0
    if isinstance(selection, str) and selection in names:
        return names.index(selection)
    text = str(selection)
    if text.isascii() and text.isdigit() and len(text) < 9 and int(text) < len(names):
        return int(text)
    listed = [shorten(name) for name in names if name][:16]
    expected = "one of " + ", ".join([*listed, f"a number from 0 to {len(names) - 1}", ALL])
    raise document.error("animation", expected, quoted(text) + hint(text, list(filter(None, names))))


def shorten(name: str) -> str:
    """Return a name of a file as it is printed: in one line, and not longer than that."""
    name = name if name.isprintable() else ascii(name)
    return name if len(name) <= 64 else name[:64] + "..."


def _channel(animation: Item, entry: Item, node: int, path: str) -> Channel:
    number, samplers = entry.integer("sampler"), list(animation.items("samplers"))
    if number >= len(samplers):
        raise entry.error("sampler", f"an index of the {len(samplers)} samplers", str(number))
    animated = entry.entry("nodes", node)
    if path != "weights" and "matrix" in animated.value:
        raise entry.error("target.node", "a node without a matrix", f"nodes[{node}], which has one")
    width = _WIDTHS[path] or target_count(animated)
    if not width:
        raise entry.error("target.node", "a node whose mesh has morph targets", f"nodes[{node}]")
    sampler = samplers[number]
    kind = sampler.choice("interpolation", _INTERPOLATIONS, "LINEAR")
    times, parts = _times(sampler), 3 if kind == "CUBICSPLINE" else 1  # tangent, value and tangent, or values alone
    columns = 1 if path == "weights" else width
    shape = len(times) * parts * (width // columns), columns
    expected = f"{shape[0]} rows of {columns} for {len(times)} times, float32 or normalized integers"
    rows = sampler.accessor("output", expected, lambda rows: rows.shape == shape and rows.dtype == np.float32)
    sampler.check_rows("output", np.isfinite(rows), "finite numbers", rows)
    values = rows.astype(np.float64).reshape(len(times), parts, width)
    keys = values[:, parts // 2]
    if path == "rotation":
        lengths = np.linalg.norm(keys, axis=1)
        sampler.check_rows("output", lengths > 0.0, "quaternions other than 0", keys)
        if parts == 1:  # the tangents of a spline belong to the values as they are
            keys = keys / lengths[:, None]
    return Channel(node, path, kind, times, keys, values[:, [0, 2]] if parts == 3 else None)


def _times(sampler: Item) -> Floats:
    expected = "float32 of type SCALAR"
    rows = sampler.accessor("input", expected, lambda rows: rows.shape[1] == 1 and rows.dtype == np.float32)
    times: Floats = rows[:, 0].astype(np.float64)
    sampler.check_rows("input", np.isfinite(times) & (times >= 0.0), "finite times from 0 on", times)
    later = np.diff(times) > 0.0
    if not later.all():
        row = int(np.argmin(later)) + 1
        times_there = f"{times[row]:g} after {times[row - 1]:g} in row {row} of accessors[{sampler.value['input']}]"
        raise sampler.error("input", "times that increase", times_there)
    return times
