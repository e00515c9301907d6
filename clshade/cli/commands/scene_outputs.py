"""Where the images of several scenes go: a folder, each under its scene's name."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ...base.atomic_files import shown
from ...errors import InputError

ALONE, FOLDER = "out", "."  # -o unless it is given, for one scene and for several


def output_stems(scenes: Sequence[str], given: str | None) -> tuple[Path | None, list[str]]:
    """The folder that has to be there (None: whatever `given` names), and what `Frame.save` is given for each scene.

    given: -o. For one scene it is the file's name, or a folder where it ends in a slash; for several always a folder.
    Raises InputError where two scenes would have the same file, by names that differ in case alone too: some file
    systems do not tell these apart.
    """
    from ...pipeline.frame import output_paths

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
    """The image's name: `a` of a.obj; `a.jpg.exr` of a.jpg.obj, for a.jpg would ask for another format."""
    from ...pipeline.frame import OTHER_FORMATS

    name = Path(scene).stem
    return f"{name}.exr" if Path(name).suffix.lower() in OTHER_FORMATS else name
