"""`grade`: a course's image against the right one, and the mistake named."""

from __future__ import annotations

import argparse
import os
import time
from typing import TYPE_CHECKING

from . import DONE, FAILED
from .arguments import check_output_file, output_name, refuse
from .scene_options import camera_options, chosen_settings, load_scene, scene_options

if TYPE_CHECKING:
    from ...measure.grade.grade import Right


def add_options(parser: argparse.ArgumentParser) -> None:
    from ...scene.settings import PRESETS

    parser.add_argument(
        "image",
        nargs="?",
        metavar="IMAGE",
        help="a PNG or other lossless 8-bit image of linear values, round(255*x), an EXR or .npz of linear floats, row 0 at "
        "the top; an .npy as the course's functions return images, row 0 at the bottom; or a folder of them",
    )
    scene_options(parser, default=None, size="the scene's own")
    camera_options(parser)
    group = parser.add_argument_group("grade: what is right, and what is written")
    group.add_argument("--preset", choices=PRESETS[:2], help="how the right image is drawn (default: course)")
    group.add_argument("--shader", choices=("gouraud", "phong", "nolight"), help="of the right image (default: phong)")
    group.add_argument(
        "-o", "--output", type=output_name, metavar="FILE", help="a picture of the comparison, .png; of a folder a .csv"
    )
    group.add_argument(
        "--html", type=output_name, metavar="FILE", help="of a folder: a page with a picture of each image"
    )
    group.add_argument("--json", action="store_true", help="print all figures as JSON")
    group.add_argument("--list", action="store_true", help="name the mistakes that are modeled")


def run(arguments: argparse.Namespace) -> int:
    from ...errors import InputError

    refuse(arguments, ("look", "ground"), "the right image is drawn as --preset says")
    if arguments.list:
        from ...measure.grade.mistakes import MISTAKES

        if arguments.image is not None:
            raise InputError(f"IMAGE: expected none with --list, found {arguments.image!r}")
        unused = vars(arguments).keys() & vars(arguments.parser.parse_args([])).keys() - {"list", "image"}
        refuse(arguments, sorted(unused), "cannot go with --list, which reads no image")
        print("\n".join(f"{mistake.name}: {mistake.advice}" for mistake in MISTAKES))
        return DONE
    for name in ("image", "scene"):
        if getattr(arguments, name) is None:
            raise InputError(f"{name.upper()}: expected `grade IMAGE SCENE`, found none")
    folder = os.path.isdir(arguments.image)
    if arguments.output:
        check_output_file(arguments.output, (arguments.image,), (".csv",) if folder else (".png",))
    if not folder:
        refuse(arguments, ("html",), "needs a folder of images")
        return _single(arguments, _right(arguments))
    if arguments.html:
        check_output_file(arguments.html, (), (".html",), "--html")
    return _folder(arguments, _right(arguments))


def _right(arguments: argparse.Namespace) -> Right:
    """Draw the right image of the command line's scene."""
    from dataclasses import replace

    from ...measure.grade.grade import right_of
    from ...scene.model import Settings

    scene = load_scene(arguments)
    if arguments.resolution:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    return right_of(scene, Settings.from_preset(arguments.preset or "course", **chosen_settings(arguments)))


def _single(arguments: argparse.Namespace, right: Right) -> int:
    from ...base import console
    from ...measure.grade import grade, tables
    from ...measure.results import wrote

    found = grade.grade(arguments.image, right)
    facts = found.facts()
    print(tables.results([facts], right.name).json() if arguments.json else "\n".join(tables.lines(facts)))
    if arguments.output:
        from ...images import figures
        from ...measure.grade import pictures

        figures.save(pictures.draw(found, right), arguments.output)
        console.progress(wrote([arguments.output])[0])
    return DONE if found.right else FAILED


def _folder(arguments: argparse.Namespace, right: Right) -> int:
    from ...base import atomic_files, console
    from ...base.progress_bar import Bar
    from ...errors import InputError
    from ...measure.grade import folder, tables
    from ...measure.results import wrote

    names = folder.submissions(arguments.image)
    if not names:
        raise InputError(f"{atomic_files.shown(arguments.image)}: expected images in the folder, found none")
    rows = []
    with Bar(len(names), "grade", clock=time.time) as bar:
        for row in folder.grade_all(arguments.image, names, right, drawn=bool(arguments.html)):
            rows.append(row)
            bar.advance()
    submissions = [row.facts for row in rows]
    found = tables.results(submissions, right.name)
    print(found.json() if arguments.json else "\n".join(tables.summary(submissions)))
    if arguments.output:
        atomic_files.write_bytes(arguments.output, tables.csv(submissions).encode())
    if arguments.html:
        atomic_files.write_bytes(arguments.html, tables.page(rows, right.name))
    for line in wrote(path for path in (arguments.output, arguments.html) if path):
        console.progress(line)
    return FAILED if any("error" in facts for facts in submissions) else DONE
