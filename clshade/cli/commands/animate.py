"""`animate`: the cameras of a file, or an animation of a glTF file, one frame each."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeVar

from ...errors import InputError
from .arguments import refuse
from .farm_options import FPS, draw, output_options, worker_options
from .scene_options import (
    SAMPLES_HELP,
    arranged,
    camera_options,
    chosen_camera,
    load_options,
    load_scene,
    look_of,
    scene_options,
    setting_options,
    tell_of_file,
    wants_ground,
    with_lights,
)

if TYPE_CHECKING:
    from ...farm.frames import Frames
    from ...scene.camera import Camera
    from ...scene.pose import Pose

_T = TypeVar("_T")


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser, required=True)
    parser.add_argument(
        "cameras",
        nargs="?",
        metavar="CAMERAS.json",
        help='a list such as [{"eye": [0, 1, 5]}, {"eye": [1, 1, 5], "fov": 40}]: frames 1, 2, ... of the scene as it is; '
        "without it an animation of a glTF file is played: its length at --fps; with --animation all, of several for one "
        "property the last counts",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--frames", metavar="1..120", help="the frames to draw, from 1; also 5, 1..120..2 or 1..10,20")
    which.add_argument(
        "--count", type=int, metavar="N", help="number of frames, evenly spaced over an animation's length"
    )
    camera_options(parser)
    setting_options(parser, SAMPLES_HELP)
    output_options(parser)
    worker_options(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...farm import parse_frames

    frames = None if arguments.frames is None else parse_frames(arguments.frames)
    return _play(arguments, frames) if arguments.cameras is None else _fly(arguments, frames)


def _fly(arguments: argparse.Namespace, frames: Frames | None) -> int:
    """Draw the scene as the cameras of the file see it."""
    from ...farm import read_cameras

    refuse(arguments, ("count",), "is for the animation of a glTF file, and cannot go with CAMERAS.json")
    scene = load_scene(arguments)
    cameras = read_cameras(arguments.cameras, scene.camera, arguments.resolution)
    numbers = _numbers(frames, arguments, len(cameras), arguments.cameras)
    return draw(arguments, scene, {number: cameras[number - 1] for number in numbers})


def _play(arguments: argparse.Namespace, frames: Frames | None) -> int:
    """Draw an animation of a glTF file."""
    from ...base import console
    from ...base.atomic_files import shown
    from ...scene import adjust_camera
    from ...scene.formats.load import load_animation
    from ...scene.formats.table import extensions_with

    name = arguments.scene
    if not name.lower().endswith(extensions_with("animation")):
        raise InputError(f"CAMERAS.json: a file of cameras is missing, and {shown(name)} has no animation to play")
    options = load_options(arguments)
    for option in ("time", "focal"):
        if option in options:
            raise InputError(f"--{option}: cannot go with an animation that is played")
    fit = arguments.camera == "fit"
    played = load_animation(
        name, count=arguments.count, fps=_rate(arguments), resolution=arguments.resolution, fit=fit, **options
    )
    tell_of_file(played.scene, arguments, name)
    count = len(played.times)
    console.progress(f"{shown(name)}: {shown(played.name)}, {played.seconds:.6g} s: frames 1..{count}")
    numbers = _numbers(frames, arguments, count, "the animation")
    whole = (
        played.stage
        if played.scene.fitted or fit or wants_ground(look_of(played.scene, arguments), arguments)
        else played.scene
    )
    stage = arranged(whole, arguments, moving=True)
    shared, staged = len(played.scene.meshes), len(whole.meshes)
    scene = replace(stage, meshes=(*stage.meshes[:shared], *stage.meshes[staged:]))  # the last may be a ground

    def camera(frame: int) -> Camera:
        if played.scene.fitted or fit:
            return scene.camera
        moved = replace(played.scene, camera=played.cameras[frame])
        return adjust_camera.camera_of(moved, chosen_camera(arguments))

    def pose(frame: int) -> Pose:
        found = played.poses[frame]
        if found.lights is None:
            return found
        return replace(found, lights=with_lights(replace(played.scene, lights=found.lights), arguments).lights)

    def source() -> Any:
        return played.poses.source, arguments.lights, arguments.light_intensity, arguments.light_radius

    return draw(arguments, scene, _Frames(numbers, camera), _Poses(numbers, pose, source))


def _rate(arguments: argparse.Namespace) -> float:
    """Return how many frames a second of the animation has. Raises InputError for a rate that is no number above 0."""
    if arguments.fps is None:
        return FPS
    try:
        rate = float(Fraction(arguments.fps))
    except (ValueError, ZeroDivisionError, OverflowError):
        rate = 0.0
    if not rate > 0.0:
        raise InputError(f"--fps: expected a number above 0, or a fraction such as 30000/1001, found {arguments.fps!r}")
    return rate


def _numbers(frames: Frames | None, arguments: argparse.Namespace, count: int, owner: str) -> Sequence[int]:
    """Return the numbers of the frames to draw, of `count`. owner: what has them, for the error."""
    numbers: Sequence[int] = range(1, count + 1) if frames is None else frames.numbers
    if not 1 <= numbers[0] <= numbers[-1] <= count:
        raise InputError(f"--frames: {arguments.frames} goes beyond the frames of {owner}, 1..{count}")
    return numbers


class _Frames(Mapping[int, _T]):
    """What `make` makes of each frame of these numbers, when it is looked up."""

    def __init__(self, numbers: Sequence[int], make: Callable[[int], _T]) -> None:
        self._numbers, self._make = dict.fromkeys(numbers), make

    def __getitem__(self, number: int) -> _T:
        if number not in self._numbers:
            raise KeyError(number)
        return self._make(number)

    def __contains__(self, number: object) -> bool:
        return number in self._numbers

    def __iter__(self) -> Iterator[int]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


class _Poses(_Frames["Pose"]):
    """Poses of these frames, and their `source`, see `draw_film`."""

    def __init__(self, numbers: Sequence[int], make: Callable[[int], Pose], source: Callable[[], Any]) -> None:
        super().__init__(numbers, make)
        self._source = source

    @property
    def source(self) -> Any:
        return self._source()
