"""`stability`: stiff and extreme cases."""

from __future__ import annotations

import argparse

from . import DONE, FAILED
from .arguments import output_name


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--device", help="as for render, or `all`: every device that works")
    parser.add_argument(
        "--out",
        type=output_name,
        default="stability",
        metavar="DIR",
        help="folder for table, figure and pictures (default: stability)",
    )
    parser.add_argument("--case", nargs="+", default=(), metavar="NAME", help="only these, by name or number")
    parser.add_argument("--triangles", type=int, default=50_000, help="random ones to draw (default: 50000)")
    parser.add_argument("--list", action="store_true", help="name all cases, and what is expected of each")


def run(arguments: argparse.Namespace) -> int:
    from ...measure.stability import stability

    if arguments.list:
        print(stability.listing())
        return DONE
    options = {"out": arguments.out, "names": arguments.case, "triangles": arguments.triangles}
    return DONE if stability.run(arguments.device, **options) else FAILED
