"""`turntable`: the camera goes round what it looks at."""

from __future__ import annotations

import argparse
from dataclasses import replace

from .farm_options import draw, output_options, worker_options
from .scene_options import camera_options, load_scene, scene_options, setting_options

FRAMES = "1..120"


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser)
    turn = parser.add_argument_group("turn, about what points up, through what is looked at")
    turn.add_argument(
        "--frames", default=FRAMES, metavar="1..120", help=f"also 5, 1..120..2 or 1..10,20 (default: {FRAMES})"
    )
    turn.add_argument(
        "--turn",
        metavar="1..120",
        help="frames of a whole turn, where --frames are some of them (default: from the first to the last)",
    )
    turn.add_argument(
        "--degrees", type=float, default=360.0, metavar="DEG", help="to the right; below 0: to the left (default: 360)"
    )
    camera_options(parser)
    setting_options(parser)
    output_options(parser)
    worker_options(parser)


def run(arguments: argparse.Namespace) -> int:
    from ..farm import orbit, parse_frames
    from ..validation import number

    frames = parse_frames(arguments.frames)
    turn = frames if arguments.turn is None else parse_frames(arguments.turn, "--turn")
    degrees = number("turntable", "--degrees", arguments.degrees)
    scene = load_scene(arguments)
    if arguments.resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    return draw(arguments, scene, orbit(scene.camera, frames.numbers, turn, degrees))
