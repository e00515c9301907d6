"""`verify`: random pixels of an image computed again, without OpenCL."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ...errors import InputError
from ...measure.defaults import SAMPLE
from . import DONE, FAILED
from .arguments import refuse, with_values

if TYPE_CHECKING:
    from ...measure.verify.planted import Planted
    from ...measure.verify.recorded_image import RecordedImage
    from ...measure.verify.verification import Verification
    from ...scene.model import Scene


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "image", metavar="OUT.exr", help="an image that clshade drew; OUT.png beside it is compared too"
    )
    parser.add_argument(
        "scene",
        nargs="?",
        metavar="SCENE",
        help="what it shows: a file, or a built-in scene (default: as the header says)",
    )
    either = parser.add_mutually_exclusive_group()
    what = f"random pixels to compute again (default: {SAMPLE}: if none is wrong, fewer than 0.1 %% of all are)"
    either.add_argument("--pixels", type=int, default=SAMPLE, metavar="N", help=what)
    either.add_argument("--all", action="store_true", help="compute every pixel again")
    parser.add_argument("--seed", type=int, metavar="N", help="of the sample (default: one that nobody can foresee)")
    what = "change the image, its header or its scene in N ways, and see whether each change is found"
    parser.add_argument("--planted", type=int, metavar="N", help=what)
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")


def run(arguments: argparse.Namespace) -> int:
    from ...measure.verify.recorded_image import read_recorded
    from ...measure.verify.verify import verified

    image = read_recorded(arguments.image)
    pixels: int | Literal["all"] = "all" if arguments.all else arguments.pixels
    scenes = _scenes(image, arguments.scene)
    found: Verification | Planted
    if arguments.planted is not None:
        from ...measure.verify.planted import plant

        refuse(
            arguments,
            ("all",),
            "cannot go with --planted, which looks at all pixels where a sample has missed a change",
        )
        found = plant(image, scenes[0], arguments.planted, pixels=arguments.pixels, seed=arguments.seed or 0)
    else:
        found = verified(image, scenes, pixels=pixels, seed=arguments.seed)
    if arguments.json:
        import json

        print(json.dumps(found.stats(), indent=2))
    else:
        print("\n".join(found.lines()))
    return DONE if found.passed else FAILED


def _scenes(image: RecordedImage, given: str | None) -> list[Scene]:
    """Return the scenes that the image may show, with its camera. given: a file or a built-in scene, or None: what the
    header's command says. Raises InputError if there is none, or none that can be loaded."""
    from ...base import console
    from ...measure.verify.verify import builtin_of

    record = image.record
    with console.at_level(console.QUIET):
        if record.command is None and given is None:
            found = [builtin_of(record)]
        else:
            found = _loaded(_parsed(record.command, given, image.path.parent), is_drawn_so=record.command is not None)
    camera = record.camera
    assert camera is not None
    return [replace(scene, camera=camera) for scene in found]


def _parsed(command: str | None, given: str | None, folder: Path) -> argparse.Namespace:
    """Return the options of a command that a header has, whoever wrote it: nothing but scenes is loaded by them.

    folder: where files are looked for that are not in the current one. Raises InputError for another command than `render`.
    """
    from . import render
    from .parser import Parser

    try:
        words = shlex.split(command or "clshade render")
    except ValueError:
        words = []
    parser = Parser(prog="verify: the header's command: clshade render", add_help=False)
    render.add_options(parser)
    parser.set_defaults(parser=parser)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            if words[:2] != ["clshade", "render"]:
                parser.error(f"expected clshade render ..., found {command!r}")
            arguments: argparse.Namespace = parser.parse_args(with_values(words[2:]))
            if given is None and len(arguments.scenes) != 1:
                parser.error(f"expected one scene, found {len(arguments.scenes)}")
    except SystemExit:
        raise InputError(" ".join(said.getvalue().split())) from None
    arguments.scenes = [_beside(arguments.scenes[0], folder) if given is None else given]
    for name in ("texture", "environment"):
        setattr(arguments, name, _beside(getattr(arguments, name), folder))
    return arguments


def _beside(name: str | None, folder: Path) -> str | None:
    """Return a file's name, or that of one beside the image if there is only such a one."""
    is_beside = name is not None and not os.path.exists(name) and (folder / name).exists()
    return str(folder / name) if is_beside and name is not None else name


def _loaded(arguments: argparse.Namespace, *, is_drawn_so: bool) -> list[Scene]:
    """Return the scenes that a command draws. is_drawn_so: whether it drew the image; else it may show the file as it is.
    Raises InputError for one that only a device can complete."""
    from .scene_options import lit, placed, read_scene, wants_contact_shadow
    from .view_options import views_of

    read = read_scene(arguments, arguments.scenes[0])
    scene, look = lit(read, arguments)
    if wants_contact_shadow(scene, look, arguments):
        if is_drawn_so:
            raise InputError(
                "verify: SCENE: cannot be completed without OpenCL, which computes the contact shadow of the look studio: "
                "clshade.verify takes the Scene that was drawn; images with --no-ground or --look plain have none"
            )
        return [read]
    shown = placed(scene, look, arguments)
    views = [view for view, _ in views_of(shown, "view", arguments)]
    return views if is_drawn_so else [read, *views]
