"""`bench --instances`: time and memory of one mesh drawn many times, from one copy and from as many copies."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ...errors import InputError
from ...images import figures
from ..report.study import machine
from .children import run_module
from .scaling import LEAST_MEMORY
from .tables import paths

WAYS = {"one": "one copy", "many": "copies"}
FEWEST = 2  # instances, of which the fixed cost is measured
COLUMNS = (
    *("instances", "drawn from", "triangles", "seen", "load s", "first s", "next ms"),
    *("peak MiB", "bytes an instance", "bytes a triangle", "same bits"),
)
NOTE = (
    "seen: triangles that cover a sample; load s: from the Scene to a Renderer, kernels compiled before; first s, next ms: "
    "the first frame, and the median of those after it, whose camera moves a little; peak MiB: of a process that draws "
    f"nothing else; bytes: that peak beyond the one with {FEWEST} instances, over the instances, or the triangles, that are "
    "more; same bits: image and layer id of both ways"
)


@dataclass(frozen=True)
class InstanceTiming:
    """Figures of one process. way: of WAYS. visible: triangles that cover a sample. digest: of the image and the layer
    id."""

    way: str
    instances: int
    triangles: int
    visible: int
    load_s: float
    first_s: float
    next_ms: float
    peak_mib: float | None
    digest: str


@dataclass(frozen=True)
class ManyInstances:
    """Results of all numbers of instances, the fewest first, each way by turns."""

    machine: str
    timings: tuple[InstanceTiming, ...]

    @property
    def passed(self) -> bool:
        return all(one.digest == many.digest for one, many in self._pairs())

    def _pairs(self) -> list[tuple[InstanceTiming, InstanceTiming]]:
        return list(zip(self.timings[::2], self.timings[1::2], strict=True))

    def more_bytes(self, timing: InstanceTiming) -> float | None:
        """Return the memory beyond that with the fewest instances, drawn the same way; None if it is not known, or within
        the noise."""
        fixed = next(each.peak_mib for each in self.timings if each.way == timing.way)
        if timing.peak_mib is None or fixed is None or timing.peak_mib - fixed < LEAST_MEMORY * fixed:
            return None
        return (timing.peak_mib - fixed) * 2.0**20

    def rows(self) -> list[text_tables.Row]:
        found: list[text_tables.Row] = []
        for pair in self._pairs():
            for each in pair:
                more = self.more_bytes(each)
                per_triangle = each.triangles // each.instances
                an_instance = None if more is None else more / (each.instances - FEWEST)
                found.append(
                    (
                        f"{each.instances:,}",
                        WAYS[each.way],
                        f"{each.triangles:,}",
                        f"{each.visible:,}",
                        digits(each.load_s),
                        digits(each.first_s),
                        digits(each.next_ms),
                        digits(each.peak_mib),
                        "-" if an_instance is None else f"{an_instance:,.0f}",
                        digits(None if an_instance is None else an_instance / per_triangle),
                        "yes" if len({one.digest for one in pair}) == 1 else "NO",
                    )
                )
        return found

    def stats(self) -> dict[str, Any]:
        return asdict(self)


def run(
    counts: Sequence[int],
    *,
    device: str | None = None,
    frames: int,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Draw so many instances each way, each in a process of its own; print a table and write files. Returns True if both
    ways gave the same bits. Raises InputError, OutputError, ClshadeError."""
    stream = stream or sys.stdout
    if frames < 1 or min(counts) <= FEWEST:
        raise InputError(f"bench: --instances, --frames: expected more than {FEWEST} instances and a frame")
    if out is not None:
        for path in paths(out):
            atomic_files.check(path)
    timings = [_draw(way, FEWEST, device, frames) for way in WAYS]  # a warm-up: the kernels may have to be compiled
    timings = [_draw(way, count, device, frames) for count in (FEWEST, *sorted(counts)) for way in WAYS]
    measured = ManyInstances(machine(), tuple(timings))
    lines = text_tables.as_lines(COLUMNS, measured.rows(), left=2)
    print("\n".join([measured.machine, "", *lines, "", text_tables.wrapped(NOTE, 2)]), file=stream)
    if out is not None:
        for path in _write(measured, out):
            print(f"wrote {atomic_files.shown(path)}", file=stream)
    return measured.passed


def _draw(way: str, count: int, device: str | None, frames: int) -> InstanceTiming:
    said = run_module("clshade.measure.bench.instances_apart", way, count, device or "", frames)
    return InstanceTiming(**json.loads(said))


def _write(measured: ManyInstances, prefix: str) -> list[Path]:
    csv, as_json, markdown, figure_path = paths(prefix)
    rows = measured.rows()
    atomic_files.write_bytes(csv, text_tables.as_csv(COLUMNS, rows).encode())
    atomic_files.write_bytes(as_json, (json.dumps(measured.stats(), indent=2) + "\n").encode())
    text = [measured.machine, "", *text_tables.as_markdown(COLUMNS, rows), "", NOTE]
    atomic_files.write_bytes(markdown, ("\n".join(text) + "\n").encode())
    figure = figures.blank(6.5, 3.5)
    for axes, name, label in zip(
        figure.subplots(1, 2), ("peak_mib", "load_s"), ("peak memory, MiB", "load, s"), strict=True
    ):
        for way, color in zip(WAYS, (figures.OURS, figures.MUTED), strict=True):
            own = [each for each in measured.timings if each.way == way]
            values = [getattr(each, name) for each in own]
            if None not in values:
                axes.plot([each.instances for each in own], values, "o-", color=color, label=WAYS[way])
        axes.set(xscale="log", yscale="log", xlabel="instances", ylabel=label)
        axes.legend(frameon=False)
    figure.suptitle(measured.machine, fontsize=8)
    figures.save(figure, figure_path, colors=64)
    return [csv, as_json, markdown, figure_path]
