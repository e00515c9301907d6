"""`verify`: random pixels of an image computed again by the oracle."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from ...measure.defaults import SAMPLE
from . import DONE, FAILED

if TYPE_CHECKING:
    from ...measure.verify.recorded_image import RecordedImage
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
    parser.add_argument("--json", action="store_true", help="print all figures as JSON")


def run(arguments: argparse.Namespace) -> int:
    from ...base import console
    from ...measure.verify.recorded_image import read_recorded
    from ...measure.verify.verify import verified

    image = read_recorded(arguments.image)
    pixels: int | Literal["all"] = "all" if arguments.all else arguments.pixels
    scenes, faults = _scenes(image, arguments.scene)
    with console.told_when_slow("computing pixels again in float64 ...", after_compiling=True):
        found = verified(image, scenes, pixels=pixels, seed=arguments.seed)
    found = replace(found, faults=(*found.faults, *faults))
    if arguments.json:
        import json

        print(json.dumps(found.stats(), indent=2))
    else:
        print("\n".join(found.lines()))
    return DONE if found.passed else FAILED


def _scenes(image: RecordedImage, given: str | None) -> tuple[list[Scene], list[str]]:
    """Return the scenes that the image may show, with its camera, and where the record is not what its command says. given:
    a file or a built-in scene, or None: what the header's command says. Raises InputError if there is none, or none that
    can be loaded."""
    from ...base import console
    from ...measure.verify.verify import builtin_of
    from .drawn_command import command_faults, drawn_scenes, parsed

    record = image.record
    faults: list[str] = []
    with console.at_level(console.QUIET):
        if record.command is None and given is None:
            found = [builtin_of(record)]
        else:
            command = parsed(record.command, given, image.path.parent)
            found = drawn_scenes(command, is_drawn_so=record.command is not None)
            if record.command is not None:
                each = [command_faults(scene, record, command) for scene in found]
                faults = min(each, key=len)
                found = [scene for scene, mine in zip(found, each, strict=True) if len(mine) == len(faults)]
    camera = record.camera
    assert camera is not None
    return [replace(scene, camera=camera) for scene in found], faults
