"""`animate`: the cameras of a file, one frame each."""

from __future__ import annotations

import argparse

from ...errors import InputError
from .farm_options import draw, output_options, worker_options
from .scene_options import SAMPLES_HELP, camera_options, load_scene, scene_options, setting_options


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser, required=True)
    parser.add_argument(
        "cameras",
        metavar="CAMERAS.json",
        help='a list such as [{"eye": [0, 1, 5]}, {"eye": [1, 1, 5], "fov": 40}]: frames 1, 2, ...',
    )
    parser.add_argument("--frames", metavar="1..120", help="these only, counted from 1: also 5, 1..120..2 or 1..10,20")
    camera_options(parser)
    setting_options(parser, SAMPLES_HELP)
    output_options(parser)
    worker_options(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...farm import parse_frames, read_cameras

    frames = None if arguments.frames is None else parse_frames(arguments.frames)
    scene = load_scene(arguments)
    cameras = read_cameras(arguments.cameras, scene.camera)
    if arguments.resolution is not None:
        cameras = tuple(camera.with_resolution(arguments.resolution) for camera in cameras)
    numbers = range(1, len(cameras) + 1) if frames is None else frames.numbers
    if not 1 <= numbers[0] <= numbers[-1] <= len(cameras):
        found = f"{arguments.frames}, and the cameras of {arguments.cameras} are 1..{len(cameras)}"
        raise InputError(f"--frames: expected frames that have a camera, found {found}")
    return draw(arguments, scene, {number: cameras[number - 1] for number in numbers})
