"""`conform`: whether an OpenCL device computes what it has to."""

from __future__ import annotations

import argparse

from . import DONE, FAILED
from .arguments import device_option, output_name


def add_options(parser: argparse.ArgumentParser) -> None:
    what = "only these groups of tests: operations, constructs, structs, memory, repeatability, coverage, scenes"
    what_else = parser.add_mutually_exclusive_group()
    what_else.add_argument("--only", type=lambda text: text.split(","), default=(), metavar="GROUP,...", help=what)
    what = "instead, write the golden hashes of this device's scenes, if all agree with the oracle"
    what_else.add_argument("--write-golden", type=output_name, metavar="FILE", help=what)
    device_option(parser)
    parser.add_argument(
        "-o",
        "--out",
        type=output_name,
        default="conform",
        metavar="DIR",
        help="folder for the card, conform.csv, .json and .md, and for scripts that show failures (default: conform)",
    )


def run(arguments: argparse.Namespace) -> int:
    from ...measure.conform import conform, scenes

    if arguments.write_golden is not None:
        scenes.write_golden(arguments.device, arguments.write_golden)
        return DONE
    return DONE if conform.run(arguments.device, out=arguments.out, only=arguments.only) else FAILED
