"""`inspect`: what an image file holds."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from . import DONE
from .arguments import numbers

if TYPE_CHECKING:
    from ..pictures import Picture


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", metavar="FILE", help="an EXR, of any program, or a PNG, whose values are code/largest code"
    )
    parser.add_argument(
        "--pixel",
        type=numbers(int, 2, "a column and a row such as 10,20"),
        action="append",
        default=[],
        metavar="X,Y",
        help="the values of column X and row Y, counted from 0 at the TOP left; may be given again",
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="PNG",
        help="write a figure: exposures of -4 to +4 stops, luminance in stops as false color and histogram, all layers",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print all figures as JSON: null for what is not finite, or the texts nan, inf and -inf in pixels",
    )


def run(arguments: argparse.Namespace) -> int:
    from .. import atomic, inspecting, telling
    from ..pictures import read_picture

    if arguments.output:
        atomic.check(arguments.output)
    picture = read_picture(arguments.file)
    if arguments.json:
        _print_json(arguments, picture)
    else:
        pixels = inspecting.format_pixels(picture, arguments.pixel)
        print(inspecting.format_statistics(inspecting.statistics(picture)))
        print(inspecting.format_header(picture.header))
        if pixels:
            print(pixels)
    if arguments.output:
        from .. import inspect_figure

        with atomic.replacing(arguments.output) as file:
            inspect_figure.draw(picture, atomic.shown(arguments.file)).savefig(file, format="png")
        telling.progress(f"wrote {atomic.shown(arguments.output)}")
    return DONE


def _print_json(arguments: argparse.Namespace, picture: Picture) -> None:
    import json

    from .. import inspecting
    from ..plain import plain

    pixels = inspecting.pixel_stats(picture, arguments.pixel)
    figures = inspecting.statistics(picture).stats()
    print(json.dumps({"file": arguments.file, **figures, "header": plain(picture.header), "pixels": pixels}, indent=2))
