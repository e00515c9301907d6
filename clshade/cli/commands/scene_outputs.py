"""Output names of several scenes, in a folder, each named after its scene; and the file of a scene as it was drawn."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...base.atomic_files import shown
from ...errors import InputError
from .arguments import check_output_file

if TYPE_CHECKING:
    from ...scene.model import Scene

_GLB = ".glb"
ALONE, FOLDER = "out", "."  # defaults of -o for one scene and for several


def output_stems(scenes: Sequence[str], given: str | None) -> tuple[Path | None, list[str]]:
    """Return the output folder, which must exist, or None if `given` names a file, and the name for `Frame.save` of
    each scene.

    given: -o. For one scene it is the file's name, or a folder if it ends in a slash; for several always a folder.
    Raises InputError if two scenes would have the same file. Names that differ only in case count as the same: some
    file systems do not distinguish them.
    """
    from ...pipeline.frame_files import output_paths

    if len(scenes) == 1 and not (given or "").endswith(("/", os.sep)):
        return None, [given or ALONE]
    folder = Path(given or FOLDER)
    stems = [folder / _named_after(scene) for scene in scenes]
    taken: dict[str, str] = {}
    for scene, stem in zip(scenes, stems, strict=True):
        image = output_paths(stem)[0]
        if image.name.lower() in taken:
            raise InputError(
                f"render: SCENE: expected a different name for each file in {shown(folder)}, "
                f"found {shown(taken[image.name.lower()])} and {shown(scene)}, both for {image.name}"
            )
        taken[image.name.lower()] = scene
    return folder, [str(stem) for stem in stems]


def _named_after(scene: str) -> str:
    """Return the image's name: `a` for a.obj; `a.jpg.exr` for a.jpg.obj, as a.jpg would select another format."""
    from ...pipeline.frame_files import OTHER_FORMATS

    name = Path(scene).stem
    return f"{name}.exr" if Path(name).suffix.lower() in (*OTHER_FORMATS, ".npz") else name


def save_scene_option(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--save-scene",
        metavar="FILE",
        help="also write the scene as it is drawn, with its lights, camera and preset: all of it to FILE.json, with large "
        "arrays in a file beside it, or for other programs to FILE.glb",
    )


def check_save_scene(arguments: argparse.Namespace, others: Iterable[Path]) -> None:
    """Refuse, before rendering, a --save-scene that could not be written afterwards. others: files that will be."""
    name = arguments.save_scene
    if name is None:
        return
    from ...scene.formats.scene_json_writer import ENDING, checked_name

    if len(arguments.scenes) > 1:
        raise InputError(f"--save-scene: is for one scene, not for {len(arguments.scenes)}")
    check_output_file(name, arguments.scenes, (ENDING, _GLB), "--save-scene")
    if name.lower().endswith(ENDING):
        checked_name(name, ("render", "--save-scene"))
    if os.path.abspath(name) in map(os.path.abspath, others):
        raise InputError(f"--save-scene: {shown(name)} is the file of the facts of --sheet: choose another one")


def save_scene(scene: Scene, arguments: argparse.Namespace) -> None:
    """Write the scene as it is drawn, if --save-scene asks for it."""
    if arguments.save_scene is None:
        return
    from ...base import console

    if arguments.resolution is not None:
        scene = replace(scene, camera=scene.camera.with_resolution(arguments.resolution))
    if arguments.preset is not None:
        scene = replace(scene, preset=arguments.preset)
    write = scene.to_glb if arguments.save_scene.lower().endswith(_GLB) else scene.to_json
    write(arguments.save_scene)
    console.progress(f"wrote {shown(arguments.save_scene)}")
