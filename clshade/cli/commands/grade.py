"""`grade`: a course's image against the right one, and the mistake named."""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import DONE, FAILED
from .arguments import check_output_file, from_0, from_1, output_name, refuse
from .scene_options import camera_options, chosen_settings, load_scene, scene_options

if TYPE_CHECKING:
    from ...measure.grade.folder import Row
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
    group.add_argument(
        "--planted",
        type=from_1,
        metavar="N",
        help="plant N single mistakes at random in several scenes, and print how many are named",
    )
    group.add_argument("--pairs", type=from_0, default=0, metavar="M", help="with --planted: M pairs of mistakes too")
    group.add_argument("--seed", type=from_0, default=0, metavar="S", help="with --planted (default: 0)")


def run(arguments: argparse.Namespace) -> int:
    from ...errors import InputError

    _refuse_unused(arguments)
    if arguments.list:
        from ...measure.grade.mistakes import MISTAKES

        print("\n".join(f"{each.name}: {each.advice}" for each in MISTAKES))
        return DONE
    if arguments.planted is not None:
        from ...measure.grade import planted

        return DONE if planted.run(arguments.planted, arguments.pairs, arguments.seed) else FAILED
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


def _refuse_unused(arguments: argparse.Namespace) -> None:
    """Raise InputError for arguments that would have no effect."""
    from ...errors import InputError

    refuse(arguments, ("look", "ground"), "the right image is drawn as --preset says")
    if not arguments.list and arguments.planted is None:
        refuse(arguments, ("pairs", "seed"), "needs --planted N")
        return
    mode = "list" if arguments.list else "planted"
    if arguments.image is not None:
        raise InputError(f"IMAGE: expected none with --{mode}, found {arguments.image!r}")
    why = f"cannot go with --{mode}, which reads no image"
    known = vars(arguments).keys() & vars(arguments.parser.parse_args([])).keys()
    unused = known - {"list", "planted", "pairs", "seed", "image", "scene"}
    refuse(arguments, sorted(unused), why)
    if arguments.list:
        refuse(arguments, ("planted", "pairs", "seed"), why)


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
    from ...base import atomic_files, console
    from ...measure.grade import grade, tables

    found = grade.grade(arguments.image, right)
    print(json.dumps(found.facts(), indent=2) if arguments.json else "\n".join(tables.lines(found.facts())))
    if arguments.output:
        from ...images import figures
        from ...measure.grade import pictures

        figures.save(pictures.draw(found, right), arguments.output)
        console.progress(f"wrote {atomic_files.shown(arguments.output)}")
    return DONE if found.right else FAILED


def _folder(arguments: argparse.Namespace, right: Right) -> int:
    from ...base import atomic_files, console
    from ...base.progress_bar import Bar
    from ...errors import InputError
    from ...measure.grade import folder, tables

    paths = folder.submissions(arguments.image)
    if not paths:
        raise InputError(f"{atomic_files.shown(arguments.image)}: expected images in the folder, found none")
    found = []
    with Bar(len(paths), "grade", clock=time.time) as bar:
        for each in folder.grade_all(paths, right):
            found.append(each)
            bar.advance()
    names = [os.path.relpath(path, arguments.image) for path in paths]
    if arguments.json:
        print(json.dumps([_facts(path, each) for path, each in zip(paths, found, strict=True)], indent=2))
    else:
        print("\n".join(tables.summary(names, found)))
    if arguments.output:
        atomic_files.write_bytes(arguments.output, tables.csv(names, found).encode())
    if arguments.html:
        from ...measure.grade import page

        page.write(names, found, right.drawing.scene.name, arguments.html)
    for path in (arguments.output, arguments.html):
        if path:
            console.progress(f"wrote {atomic_files.shown(path)}")
    return FAILED if any(isinstance(each, str) for each in found) else DONE


def _facts(path: Path, found: Row | str) -> dict[str, Any]:
    """Return the results of a submission for programs."""
    from ...base.atomic_files import shown

    return {"image": shown(path), "error": found} if isinstance(found, str) else found.facts
