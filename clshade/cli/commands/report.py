"""`report`: error against run time."""

from __future__ import annotations

import argparse
import os
import shlex
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from ...measure.defaults import FRAMES
from . import DONE, FAILED
from .arguments import device_option, given_options, limit_options, names, output_name, refuse
from .scene_options import (
    camera_options,
    chosen_settings,
    light_options,
    lit,
    load_scene,
    look_of,
    placed,
    read_scene,
    scene_options,
)

if TYPE_CHECKING:
    from ...scene.model import Scene, Settings
    from ...scene.settings import Look

RESOLUTION = (320, 240)  # default of --resolution: the report takes less than half a minute


def add_options(parser: argparse.ArgumentParser) -> None:
    from ...images.figures import FORMATS

    first = len(parser._actions)
    scene_options(parser, size="{},{}".format(*RESOLUTION))
    camera_options(parser)
    repeated = [action.dest for action in parser._actions[first:] if action.dest not in ("scene", "resolution")]
    study = parser.add_argument_group("study: what is compared, and what is written")
    study.add_argument(
        "-o",
        "--out",
        type=output_name,
        default="report",
        metavar="DIR",
        help="folder for tables and figure (default: report)",
    )
    study.add_argument(
        "--format", type=names(FORMATS), metavar="NAME,...", help=f"of the figure: {','.join(FORMATS)} (default: png)"
    )
    study.add_argument("--html", action="store_true", default=None, help="also one page with tables and pictures")
    study.add_argument("--only", nargs="+", default=(), metavar="NAME", help="these variants only")
    study.add_argument("--list", action="store_true", help="name all variants")
    study.add_argument(
        "--details", action="store_true", default=None, help="all variants, causes of the error; print all tables"
    )
    light_options(study)
    study.add_argument("--frames", type=int, metavar="N", help=f"of each variant (default: {FRAMES})")
    limit_options(study)
    study.add_argument(
        "--course",
        action="store_true",
        help="of a course scene instead: its figures 1 to 19, errors and times on one HTML page, --out",
    )
    device_option(parser)
    parser.set_defaults(repeated=[*repeated, "device"])


def run(arguments: argparse.Namespace) -> int:
    from ...measure.report import report

    if arguments.list:
        print(report.listing())
        return DONE
    if arguments.course:
        return _course(arguments)
    arguments.resolution = arguments.resolution or RESOLUTION
    read = read_scene(arguments, arguments.scene)
    shown, look = lit(read, arguments)
    scene = placed(shown, look, arguments)
    scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    taken = ("out", "frames", "budget", "tolerance", "details", "html")
    given = {name: getattr(arguments, name) for name in taken}
    given |= {
        "command": partial(_command, arguments, read, scene, look),
        "settings": chosen_settings(arguments),
        "names": arguments.only,
        "formats": arguments.format,
    }
    options = {name: value for name, value in given.items() if value is not None}
    return DONE if report.run(scene, arguments.device, **options) else FAILED


def _command(arguments: argparse.Namespace, read: Scene, scene: Scene, look: Look, settings: Settings) -> str:
    """Return the command that draws the scene with these settings. read: the scene without its look."""
    from ...base.declare import as_option
    from ...measure.report.tables import render_fields, render_options
    from ...scene.settings import LIGHT_FIELDS, PRESETS
    from ...view.live_command import as_argument

    presets = PRESETS if look == "plain" else (scene.preset,)
    light = {name: getattr(arguments, name) for name in LIGHT_FIELDS}
    light = {name: value for name, value in light.items() if value is not None and value == getattr(settings, name)}
    given = render_fields(settings, scene, presets, **light)
    options = [as_argument(arguments.scene), *given_options(arguments, arguments.repeated)]
    own = {**vars(arguments), **dict.fromkeys(vars(settings)), **given}
    if look_of(read, argparse.Namespace(**own)) != look:
        options.append(as_option("look", look))
    return shlex.join(["clshade", "render", *options, *render_options(scene, given)])


def _course(arguments: argparse.Namespace) -> int:
    """Write the page of a course scene."""
    from ... import __version__
    from ...base.atomic_files import shown
    from ...measure.course_report import course_report
    from ...scene.settings import LIGHT_FIELDS

    unused = ("only", "details", "frames", "budget", "tolerance", "html", "format", *LIGHT_FIELDS)
    refuse(arguments, unused, "cannot go with --course, which studies no variants")
    course_report.output_path(arguments.out)  # its errors come before the scene's
    if arguments.device:
        os.environ["CLSHADE_DEVICE"] = arguments.device
    scene = load_scene(arguments)
    if arguments.resolution:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    path = course_report.run(scene, arguments.scene, arguments.out, __version__)
    print(f"wrote {shown(path)}")
    return DONE
