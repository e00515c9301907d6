"""`view`: an HTML page for inspecting images."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import DONE
from .arguments import check_output_file, output_name

if TYPE_CHECKING:
    from ...images.image_file import Picture

HTML = (".html", ".htm")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        metavar="FILE",
        nargs="+",
        help="an EXR, of any program, or a PNG; several are compared: side by side of a line, in turn, their difference",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=output_name,
        metavar="HTML",
        help="the page, which needs no other file and no network (default: FILE.html here)",
    )
    parser.add_argument(
        "--tonemap", default="srgb", metavar="NAME", help="none, srgb, reinhard, hable or aces at first (default: srgb)"
    )
    parser.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="exposure at first (default: 0)")


def run(arguments: argparse.Namespace) -> int:
    return _write_page(arguments)


def _write_page(arguments: argparse.Namespace) -> int:
    from ...base import atomic_files, console
    from ...view import page

    files: list[str] = arguments.files
    output = arguments.output or os.path.splitext(os.path.basename(files[0]))[0] + ".html"
    check_output_file(output, files if arguments.output else (), HTML)
    page.checked_settings(arguments.tonemap, arguments.exposure)
    images = _pictures(files)
    made = page.view(images, ", ".join(images), tonemap=arguments.tonemap, exposure=arguments.exposure)
    size = made.save(output)
    console.progress(f"wrote {atomic_files.shown(output)} ({size / 1e6:.1f} MB)")
    return DONE


def _pictures(files: Sequence[str]) -> dict[str, Picture]:
    """Read files, by name: without the folder where that tells them apart."""
    from ...images.image_file import read_picture

    bases = [os.path.basename(file) for file in files]
    found: dict[str, Picture] = {}
    for file, base in zip(files, bases, strict=True):
        name = base if bases.count(base) == 1 else file
        number = 2
        while name in found:  # the same file again
            name, number = f"{file} ({number})", number + 1
        found[name] = read_picture(file)
    return found
