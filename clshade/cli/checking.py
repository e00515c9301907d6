"""`devices`, `conform` and `verify`: whether devices compute, and images show, what they have to."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
from argparse import ArgumentParser
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..base import console
from ..errors import InputError
from ..measure.defaults import SAMPLE
from . import DONE, FAILED
from .options import Arguments, Device, Json, Option, add_options, output_name, with_values

if TYPE_CHECKING:
    from ..measure.verify.recorded_image import Record, RecordedImage
    from ..scene.model import Scene

# By which a camera may differ that was chosen for a scene, on another processor: some roundings.
_CAMERA_ERROR = 2.0**-44


class Devices:
    json = Option("--json: print a list of all figures as JSON; memory in bytes")


def add_devices_options(parser: ArgumentParser) -> None:
    add_options(parser, Devices)


def run_devices(arguments: Arguments) -> int:
    from ..base import text_tables
    from ..pipeline.opencl import device

    infos = device.list_devices()
    lines = device.format_devices(infos).splitlines()
    arguments.print_result(lambda: list(map(asdict, infos)), lambda: (text_tables.wrapped(line, 5) for line in lines))
    return DONE if any(info.works for info in infos) else FAILED


class Conform:
    only = Option(
        "--only GROUP,...: only these groups of tests: operations, constructs, structs, memory, repeatability, coverage, "
        "scenes",
        lambda text: text.split(","),
        either="what",
    )
    write_golden = Option(
        "--write-golden FILE: instead, write the golden hashes of this device's scenes, if all agree with the oracle",
        output_name,
        either="what",
    )
    out = Option(
        "-o, --out DIR: folder for the card, conform.csv, .json and .md, and for scripts that show failures",
        output_name,
        "conform",
    )


def add_conform_options(parser: ArgumentParser) -> None:
    add_options(parser, Conform, Device)


def run_conform(arguments: Arguments) -> int:
    from ..measure.conform import conform, scenes

    if arguments.write_golden is not None:
        scenes.write_golden(arguments.device, arguments.write_golden)
        return DONE
    return DONE if conform.run(arguments.device, out=arguments.out, only=arguments.only or ()) else FAILED


class Verify:
    image = Option("image OUT.exr: an image that clshade drew; OUT.png beside it is compared too")
    scene = Option("scene SCENE: what it shows: a file, or a built-in scene (default: as the header says)", nargs="?")
    pixels = Option(
        "--pixels N: random pixels to compute again: if none of the default is wrong, fewer than 0.1 %% of all are",
        int,
        SAMPLE,
        either="pixels",
    )
    all = Option("--all: compute every pixel again", either="pixels")
    seed = Option("--seed N: of the sample (default: one that nobody can foresee)", int)


def add_verify_options(parser: ArgumentParser) -> None:
    add_options(parser, Verify, Json)


def run_verify(arguments: Arguments) -> int:
    from ..measure.verify.recorded_image import read_recorded
    from ..measure.verify.verify import verified

    image = read_recorded(arguments.image)
    pixels: int | Literal["all"] = "all" if arguments.all else arguments.pixels
    scenes, faults = _scenes(image, arguments.scene)
    with console.told_when_slow("computing pixels again in float64 ...", after_compiling=True):
        verification = verified(image, scenes, pixels=pixels, seed=arguments.seed)
    verification = replace(verification, faults=(*verification.faults, *faults))
    arguments.print_result(verification.stats, verification.lines)
    return DONE if verification.passed else FAILED


def _scenes(image: RecordedImage, name: str | None) -> tuple[list[Scene], list[str]]:
    """Return the scenes that the image may show, with its camera, and where the record is not what its command says. name:
    a file or a built-in scene, or None: what the header's command says. Raises InputError if there is none, or none that
    can be loaded."""
    from ..measure.verify.verify import builtin_of
    from .outputs import views_of
    from .scene import apply_options, read_scene

    record = image.record
    faults: list[str] = []
    with console.at_level(console.QUIET):
        if record.command is None and name is None:
            scenes = [builtin_of(record)]
        else:
            command = _parsed(record.command, name, image.path.parent)
            read = read_scene(command, command.scenes[0])
            scenes = [view for view, _ in views_of(apply_options(read, command), "view", command)]
            if record.command is None:  # it may show the file as it is
                scenes.insert(0, read)
            else:
                by_scene = [_command_faults(scene, record, command) for scene in scenes]
                faults = min(by_scene, key=len)
                scenes = [scene for scene, mine in zip(scenes, by_scene, strict=True) if len(mine) == len(faults)]
    camera = record.camera
    assert camera is not None
    return [replace(scene, camera=camera) for scene in scenes], faults


# The command in an image's header: what it draws, without drawing it


def _parsed(command: str | None, name: str | None, folder: Path) -> Arguments:
    """Return the options of a command that a header has, whoever wrote it: nothing but scenes is loaded by them.

    folder: where files are looked for that are not in the current one. Raises InputError for another command than `render`.
    """
    from .parser import Parser
    from .render import add_render_options

    try:
        words = shlex.split(command or "clshade render")
    except ValueError:
        words = []
    parser = Parser(prog="verify: the header's command: clshade render", add_help=False)
    add_render_options(parser)
    parser.set_defaults(parser=parser)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            if words[:2] != ["clshade", "render"]:
                parser.error(f"expected clshade render ..., found {command!r}")
            arguments: Arguments = parser.parse_args(with_values(words[2:]))
            if name is None and len(arguments.scenes) != 1:
                parser.error(f"expected one scene, found {len(arguments.scenes)}")
    except SystemExit:
        raise InputError(" ".join(said.getvalue().split())) from None

    def beside(file: str | None) -> str | None:
        """Return a file's name, or that of one beside the image if there is only such a one."""
        if file is None or os.path.exists(file) or not os.path.exists(folder / file):
            return file
        return str(folder / file)

    arguments.scenes = [beside(arguments.scenes[0]) if name is None else name]
    arguments.texture, arguments.environment = beside(arguments.texture), beside(arguments.environment)
    return arguments


def _command_faults(scene: Scene, record: Record, arguments: Arguments) -> list[str]:
    """Return where a record's camera and settings are not those with which a command draws a scene that it made. Of settings
    that --budget and --tolerance choose nothing is known; layers may be more than the command's."""
    import numpy as np

    from ..pipeline.effective_settings import effective_settings
    from ..pipeline.frame_results import plain_value
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
    differences = {"camera": cameras}
    if arguments.budget is None and arguments.tolerance is None:
        values = {name: (value, getattr(record.settings, name)) for name, value in vars(settings).items()}
        differences["settings"] = [
            name for name, (a, b) in values.items() if name != "layers" and plain_value(a) != plain_value(b)
        ]
    return [
        f"{what}: the header differs from its command in {', '.join(names)}"
        for what, names in differences.items()
        if names
    ]
