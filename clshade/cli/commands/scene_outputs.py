"""Output names of several scenes: in a folder, each named after its scene."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ...base.atomic_files import shown
from ...errors import InputError

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
