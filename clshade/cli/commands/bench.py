"""`bench`: frame times of scenes, beside OpenGL's of the same image."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...base.spelling import hint
from ...errors import InputError
from ...measure.defaults import BENCH_FRAMES
from . import DONE, FAILED
from .arguments import device_option, from_1, output_name, refuse
from .scene_options import camera_options, chosen_settings, load_scene, scene_changes, setting_options

if TYPE_CHECKING:
    from ...measure.bench.workloads import Workload


def add_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("scenes: files, and how they are read")
    group.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help="files, workloads of --list, or built-in scenes, sought in this order (default: all workloads)",
    )
    before = len(parser._actions)
    scene_changes(parser, group)
    camera_options(parser)
    setting_options(parser)
    parser.set_defaults(of_scene=[action.dest for action in parser._actions[before:]])
    group = parser.add_argument_group("measurement: what is timed, and what is written")
    group.add_argument("--list", action="store_true", help="name all workloads")
    group.add_argument(
        "--frames", type=from_1, default=BENCH_FRAMES, metavar="N", help=f"of each scene (default: {BENCH_FRAMES})"
    )
    group.add_argument(
        "--against",
        choices=("llvmpipe", "opengl"),
        help="draw in turns with Mesa's software rasterizer, or with the machine's OpenGL (PyPI's moderngl)",
    )
    group.add_argument("-o", "--out", type=output_name, metavar="PREFIX", help="write PREFIX.csv, .json and .md")
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...measure.bench import bench
    from ...measure.bench.workloads import WORKLOADS

    if arguments.list:
        print(bench.listing())
        return DONE
    names = list(dict.fromkeys(arguments.scenes)) or [workload.name for workload in WORKLOADS]
    workloads = [_workload(arguments, name) for name in names]
    options = {"frames": arguments.frames, "against": arguments.against, "out": arguments.out}
    return DONE if bench.run(workloads, arguments.device, **options) else FAILED


def _workload(arguments: argparse.Namespace, name: str) -> Workload:
    """Return the workload of this name, unless there is such a file, or the scene with the options of the command line."""
    from ...measure.bench.workloads import WORKLOADS, Workload
    from ...scene.builtin.scenes import BUILTINS

    known = {workload.name: workload for workload in WORKLOADS}
    if not Path(name).is_file():
        if name in known:
            refuse(arguments, arguments.of_scene, f"cannot go with {name!r}, a workload, whose scene is fixed")
            return known[name]
        if not Path(name).suffix and name not in BUILTINS:
            near = hint(name, (*known, *BUILTINS))
            raise InputError(f"SCENE: expected a file, a built-in scene or a workload of --list, found {name!r}{near}")
    scene = load_scene(arguments, name)
    if arguments.resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    return Workload(name, "", lambda: scene, {"preset": arguments.preset, **chosen_settings(arguments)})
