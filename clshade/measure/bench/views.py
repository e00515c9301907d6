"""`bench --views`: many views of a mesh in one call, in turns with loops that draw them one by one."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from ...base import atomic_files, text_tables
from ...base.text_tables import digits
from ...errors import InputError
from ...images import figures
from ...pipeline.frame import Frame, same_bits
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer
from ...scene import adjust_camera
from ...scene.settings import Layer
from ..report.study import machine
from ..timing import Spread, in_turns, ratio_interval, spread
from .tables import paths
from .workloads import thing

RESOLUTION = (640, 480)
LAYERS: tuple[Layer, ...] = ("Z", "N", "id")
ROUNDS = 9
COLUMNS = ("how", "ms a view", "half of them", "views/s", "times as fast", "95 %")
NOTE = (
    "ms a view: median of rounds in which each way draws all views; times as fast: as the loop that fills the same "
    "arrays, and where all are kept, as the loop that keeps its frames; frames dropped: before the next is drawn"
)

# Each way, and the one that it is compared with.
WAYS = {
    "render, copied into arrays": "render, copied into arrays",
    "render, frames dropped": "render, copied into arrays",
    "render_many into arrays": "render, copied into arrays",
    "render, frames kept": "render, frames kept",
    "render_many, frames kept": "render, frames kept",
}


@dataclass(frozen=True)
class WayTiming:
    """Times of a way, ms a view. ratio, interval: how many times as fast as the way that it is compared with."""

    name: str
    ms: Spread
    ratio: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class ManyViews:
    """Results of all ways. views: number of views. stages: of render_many into arrays, mean ms a view. same: whether all its
    bits are those of the loop."""

    machine: str
    device: str
    triangles: int
    views: int
    rounds: int
    ways: tuple[WayTiming, ...]
    stages: dict[str, float]
    same: bool

    def title(self) -> str:
        columns, rows = RESOLUTION
        what = f"{self.views} views of {self.triangles:,} triangles, {columns}x{rows}, layers {', '.join(LAYERS)}"
        return f"{what}, {self.rounds} rounds"

    def rows(self) -> list[text_tables.Row]:
        return [
            (
                way.name,
                digits(way.ms.median),
                f"{digits(way.ms.low)} to {digits(way.ms.high)}",
                digits(1e3 / way.ms.median),
                digits(way.ratio),
                f"{digits(way.interval[0])} to {digits(way.interval[1])}",
            )
            for way in self.ways
        ]

    def lines(self) -> list[str]:
        stages = ", ".join(f"{name} {digits(ms)}" for name, ms in self.stages.items() if ms > 0.0)
        bits = "the bits of render_many are those of render" if self.same else "the bits of render_many DIFFER"
        return [
            f"{self.machine}, {self.device}",
            self.title(),
            "",
            *text_tables.as_lines(COLUMNS, self.rows()),
            "",
            text_tables.wrapped(f"stages of render_many into arrays, ms a view: {stages}", 2),
            text_tables.wrapped(NOTE, 2),
            bits,
        ]

    def stats(self) -> dict[str, Any]:
        return {**asdict(self), "ways": [{**asdict(way), "ms": way.ms._asdict()} for way in self.ways]}


def run(
    views: int,
    *,
    device: str | None = None,
    rounds: int = ROUNDS,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure so many views, print a table and write files. Returns True if the bits of all ways agree.

    Raises InputError, DeviceError, OutputError.
    """
    stream = stream or sys.stdout
    if views < 1 or rounds < 1:
        raise InputError("bench: --views, --frames: expected whole numbers above 0")
    if out is not None:
        for path in paths(out):
            atomic_files.check(path)
    measured = measure(views, rounds, open_device(device, profiling=True))
    print("\n".join(measured.lines()), file=stream)
    if out is not None:
        for path in _write(measured, out):
            print(f"wrote {atomic_files.shown(path)}", file=stream)
    return measured.same


def measure(views: int, rounds: int, device: Device) -> ManyViews:
    """Draw the views in every way in each round. The first round is a warm-up, and compares all bits."""
    scene = thing(RESOLUTION[1])
    scene = replace(scene, camera=scene.camera.with_resolution(RESOLUTION))
    cameras = [adjust_camera.adjusted(scene.camera, azimuth=360.0 * k / views) for k in range(views)]
    with Renderer(scene, device=device, layers=LAYERS) as renderer:
        frames = renderer.render_many(cameras)
        same = all(same_bits(renderer.render(camera), frame) for camera, frame in zip(cameras, frames, strict=True))
        arrays = frames.arrays

        def dropped() -> None:
            for camera in cameras:
                renderer.render(camera)

        def copied() -> None:
            for k, camera in enumerate(cameras):
                frame = renderer.render(camera)
                for name, array in arrays.items():
                    array[k] = frame.rgba if name == "rgba" else frame[name]

        def kept() -> list[Frame]:
            return [renderer.render(camera) for camera in cameras]

        ways = (
            copied,
            dropped,
            lambda: renderer.render_many(cameras, arrays),
            kept,
            lambda: renderer.render_many(cameras),
        )
        draws = [partial(_timed, way, views) for way in ways]
        times = list(zip(*in_turns(draws, rounds + 1, float("inf"))[1:], strict=True))
        stages = renderer.render_many(cameras, arrays).stats["times_ms"]
    of = dict(zip(WAYS, times, strict=True))
    return ManyViews(
        machine=machine(),
        device=device.title,
        triangles=scene.face_count,
        views=views,
        rounds=rounds,
        ways=tuple(_compared(name, of[name], of[other]) for name, other in WAYS.items()),
        stages={name: ms / views for name, ms in stages.items()},
        same=same,
    )


def _timed(way: Callable[[], object], views: int, turn: int) -> float:
    """Draw in the same way in every turn; return ms a view. Memory is given back outside of that time."""
    start = time.perf_counter()
    drawn = way()
    taken = time.perf_counter() - start
    del drawn
    return 1e3 * taken / views


def _compared(name: str, ours: Sequence[float], others: Sequence[float]) -> WayTiming:
    ms = spread(ours)
    return WayTiming(name, ms, spread(others).median / ms.median, ratio_interval(others, ours))


def _write(measured: ManyViews, prefix: str) -> list[Path]:
    csv, as_json, markdown, figure_path = paths(prefix)
    rows = measured.rows()
    atomic_files.write_bytes(csv, text_tables.as_csv(COLUMNS, rows).encode())
    atomic_files.write_bytes(as_json, (json.dumps(measured.stats(), indent=2) + "\n").encode())
    title = f"{measured.machine}, {measured.title()}"
    text = [title, "", *text_tables.as_markdown(COLUMNS, rows), "", NOTE]
    atomic_files.write_bytes(markdown, ("\n".join(text) + "\n").encode())
    figure = figures.blank(6.5, 1.6 + 0.45 * len(rows))
    axes = figure.subplots()
    low, median, high = ([getattr(way.ms, part) for way in measured.ways] for part in ("low", "median", "high"))
    reach = [[b - a for a, b in zip(low, median, strict=True)], [b - a for a, b in zip(median, high, strict=True)]]
    names = [way.name for way in measured.ways]
    axes.barh(names, median, xerr=reach, color=figures.OURS, ecolor=figures.MUTED, capsize=3)
    axes.invert_yaxis()
    axes.set(xlabel="ms a view (bars: the middle half of the rounds)")
    figure.suptitle(f"{measured.machine}\n{measured.title()}", fontsize=8)
    figures.save(figure, figure_path, colors=64)
    return [csv, as_json, markdown, figure_path]
