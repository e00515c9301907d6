"""Play an animation of a glTF file: one scene, and what each frame changes in it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from ...base.arrays import Floats
from ...base.atomic_files import Path
from ...base.validation import integer, number
from ...errors import InputError
from ..camera import Camera
from ..fitting import bounding_sphere
from ..geometry import bounding_box
from ..model import Mesh, Scene
from ..pose import Pose, changes_of, pose_between
from .gltf import GltfFile
from .gltf_animations import Animation
from .options import Options

FPS = 30
MOST = 1_000_000  # frames
_T = TypeVar("_T")


class _Each(Mapping[int, _T]):
    """What `make` makes of the time of each frame, by its number from 1, when it is looked up."""

    def __init__(self, times: tuple[float, ...], make: Callable[[float], _T]) -> None:
        self._times, self._make = times, make

    def __getitem__(self, frame: int) -> _T:
        if frame not in range(1, len(self._times) + 1):
            raise KeyError(frame)
        return self._make(self._times[frame - 1])

    def __iter__(self) -> Iterator[int]:
        return iter(range(1, len(self._times) + 1))

    def __contains__(self, frame: object) -> bool:
        return frame in range(1, len(self._times) + 1)

    def __len__(self) -> int:
        return len(self._times)


class Poses(_Each[Pose]):
    """Poses by frame number. source: what they are computed from, which tells them from others without computing them."""

    def __init__(self, times: tuple[float, ...], make: Callable[[float], Pose], source: Callable[[], Any]) -> None:
        super().__init__(times, make)
        self._source = source

    @functools.cached_property
    def source(self) -> Any:
        return self._source()


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
        Camera of each frame: the file's, which may move, or that of `scene`.
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
    animation = file.animation(options.animation)
    if count is None:
        count = max(1, round(min(animation.seconds * number("load_animation", "fps", fps, above=0.0), MOST + 1)))
        if count > MOST:
            raise InputError(
                f"load_animation: fps: expected at most {MOST} frames, found {animation.seconds:g} s of {fps:g}"
            )
    count = integer("load_animation", "count", count, 1, MOST)
    times = tuple(animation.seconds * k / count for k in range(count))
    meshes, nodes = file.meshes(animation.at(times[0]))
    extent = functools.cache(lambda: _extent(file, animation, times, meshes))
    sphere = bounding_sphere(meshes)
    chosen = file.camera(nodes, sphere) is None or not file.lights(nodes, sphere)
    stage_meshes = (*meshes, *extent()) if chosen else meshes
    sphere = bounding_sphere(stage_meshes) if chosen else sphere
    scene = replace(file.framed(stage_meshes, nodes, sphere), meshes=meshes)

    def pose(time: float) -> Pose:
        posed, nodes = file.meshes(animation.at(time))
        lights = file.lights(nodes, sphere, scene.light_scale) if scene.own_lights else None
        return pose_between(meshes, posed, lights)

    def camera(time: float) -> Camera:
        own = None if scene.fitted else file.camera(file.nodes(animation.at(time)), sphere)
        return own or scene.camera

    poses = Poses(times, pose, lambda: (file.buffers.digest(), options, animation.name, times))
    return Played(scene, animation.name, animation.seconds, times, poses, _Each(times, camera), extent)


def _extent(
    file: GltfFile, animation: Animation, times: tuple[float, ...], meshes: tuple[Mesh, ...]
) -> tuple[Mesh, ...]:
    """Return a mesh whose vertices are the corners of the boxes that the moving meshes fill; nothing if none moves."""
    boxes: dict[int, tuple[Floats, Floats]] = {}
    for time in times[1:]:
        for index, (mesh, posed) in enumerate(zip(meshes, file.meshes(animation.at(time))[0], strict=True)):
            if changes_of(mesh, posed):
                low, high = _box(posed)
                lows, highs = boxes.get(index, (low, high))
                boxes[index] = np.minimum(lows, low), np.maximum(highs, high)
    if not boxes:
        return ()
    ends = np.array(list(boxes.values()))  # (K, 2, 3)
    corners = np.stack([ends[:, [x, y, z], [0, 1, 2]] for x, y, z in np.ndindex(2, 2, 2)], axis=1).reshape(-1, 3)
    faces = np.repeat(np.arange(len(corners), dtype=np.int32)[:, None], 3, axis=1)
    return (Mesh(corners, faces, name="extent of the animation"),)


def _box(mesh: Mesh) -> tuple[Floats, Floats]:
    return bounding_box(Scene((mesh,), Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0))))
