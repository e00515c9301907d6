"""`bench`: frame times of scenes, stage by stage, and beside OpenGL's of the same image."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial

import numpy as np

from ...base import console
from ...base.text_tables import wrapped
from ...errors import ClshadeError
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer, render
from ...scene.camera import Camera
from ..results import check_files, files, wrote
from ..timing import FEWEST, in_turns, ratio_interval
from . import tables
from .agreement import TEXTURED, TOLERANCE, Agreement, agreement
from .device_peaks import peaks
from .frame_timing import PATH, SECONDS, Compared, FrameTiming, cameras, time_frames
from .opengl import OpenGL, check_drawn, open_context
from .workloads import WORKLOADS, Workload

TURN = 5  # frames of one renderer in a row, when alternating with another: people draw frame after frame


def listing() -> str:
    """Return the list of all workloads with their descriptions."""
    return "\n".join(wrapped(f"{workload.name:<12} {workload.about}", 13) for workload in WORKLOADS)


def run(
    workloads: Sequence[Workload],
    device: str | None,
    *,
    frames: int,
    against: str | None = None,
    out: str | None = None,
) -> bool:
    """Measure, print the tables, and write the files.

    Returns True if everything was drawn, and OpenGL draws the same images. frames: number per workload; fewer if they take
    more than frame_timing.SECONDS. against: llvmpipe or opengl. out: prefix of the files' names. Raises OutputError,
    DeviceError and MissingOpenGL before it measures, and the first error if no scene could be drawn.
    """
    if out is not None:
        check_files(files(out))
    opened = open_device(device)
    if against is not None:
        open_context(against).release()
    timed, errors = measure_all(opened, workloads, frames, against)
    if not timed:
        raise next(iter(errors.values()))
    results = tables.results(opened.title, peaks(opened), timed, errors)
    print("\n".join(results.lines()))
    if out is not None:
        print("\n".join(["", *wrote(results.write(out))]))
    return not errors and all(measured.compared is None or measured.compared.agreement.same for measured in timed)


def measure_all(
    device: Device, workloads: Sequence[Workload], frames: int, against: str | None
) -> tuple[list[FrameTiming], dict[str, ClshadeError]]:
    """Return what was measured, and the errors by name: one that cannot be measured does not end the others."""
    timed: list[FrameTiming] = []
    errors: dict[str, ClshadeError] = {}
    for workload in workloads:
        try:
            timed.append(measure(workload, device, frames, against))
            said = f"{timed[-1].ms.median:.2f} ms"
        except ClshadeError as error:
            errors[workload.name] = error
            said = f"not drawn: {error}"
        if len(workloads) > 1:
            console.progress(f"{workload.name}: {said}")
    return timed, errors


def measure(workload: Workload, device: Device, frames: int, against: str | None) -> FrameTiming:
    """Measure our frames alone, then in turns with OpenGL's. Raises ClshadeError if one of them cannot draw the scene."""
    with Renderer(workload.make(), device=device, **workload.options) as renderer:
        if against is None:
            return time_frames(workload.name, renderer, frames)
        check_drawn(renderer.scene, renderer.features.used)
        with closing(OpenGL(open_context(against), renderer.scene)) as other:
            return replace(time_frames(workload.name, renderer, frames), compared=compare(other, renderer, frames))


def compare(other: OpenGL, renderer: Renderer, frames: int) -> Compared:
    """Compare with OpenGL: the images, and the times in turns.

    The first frame of a turn is not counted: after the other's frames it finds cold caches and sleeping threads.
    """
    same = _agreement(other, renderer)
    path = cameras(renderer.scene.camera)

    def turn(draw: Callable[[Camera], object], number: int) -> float:
        times = []
        for k in range(TURN + 1):
            start = time.perf_counter()
            draw(path[(number * (TURN + 1) + k) % PATH])
            times.append((time.perf_counter() - start) * 1e3)
        return float(np.median(times[1:]))

    draws = [partial(turn, draw) for draw in (renderer.render, other.draw)]
    turns = in_turns(draws, max(FEWEST, -(-frames // TURN)), SECONDS)
    ours, theirs = zip(*turns, strict=True)
    medians = float(np.median(ours)), float(np.median(theirs))
    interval = ratio_interval(theirs, ours) if same.same else (None, None)
    return Compared(other.title, *medians, len(turns), interval, same)


def _agreement(other: OpenGL, renderer: Renderer) -> Agreement:
    scene, settings = renderer.scene, replace(renderer.settings, layers=("id",))
    frame = render(scene, settings=settings, device=renderer.device)
    tolerance = TEXTURED if "TEXTURED" in renderer.features.used else TOLERANCE
    return agreement(frame.rgb, frame["id"], other.draw(scene.camera), tolerance)
