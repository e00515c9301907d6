"""`poster`: an image of any size, drawn in tiles."""

from __future__ import annotations

import argparse
import json

from ...errors import InputError
from . import DONE
from .arguments import output_name
from .farm_options import drawing_options, worker_options
from .saving_options import OUTPUT, saving_options
from .scene_options import SAMPLES_HELP, camera_options, load_scene, scene_options, setting_options

TILE = 2048  # view.poster.TILE, whose import loads NumPy


def add_options(parser: argparse.ArgumentParser) -> None:
    scene_options(parser)
    camera_options(parser)
    setting_options(parser, SAMPLES_HELP)
    output = parser.add_argument_group(OUTPUT)
    output.add_argument(
        "-o",
        "--output",
        type=output_name,
        default="poster",
        metavar="OUT",
        help="OUT.exr and OUT.png (default: poster)",
    )
    output.add_argument(
        "--tile", type=int, default=TILE, metavar="PIXELS", help=f"a side of a tile, a power of two (default: {TILE})"
    )
    output.add_argument("--keep-tiles", action="store_true", help="in the folder OUT.tiles")
    output.add_argument("--overwrite", action="store_true", help="draw tiles that an earlier run left, too")
    saving_options(output)
    output.add_argument("--json", action="store_true", help="print the summary as JSON")
    worker_options(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...scene.camera import MAX_RESOLUTION, checked_resolution
    from ...scene.image_part import MAX_WHOLE
    from ...view.poster import draw_poster

    if arguments.resolution is None:
        expected = f"columns and rows, up to {MAX_WHOLE} each, such as 32768x24576"
        raise InputError(f"--resolution: expected {expected}, found none")
    columns, rows = asked = checked_resolution("--resolution", arguments.resolution, MAX_WHOLE)
    reduction = max(1.0, max(asked) / MAX_RESOLUTION)  # of the image for which a camera is chosen
    arguments.resolution = max(1, round(columns / reduction)), max(1, round(rows / reduction))
    scene = load_scene(arguments)
    poster = draw_poster(
        scene,
        arguments.output,
        resolution=asked,
        tile=arguments.tile,
        keep_tiles=arguments.keep_tiles,
        **drawing_options(arguments, scene),
    )
    print(json.dumps(poster.stats(), indent=2) if arguments.json else "\n".join(poster.lines()))
    return DONE
