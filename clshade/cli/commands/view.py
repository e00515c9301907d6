"""`view`: a scene live in the browser, or an HTML page for inspecting images."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...base.console import printable
from ...errors import InputError
from . import DONE
from .arguments import check_output_file, output_name, refuse
from .live_view import is_scene, live_options, run_live
from .saving_options import OUTPUT, saving_options

if TYPE_CHECKING:
    from ...images.image_file import Picture
    from ...images.tonemap import Operator

HTML = (".html", ".htm")
TONEMAP: Operator = "srgb"  # of images


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        metavar="SCENE|FILE",
        nargs="+",
        help="a scene, as for `render`: a file or a built-in one, shown live; or images, each an EXR of any program or a "
        "PNG: several are compared, side by side of a line, in turn, their difference",
    )
    output = parser.add_argument_group(OUTPUT)
    output.add_argument(
        "-o",
        "--output",
        type=output_name,
        metavar="OUT",
        help="of images: the page, which needs no other file and no network (default: FILE.html here, unless there is one); "
        "of a scene: the name of snapshots, OUT-1.exr and OUT-1.png and so on (default: the scene's, here)",
    )
    saving = saving_options(output)
    refused = [*live_options(parser), *(name for name in saving if name not in ("tonemap", "exposure"))]
    parser.set_defaults(only_scenes=refused)


def run(arguments: argparse.Namespace) -> int:
    scenes = [file for file in arguments.files if is_scene(file)]
    if not scenes:
        refuse(arguments, arguments.only_scenes, "is for a scene, not for images")
        return _write_page(arguments)
    if len(arguments.files) > 1:
        found = printable(" and ".join(arguments.files))
        raise InputError(f"view: expected one scene, or images, found {found}")
    run_live(arguments, scenes[0])
    return DONE


def _write_page(arguments: argparse.Namespace) -> int:
    from ...base import atomic_files, console
    from ...view import page

    files: list[str] = arguments.files
    output = arguments.output or os.path.splitext(os.path.basename(files[0]))[0] + ".html"
    check_output_file(output, files if arguments.output else (), HTML)
    if arguments.output is None and os.path.lexists(output):
        name = atomic_files.shown(output)
        raise InputError(f"view: {name} exists already: -o {name} replaces it, -o NAME.html writes another file")
    tonemap: Operator = arguments.tonemap or TONEMAP
    page.checked_settings(tonemap, arguments.exposure)
    images = _pictures(files)
    made = page.view(images, ", ".join(images), tonemap=tonemap, exposure=arguments.exposure)
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
