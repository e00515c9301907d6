"""`turntable`: the camera orbits its focal point."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from ...base import console
from .farm_options import draw, output_options, worker_options
from .scene_options import SAMPLES_HELP, camera_options, load_scene, scene_options, setting_options

if TYPE_CHECKING:
    from ...farm.frames import Frames

FRAMES = "1..120"


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser)
    turn = parser.add_argument_group("turn: about what points up, through what is looked at")
    which = turn.add_mutually_exclusive_group()
    which.add_argument(
        "--frames", metavar="1..120", help=f"the frames to draw; also 5, 1..120..2 or 1..10,20 (default: {FRAMES})"
    )
    which.add_argument("--count", type=int, metavar="N", help="number of frames: the same as --frames 1..N")
    turn.add_argument(
        "--turn",
        metavar="1..120",
        help="frames of a whole turn, where --frames are some of them (default: from the first to the last)",
    )
    turn.add_argument(
        "--degrees", type=float, default=360.0, metavar="DEG", help="to the right; below 0: to the left (default: 360)"
    )
    camera_options(parser)
    setting_options(parser, SAMPLES_HELP)
    output_options(parser)
    worker_options(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...base.validation import number
    from ...farm import orbit, parse_frames

    frames = _frames(arguments)
    turn = frames if arguments.turn is None else parse_frames(arguments.turn, "--turn")
    degrees = number("turntable", "--degrees", arguments.degrees)
    scene = load_scene(arguments, turning=True)
    if arguments.resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    return draw(arguments, scene, orbit(scene.camera, frames.numbers, turn, degrees))


def _frames(arguments: argparse.Namespace) -> Frames:
    """Return the frames of --frames or --count; warn if a frame number was probably meant as the number of frames."""
    from ...base.validation import integer
    from ...farm.frames import MOST, parse_frames

    if arguments.count is not None:
        return parse_frames(f"1..{integer('turntable', '--count', arguments.count, 1, MOST)}")
    frames = parse_frames(FRAMES if arguments.frames is None else arguments.frames)
    count = frames.last
    if frames.span == 1 and 1 < count <= MOST and arguments.turn is None and "#" in arguments.output:
        console.warning(f"--frames {count} is one frame, that of number {count}: --count {count} draws {count} frames")
    return frames
