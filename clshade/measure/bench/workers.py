"""`bench --workers`: speedup of a turntable drawn by several processes, or by a cluster, over one process."""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ...errors import InputError
from ...images import figures
from ..defaults import CREW_FRAMES
from ..report.study import machine
from ..timing import Spread, in_turns, spread
from .children import run_module
from .tables import paths

RESOLUTION = (320, 240)
ROUNDS = 5
COLUMNS = ("who draws", "seconds", "half of them", "frames/s", "times as fast", "ms a frame", "same files")
NOTE = (
    "seconds: median of whole commands in turns, from the start of Python to the last file; ms a frame: median of what "
    "one takes its worker to draw and write, others working meanwhile; same files: bit for bit as those of one process"
)


@dataclass(frozen=True)
class WorkerTiming:
    """Times of one number of workers. draw_ms: per frame. digest: of all files; "" if they differ between turns."""

    name: str
    seconds: Spread
    draw_ms: float
    digest: str


@dataclass(frozen=True)
class Crews:
    """Results for all numbers of workers, one process first. rounds: number of turns."""

    scene: str
    frames: int
    machine: str
    rounds: int
    crews: tuple[WorkerTiming, ...]

    @property
    def passed(self) -> bool:
        return all(crew.digest == self.crews[0].digest != "" for crew in self.crews)

    def rows(self) -> list[text_tables.Row]:
        one = self.crews[0]
        return [
            (
                crew.name,
                digits(crew.seconds.median),
                f"{digits(crew.seconds.low)} to {digits(crew.seconds.high)}",
                digits(self.frames / crew.seconds.median),
                digits(one.seconds.median / crew.seconds.median),
                digits(crew.draw_ms),
                "yes" if crew.digest == one.digest else "NO",
            )
            for crew in self.crews
        ]

    def title(self) -> str:
        columns, rows = RESOLUTION
        return f"{self.frames} frames of {self.scene}, {columns}x{rows}, {self.rounds} times each"

    def stats(self) -> dict[str, Any]:
        return {**asdict(self), "crews": [{**asdict(crew), "seconds": crew.seconds._asdict()} for crew in self.crews]}


def run(
    counts: Sequence[int],
    *,
    scheduler: str | None = None,
    device: str | None = None,
    frames: int = CREW_FRAMES,
    rounds: int = ROUNDS,
    scene: str = "teapot",
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Draw a turntable with each number of processes, and with a cluster's workers, in turns; print a table and write
    files. Returns True if all wrote the same bits. Raises InputError, OutputError, ClshadeError."""
    stream = stream or sys.stdout
    if frames < 1 or min(counts) < 1:
        raise InputError("bench: --workers, --frames: expected whole numbers above 0")
    if out is not None:
        for path in paths(out):
            atomic_files.check(path)
    given: dict[str, tuple[object, ...]] = {
        f"{count} process{'es' if count > 1 else ''}": ("--workers", count) for count in sorted({1, *counts})
    }
    if scheduler is not None:
        given["Dask cluster"] = ("--scheduler", scheduler)
    further = () if device is None else ("--device", device)
    draws = [partial(_draw, scene, frames, (*options, *further)) for options in given.values()]
    # The first turn is a warm-up: workers may have to compile the kernels.
    turns = in_turns(draws, rounds + 1, float("inf"))[1:]
    crews = []
    for name, results in zip(given, zip(*turns, strict=True), strict=True):
        seconds, draw_ms, found = zip(*results, strict=True)
        crews.append(
            WorkerTiming(name, spread(seconds), spread(draw_ms).median, found[0] if len(set(found)) == 1 else "")
        )
    measured = Crews(scene, frames, machine(), rounds, tuple(crews))
    print(
        "\n".join(
            [
                measured.machine,
                measured.title(),
                "",
                *text_tables.as_lines(COLUMNS, measured.rows()),
                "",
                text_tables.wrapped(NOTE, 2),
            ]
        ),
        file=stream,
    )
    if out is not None:
        for path in _write(measured, out):
            print(f"wrote {atomic_files.shown(path)}", file=stream)
    return measured.passed


def _draw(scene: str, frames: int, options: Sequence[object], turn: int) -> tuple[float, float, str]:
    """Draw in the same way in every turn; return seconds, ms per frame, and the digest of all files."""
    size = ("--resolution", ",".join(map(str, RESOLUTION)))
    with tempfile.TemporaryDirectory(prefix="clshade-") as folder:
        start = time.perf_counter()
        said = run_module(
            *("clshade", "turntable", scene, *size, "--frames", f"1..{frames}", "-o", f"{folder}/####.exr"),
            *("--deterministic", "--quiet", "--json", *options),
        )
        seconds = time.perf_counter() - start
        digest = hashlib.sha256()
        for path in sorted(Path(folder).iterdir()):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return seconds, json.loads(said)["draw_ms"], digest.hexdigest()


def _write(measured: Crews, prefix: str) -> list[Path]:
    csv, as_json, markdown, figure_path = paths(prefix)
    rows = measured.rows()
    atomic_files.write_bytes(csv, text_tables.as_csv(COLUMNS, rows).encode())
    atomic_files.write_bytes(as_json, (json.dumps(measured.stats(), indent=2) + "\n").encode())
    text = [f"{measured.machine}, {measured.title()}", "", *text_tables.as_markdown(COLUMNS, rows), "", NOTE]
    atomic_files.write_bytes(markdown, ("\n".join(text) + "\n").encode())
    figure = figures.blank(6.5, 1.6 + 0.45 * len(rows))
    axes = figure.subplots()
    names = [crew.name for crew in measured.crews]
    low, median, high = (
        [measured.frames / getattr(crew.seconds, part) for crew in measured.crews] for part in ("high", "median", "low")
    )
    reach = [[b - a for a, b in zip(low, median, strict=True)], [b - a for a, b in zip(median, high, strict=True)]]
    axes.barh(names, median, xerr=reach, color=figures.OURS, ecolor=figures.MUTED, capsize=3)
    axes.invert_yaxis()
    axes.set(xlabel="frames a second, starting included (bars: the middle half of the runs)")
    figure.suptitle(f"{measured.machine}\n{measured.title()}", fontsize=8)
    figures.save(figure, figure_path, colors=64)
    return [csv, as_json, markdown, figure_path]
