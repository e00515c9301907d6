"""`bench`: frame times of scenes, stage by stage, and beside OpenGL's of the same image."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...base import console
from ...base.text_tables import wrapped
from ...errors import ClshadeError
from ...images import figures
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer, render
from ...scene.camera import Camera
from ..results import check_files, files, wrote
from ..timing import FEWEST, in_turns, ratio_interval, spread, turns_of
from . import tables
from .agreement import TEXTURED, TOLERANCE, Agreement, agreement
from .device_peaks import Peaks, peaks
from .frame_timing import PATH, SECONDS, cameras, time_frames, warm_renderer
from .opengl import OpenGL, check_drawn, open_context
from .starting import ABOUT, NAME, Start, start_up
from .tables import Compared, Timed
from .workloads import WORKLOADS, Workload

TURN = 5  # frames of one renderer in a row, when alternating with another: people draw frame after frame


def listing() -> str:
    """Return the list of all workloads with their descriptions."""
    rows = [*((each.name, each.about) for each in WORKLOADS), (NAME, ABOUT)]
    return "\n".join(wrapped(f"{name:<12} {about}", 13) for name, about in rows)


def run(
    workloads: Sequence[Workload],
    device: str | None,
    *,
    frames: int,
    against: str | None = None,
    with_start: bool = False,
    out: str | None = None,
) -> bool:
    """Measure, print the tables, and write the files.

    Returns True if everything was drawn, and OpenGL draws the same images. frames: number per workload; fewer if they take
    more than frame_timing.SECONDS. against: llvmpipe or opengl. with_start: also measure start-up times. out: prefix of the
    files' names. Raises OutputError, DeviceError and MissingOpenGL before it measures, and the first error if nothing could
    be measured.
    """
    if out is not None:
        check_files(files(out, "png"))
    opened = open_device(device, profiling=True)
    if against is not None:
        open_context(against).release()
    before = peaks(opened)
    timed, starts, errors = measure_all(opened, workloads, frames, against, with_start)
    if not (timed or starts):
        raise next(iter(errors.values()))
    rates = Peaks(*map(max, zip(before, peaks(opened), strict=True)))  # other load can only lower them
    found = tables.results(opened.title, rates, timed, starts, errors)
    print("\n".join(found.lines()))
    if out is not None:
        written = found.write(out)
        if timed:
            written.append(files(out, "png")[-1])
            plot(timed, opened.title, written[-1])
        print("\n".join(["", *wrote(written)]))
    return not errors and all(each.compared is None or each.compared.agreement.same for each in timed)


def measure_all(
    device: Device, workloads: Sequence[Workload], frames: int, against: str | None, with_start: bool
) -> tuple[list[Timed], list[Start], dict[str, ClshadeError]]:
    """Return what was measured, and the errors by name: one that cannot be measured does not end the others."""
    timed: list[Timed] = []
    starts: list[Start] = []
    errors: dict[str, ClshadeError] = {}
    for workload in workloads:
        try:
            timed.append(measure(workload, device, frames, against))
            said = str(timed[-1])
        except ClshadeError as error:
            errors[workload.name] = error
            said = f"{workload.name}: not drawn: {error}"
        if len(workloads) > 1:
            console.progress(said)
    if with_start:
        try:
            starts = start_up(device.index)
        except ClshadeError as error:
            errors[NAME] = error
    return timed, starts, errors


def measure(workload: Workload, device: Device, frames: int, against: str | None) -> Timed:
    """Measure our frames alone, then in turns with OpenGL's. Raises ClshadeError if one of them cannot draw the scene."""
    with warm_renderer(workload.make(), device, workload.options) as renderer:
        if against is None:
            return Timed(workload.name, time_frames(renderer, frames))
        check_drawn(renderer.scene, renderer.features.used)
        with closing(OpenGL(open_context(against), renderer.scene)) as other:
            return Timed(workload.name, time_frames(renderer, frames), compare(other, renderer, frames))


def compare(other: OpenGL, renderer: Renderer, frames: int) -> Compared:
    """Compare with OpenGL: the images, and the times in turns."""
    same = _agreement(other, renderer)
    path = cameras(renderer.scene.camera)

    def next_ms(draw: Callable[[Camera], object], number: int) -> float:
        start = time.perf_counter()
        draw(path[number % PATH])
        return (time.perf_counter() - start) * 1e3

    draws = [turns_of(TURN, partial(next_ms, draw)) for draw in (renderer.render, other.draw)]
    turns = in_turns(draws, max(FEWEST, -(-frames // TURN)), SECONDS)
    ours, theirs = ([float(np.median(ms)) for ms in one] for one in zip(*turns, strict=True))
    return Compared(other.title, spread(ours), spread(theirs), len(turns), ratio_interval(theirs, ours), same)


def _agreement(other: OpenGL, renderer: Renderer) -> Agreement:
    scene, settings = renderer.scene, replace(renderer.settings, layers=("id",))
    frame = render(scene, settings=settings, device=renderer.device)
    textured = any(mesh.material.texture is not None for mesh in scene.meshes)
    return agreement(frame.rgb, frame["id"], other.draw(scene.camera), TEXTURED if textured else TOLERANCE)


def plot(timed: Sequence[Timed], title: str, path: Path) -> None:
    """Draw and save a bar for each scene: how many times as fast as OpenGL, or the time of a frame. Raises OutputError."""
    ratios = [each.compared.ratio or 0.0 for each in timed if each.compared]
    titles = dict.fromkeys([title, *(each.compared.title for each in timed if each.compared)])
    figure = figures.blank(8.0, 1.5 + 0.3 * len(timed))
    axes = figure.subplots()
    axes.barh([each.name for each in timed], ratios or [each.drawn.ms for each in timed], color=figures.OURS)
    axes.invert_yaxis()
    axes.set(xlabel="times as fast as OpenGL" if ratios else "ms a frame")
    axes.grid(True, axis="x", alpha=0.2)
    figure.suptitle("\n".join(titles), fontsize=8)
    figures.save(figure, path, colors=64)
