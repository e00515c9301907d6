"""`report --peers`: other renderers on the same scenes, against an exact answer."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, console, text_tables
from ...base.atomic_files import shown
from ...base.progress_bar import Bar
from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.opencl.device import open_device
from ...pipeline.programs import running_time
from ..report.study import machine
from . import OURS, PEERS, figure, tables
from .measure import Found, measure
from .process import LIMIT
from .scenes import DATA, SCENES, PeerScene, Resolution

FRAMES = 7  # of each renderer and scene


def listing() -> str:
    """Return the list of all renderers and scenes."""
    lines = [f"{name:<16} {each.about}" for name, each in PEERS.items()]
    lines += ["", *(f"{each.name:<16} {each.about}{_file_note(each)}" for each in SCENES)]
    return "\n".join(text_tables.wrapped(line, 17) for line in lines)


def _file_note(scene: PeerScene) -> str:
    return f" ({DATA}/{scene.file})" if scene.file else ""


def run(
    names: Sequence[str] = (),
    device: str | None = None,
    *,
    out: str | Path = "report",
    scenes: Sequence[str] = (),
    resolution: Resolution,
    rounds: int = FRAMES,
    limit: float = LIMIT,
    stream: TextIO | None = None,
) -> bool:
    """Measure the renderers on the scenes, print the table, and write peers.csv, .json, .md and .png.

    Returns True if clshade drew all. names, scenes: by default all; files that are not there are left out then.
    clshade is always drawn. rounds:
    frames of each that are timed. limit: seconds that a renderer has for each answer. Raises InputError, OutputError and
    DeviceError.
    """
    stream = stream or sys.stdout
    if rounds < 1:
        raise InputError(f"report: --frames: expected a whole number above 0, found {rounds}")
    chosen = _scenes(scenes)
    drawing = list(dict.fromkeys([OURS[0], *names])) if names else list(PEERS)
    opened = open_device(device)
    folder = text_tables.create_folder(out)
    files = [folder / f"peers.{extension}" for extension in ("csv", "json", "md", "png")]
    for path in files:
        atomic_files.check(path)
    found: Found = []
    with Bar(len(chosen), "scenes", clock=running_time, hidden=console.quiet() or None) as bar:
        for scene in chosen:
            found += measure(scene, resolution, drawing, opened, rounds, limit)
            bar.advance()
    lines = [*tables.titles(found), *tables.failures(found), *tables.better(found)]
    show(
        "Renderers on {} scenes, {}x{}, {}".format(len(chosen), *resolution, machine()),
        tables.HEADER,
        tables.rows(found),
        tables.NOTE,
        [text_tables.wrapped(line, 2) for line in lines],
        tables.stats(found, resolution, machine()),
        files,
        stream,
        left=2,
    )
    figure.plot(found, files[-1])
    print(f"wrote {shown(files[-1])}", file=stream)
    return tables.passed(found)


def _scenes(names: Sequence[str]) -> list[PeerScene]:
    known = {each.name: each for each in SCENES}
    for name in names:
        if name not in known:
            near = hint(name, known)
            raise InputError(f"report: --only: expected scenes of {', '.join(known)}, found {name!r}{near}")
        if not known[name].available:
            raise InputError(f"report: --only: {name}: expected a file {known[name].file} in the folder {DATA}")
    return [known[name] for name in dict.fromkeys(names)] or [each for each in SCENES if each.available]


def show(
    title: str,
    header: text_tables.Row,
    rows: Sequence[text_tables.Row],
    note: str,
    faults: Sequence[str],
    stats: dict[str, Any],
    files: Sequence[Path],
    stream: TextIO,
    *,
    left: int = 1,
) -> None:
    """Print a table of a benchmark of its own, and write it into the files: CSV, JSON and Markdown, or none.

    left: its first columns, which are aligned to the left.
    """
    lines = text_tables.as_lines(header, rows, left)
    print("\n".join([title, "", *lines, "", text_tables.wrapped(note, 2), *faults]), file=stream)
    markdown = [title, "", *text_tables.as_markdown(header, rows), "", note, *(f"- {fault}" for fault in faults)]
    texts = (text_tables.as_csv(header, rows), json.dumps(stats, indent=2) + "\n", "\n".join(markdown) + "\n")
    for path, text in zip(files, texts, strict=False):
        atomic_files.write_bytes(path, text.encode())
        print(f"wrote {atomic_files.shown(path)}", file=stream)
