"""`inspect`: the contents of an image file, or the meshes, scalars, lights and animations of a scene file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...base.atomic_files import shown
from ...errors import InputError
from . import DONE
from .arguments import check_picture, numbers, output_name

if TYPE_CHECKING:
    from ...images.image_file import Picture


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        metavar="FILE",
        help="an EXR, of any program, or a PNG, whose values are code/largest code; or a scene file: its meshes, the "
        "scalars that `render --scalars` can show, with their ranges, its lights and its animations",
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

    if _is_scene(arguments.file):
        return _inspect_scene(arguments)
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


def _is_scene(name: str) -> bool:
    from ...scene.formats.load import EXTENSIONS

    return Path(name).suffix.lower() in EXTENSIONS


def _inspect_scene(arguments: argparse.Namespace) -> int:
    from ...scene.contents import format_contents, scene_contents
    from ...scene.formats.load import load

    if arguments.output or arguments.pixel:
        option = "--output" if arguments.output else "--pixel"
        raise InputError(f"{option}: expected an image beside it, found the scene file {shown(arguments.file)}")
    contents = scene_contents(load(arguments.file))
    if arguments.json:
        import json

        print(json.dumps({"file": arguments.file, **contents}, indent=2))
    else:
        print(format_contents(contents))
    return DONE


def _print_json(arguments: argparse.Namespace, picture: Picture) -> None:
    import json

    from ...base.json_values import plain
    from ...images import statistics

    pixels = statistics.pixel_stats(picture, arguments.pixel)
    found = statistics.image_statistics(picture).stats()
    print(json.dumps({"file": arguments.file, **found, "header": plain(picture.header), "pixels": pixels}, indent=2))
