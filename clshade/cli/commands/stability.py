"""`stability`: stiff and extreme cases, or the stability of a scene."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ...errors import InputError
from . import DONE, FAILED
from .arguments import names, output_name
from .scene_options import camera_options, chosen_settings, load_scene, scene_options, setting_options

TRIANGLES = 50_000  # random ones


def add_options(parser: argparse.ArgumentParser) -> None:
    from ...images.figures import FORMATS

    before = len(parser._actions)
    scene_options(parser, default=None)
    camera_options(parser)
    setting_options(parser)
    parser.set_defaults(of_scene=parser._actions[before:])
    cases = parser.add_argument_group("cases: without a SCENE")
    first = len(parser._actions)
    cases.add_argument("--case", nargs="+", default=(), metavar="NAME", help="only these, by name or number")
    cases.add_argument("--triangles", type=int, default=TRIANGLES, help="random ones to draw (default: 50000)")
    cases.add_argument("--list", action="store_true", help="name all cases, and what is expected of each")
    cases.add_argument(
        "--format",
        type=names(FORMATS),
        default=("png",),
        metavar="NAME,...",
        help=f"of the figure of errors against stiffness: {','.join(FORMATS)} (default: png)",
    )
    parser.set_defaults(of_cases=parser._actions[first:])
    parser.add_argument("--device", help="as for render, or `all` for the cases: every device that works")
    parser.add_argument(
        "-o",
        "--out",
        type=output_name,
        default="stability",
        metavar="DIR",
        help="folder for tables, figures and pictures (default: stability)",
    )


def run(arguments: argparse.Namespace) -> int:
    _refuse_others(arguments)
    if arguments.scene is not None:
        return _run_scene(arguments)
    from ...measure.stability import stability

    if arguments.list:
        print(stability.listing())
        return DONE
    if arguments.case and arguments.format != ("png",):
        raise InputError("stability: --format: is for the figure that all cases have, and cannot go with --case")
    options = {"out": arguments.out, "triangles": arguments.triangles, "formats": arguments.format}
    return DONE if stability.run(arguments.device, names=arguments.case, **options) else FAILED


def _refuse_others(arguments: argparse.Namespace) -> None:
    """Raise InputError for an option of a scene without one, and for one of the cases beside a scene."""
    why = "needs a SCENE" if arguments.scene is None else f"is for the cases, and cannot go with {arguments.scene!r}"
    for action in arguments.of_scene if arguments.scene is None else arguments.of_cases:
        if getattr(arguments, action.dest) != action.default:
            raise InputError(f"stability: {action.option_strings[0]}: {why}")


def _run_scene(arguments: argparse.Namespace) -> int:
    scene = load_scene(arguments)
    if arguments.resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    from ...measure.stability import scene_stability
    from ...scene.model import Settings

    settings = Settings.from_preset(arguments.preset or scene.preset, **chosen_settings(arguments))
    passed = scene_stability.run(scene, settings, arguments.device, out=arguments.out)
    return DONE if passed else FAILED
