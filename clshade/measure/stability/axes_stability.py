"""`python -m clshade stability --axes`: error and time against stiffness, in every precision and in plain float32."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from ...base import atomic_files, text_tables
from ...base.atomic_files import shown
from ...images import figures
from ...pipeline.opencl.device import open_device
from . import axes_figure, axes_tables
from .axes import AXES, measure


def run(
    device: str | None = None,
    *,
    out: str | Path = "stability",
    formats: Sequence[str] = ("png",),
    stream: TextIO | None = None,
) -> None:
    """Measure all axes, print each table as it is finished, and write the files. formats: of the figure.

    Raises DeviceError and OutputError.
    """
    stream = stream or sys.stdout
    opened = open_device(device)
    folder = text_tables.create_folder(out)
    pictures = [folder / f"axes.{kind}" for kind in formats]
    for path in (*(folder / name for name in axes_tables.FILES), *pictures):
        atomic_files.check(path)  # before minutes of measuring
    about = (opened.title, axes_tables.ABOUT, axes_tables.TIMES)
    print("\n".join(text_tables.wrapped(text, 2) for text in about), file=stream, flush=True)
    found = {}
    for axis in AXES:
        found[axis] = measure(axis, opened)
        print("\n".join(axes_tables.lines(found[axis], axis)), file=stream, flush=True)
    written = axes_tables.write(found, opened.title, folder)
    drawn = axes_figure.draw(found, opened.title)
    for path in pictures:
        figures.save(drawn, path)
    written += pictures
    print("\n".join(["", *(f"wrote {shown(path)}" for path in written)]), file=stream)
