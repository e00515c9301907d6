"""`inspect`: what an EXR holds."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import DONE


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE.exr", help="the image")
    parser.add_argument("-o", "--output", metavar="PNG", help="exposure ladder (default: FILE-ladder.png)")


def run(arguments: argparse.Namespace) -> int:
    from .. import exr, inspecting

    path = Path(arguments.file)
    channels, _ = exr.read(path)
    print(inspecting.format_statistics(inspecting.statistics(channels)))
    picture = Path(arguments.output) if arguments.output else path.with_name(path.stem + "-ladder.png")
    inspecting.exposure_ladder(channels, picture)
    print(f"wrote {picture}")
    return DONE
