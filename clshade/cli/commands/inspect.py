"""`inspect`: the contents of an image file, or the contents of a scene."""

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
        metavar="FILE|SCENE",
        help="an EXR, of any program, or a PNG, whose values are code/largest code; or a scene, a file or a built-in one: "
        "its meshes, materials, textures, camera, lights, animations, and the scalars that `render --scalars` can show",
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
    from ...scene.builtin.scenes import BUILTINS
    from ...scene.formats.table import EXTENSIONS

    return Path(name).suffix.lower() in EXTENSIONS or (name in BUILTINS and not Path(name).exists())


def _inspect_scene(arguments: argparse.Namespace) -> int:
    from ...scene.builtin.scenes import builtin
    from ...scene.contents import format_contents, scene_contents
    from ...scene.formats.gltf import animations_and_cameras
    from ...scene.formats.load import load
    from ...scene.formats.table import extensions_with

    if arguments.output or arguments.pixel:
        option = "--output" if arguments.output else "--pixel"
        raise InputError(f"{option}: is for images, not for the scene {shown(arguments.file)}")
    name: str = arguments.file
    if not Path(name).suffix:
        contents = scene_contents(builtin(name))
    elif name.lower().endswith(extensions_with("animation")):
        contents = scene_contents(load(name), *animations_and_cameras(name))
    else:
        contents = scene_contents(load(name))
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
