"""Options for stereo pairs: two images, or two runs of frames, of a left and a right eye."""

from __future__ import annotations

import argparse

from .arguments import refuse

EYES = ("left", "right")


def stereo_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("stereo: the images of two eyes")
    group.add_argument(
        "--stereo",
        type=float,
        metavar="BASELINE",
        help="draw the images of two eyes, BASELINE scene units apart, half of it to the left and right of the camera, with "
        "parallel directions: OUT.left.exr, OUT.right.exr and so on, of frames OUT.left.####.exr",
    )
    group.add_argument(
        "--convergence",
        type=float,
        metavar="DISTANCE",
        help="along the viewing direction, at which both images are alike, by shifted principal points (default: infinity)",
    )


def check_stereo(arguments: argparse.Namespace, *others: str) -> None:
    """Refuse options that do nothing together. others: names of options that exclude --stereo."""
    if arguments.stereo is None:
        refuse(arguments, ("convergence",), "needs --stereo BASELINE")
    for name in others:
        if getattr(arguments, name):
            refuse(arguments, ("stereo",), f"cannot go with --{name}")
