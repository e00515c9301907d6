"""`fuzz`: random scenes and damaged files."""

from __future__ import annotations

import argparse
import re

from . import DONE, FAILED
from .arguments import device_option


def seeds(text: str) -> range:
    """Parse one seed, such as 7, or a range, such as 1..20."""
    found = re.fullmatch(r"([0-9]{1,18})(?:\.\.([0-9]{1,18}))?", text)
    if not found or int(found[2] or found[1]) < int(found[1]):
        raise argparse.ArgumentTypeError(f"expected a whole number from 0 or a range such as 1..20, found {text!r}")
    return range(int(found[1]), int(found[2] or found[1]) + 1)


def add_options(parser: argparse.ArgumentParser) -> None:
    for name, count, what in (
        ("scenes", 1000, "random scenes to draw of each seed"),
        ("files", 1000, "damaged files to load of each seed"),
        ("first", 0, "number of the first scene and file: `--first 7 --scenes 1` draws scene 7 again"),
    ):
        parser.add_argument(f"--{name}", type=int, default=count, metavar="N", help=f"{what} (default: {count})")
    what = "another seed gives other scenes and files; 1..20: each of these seeds (default: 0)"
    parser.add_argument("--seed", type=seeds, default=range(1), metavar="N", help=what)
    what = "notes in FILE what is done; started again with it, a run goes on where it was stopped"
    parser.add_argument("--log", metavar="FILE", help=what)
    device_option(parser)


def run(arguments: argparse.Namespace) -> int:
    from ...measure.fuzz import campaign

    counts = {name: getattr(arguments, name) for name in ("scenes", "files", "seed", "first", "log")}
    return DONE if campaign.run(arguments.device, **counts) else FAILED
