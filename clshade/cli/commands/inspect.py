"""`inspect`: the contents of an image file."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from . import DONE
from .arguments import check_picture, numbers, output_name

if TYPE_CHECKING:
    from ...images.image_file import Picture


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
        type=output_name,
        metavar="PNG",
        help="write a figure: exposures of -4 to +4 stops, luminance in stops as false color and histogram, all layers",
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print all figures as JSON: null for what is not finite, or the texts nan, inf and -inf in pixels",
    )


def run(arguments: argparse.Namespace) -> int:
    from ...base import atomic_files, console
    from ...images import statistics
    from ...images.image_file import read_picture

    if arguments.output:
        check_picture(arguments.output, (arguments.file,))
    picture = read_picture(arguments.file)
    if arguments.json:
        _print_json(arguments, picture)
    else:
        pixels = statistics.format_pixels(picture, arguments.pixel)
        print(statistics.format_statistics(statistics.image_statistics(picture)))
        print(statistics.format_header(picture.header))
        if pixels:
            print(pixels)
    if arguments.output:
        from ...images import figures, statistics_figure

        figures.save(statistics_figure.draw(picture, atomic_files.shown(arguments.file)), arguments.output)
        console.progress(f"wrote {atomic_files.shown(arguments.output)}")
    return DONE


def _print_json(arguments: argparse.Namespace, picture: Picture) -> None:
    import json

    from ...base.json_values import plain
    from ...images import statistics

    pixels = statistics.pixel_stats(picture, arguments.pixel)
    found = statistics.image_statistics(picture).stats()
    print(json.dumps({"file": arguments.file, **found, "header": plain(picture.header), "pixels": pixels}, indent=2))
