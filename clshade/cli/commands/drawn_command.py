"""The command in an image's header: what it draws, without drawing it."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from .arguments import with_values

if TYPE_CHECKING:
    from ...measure.verify.recorded_image import Record
    from ...scene.model import Scene

# By which a camera may differ that was chosen for a scene, on another processor: some roundings.
_CAMERA_ERROR = 2.0**-44


def parsed(command: str | None, given: str | None, folder: Path) -> argparse.Namespace:
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
    if name is None or os.path.exists(name) or not os.path.exists(folder / name):
        return name
    return str(folder / name)


def drawn_scenes(arguments: argparse.Namespace, *, is_drawn_so: bool) -> list[Scene]:
    """Return the scenes that a command draws. is_drawn_so: whether it drew the image; else it may show the file as it is."""
    from .scene_options import lit, placed, read_scene
    from .view_options import views_of

    read = read_scene(arguments, arguments.scenes[0])
    views = [view for view, _ in views_of(placed(*lit(read, arguments), arguments), "view", arguments)]
    return views if is_drawn_so else [read, *views]


def command_faults(scene: Scene, record: Record, arguments: argparse.Namespace) -> list[str]:
    """Return where a record's camera and settings are not those with which a command draws a scene that it made. Of settings
    that --budget and --tolerance choose nothing is known; layers may be more than the command's."""
    from ...pipeline.drawing_record import plain_value
    from ...pipeline.effective_settings import effective_settings
    from .render import render_options

    options = render_options(arguments, scene)
    del options["device"]
    drawn, settings = effective_settings(scene, **options)
    mine, theirs = vars(drawn.camera), vars(record.camera)
    reach = max(np.abs(mine[name]).max() for name in ("eye", "lookat"))
    zeros = {"eye": reach, "lookat": reach, "up": 1.0}  # beside which a number is as good as none
    cameras = [
        name
        for name in mine
        if not np.allclose(mine[name], theirs[name], rtol=_CAMERA_ERROR, atol=_CAMERA_ERROR * zeros.get(name, 0.0))
    ]
    found = {"camera": cameras}
    if arguments.budget is None and arguments.tolerance is None:
        values = {name: (value, getattr(record.settings, name)) for name, value in vars(settings).items()}
        found["settings"] = [
            name for name, (a, b) in values.items() if name != "layers" and plain_value(a) != plain_value(b)
        ]
    return [
        f"{what}: the header differs from its command in {', '.join(names)}" for what, names in found.items() if names
    ]
