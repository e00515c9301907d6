"""`fuzz`: random scenes and damaged files."""

from __future__ import annotations

import argparse

from . import DONE, FAILED
from .arguments import device_option


def add_options(parser: argparse.ArgumentParser) -> None:
    for name, count, what in (
        ("scenes", 1000, "random scenes to draw"),
        ("files", 1000, "damaged files to load"),
        ("seed", 0, "another seed gives other scenes and files"),
        ("first", 0, "number of the first scene and file: `--first 7 --scenes 1` draws scene 7 again"),
    ):
        parser.add_argument(f"--{name}", type=int, default=count, metavar="N", help=f"{what} (default: {count})")
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    from ..checks import fuzz

    counts = {name: getattr(arguments, name) for name in ("scenes", "files", "seed", "first")}
    return DONE if fuzz.run(arguments.device, **counts) else FAILED
