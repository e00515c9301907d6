"""`python -m clshade stability SCENE`: where and why a scene amplifies rounding, and what that does to its image."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TextIO

from ...base import text_tables
from ...base.atomic_files import shown
from ...images import exr
from ...pipeline.opencl.device import open_device
from ...scene.model import Scene, Settings
from ..rounding.spread import check_options
from . import scene_figure, scene_tables
from .scene_study import study


def run(
    scene: Scene,
    settings: Settings,
    device: str | None = None,
    *,
    out: str | Path = "stability",
    runs: int | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Study the scene, print the tables and write all files. Returns True if every pixel is within its bounds.

    runs: with random rounding, at least two; None for none at all. Raises DeviceError, InputError and OutputError, and
    ClshadeError if a package for random rounding is missing.
    """
    stream = stream or sys.stdout
    if runs is not None:
        check_options(runs, settings.precision)
    opened = open_device(device)
    folder = text_tables.create_folder(out)
    found = study(scene, settings, opened, runs)
    print("\n".join(scene_tables.lines(found)), file=stream, flush=True)
    written = scene_tables.write(found, folder)
    figures = [("stability.png", scene_figure.plot), ("kappa.png", scene_figure.plot_kappa)]
    if found.rounding is not None:
        figures.append(("digits.png", partial(scene_figure.plot_digits, rounding=found.rounding)))
    for name, draw in figures:
        written.append(folder / name)
        draw(found, written[-1])
    written.append(folder / "stability.exr")
    exr.write(written[-1], found.channels(), metadata=found.frame.metadata())
    print("\n".join(["", *(f"wrote {shown(path)}" for path in written)]), file=stream)
    return found.passed
