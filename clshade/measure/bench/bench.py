"""`bench`: frame times, stage by stage, compared with other renderers of the same image."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TextIO, TypeVar

import numpy as np

from ...base import atomic_files, text_tables
from ...base.arrays import Array
from ...errors import ClshadeError, InputError
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import render
from ...scene.camera import Camera
from ...scene.model import Scene
from ..defaults import BENCH_FRAMES, BENCH_TURN
from ..report.study import machine
from ..timing import in_turns, ratio_interval, spread, turns_of
from . import shadow_rays, starting, tables
from .children import draw_apart
from .device_peaks import best, peaks
from .frame_timing import PATH, SECONDS, FrameTiming, cameras, draw, warm_renderer
from .peers import DEFAULT, PEERS, YARDSTICKS, Peer, open_peer
from .peers.agreement import TEXTURED, TOLERANCE, Agreement, agreement
from .results import Compared, Result, Speed
from .scaling import Series, scaling
from .starting import Started, start_up
from .workloads import WORKLOADS, Workload, pick

T = TypeVar("T")
SLOW = 500.0  # ms, of a peer's frame, from which on turns are of single frames
NAMES = (*(each.name for each in WORKLOADS), starting.NAME)


def listing() -> str:
    """Return the list of all workloads and peers with their descriptions."""
    rows = [*((each.name, each.about) for each in WORKLOADS), (starting.NAME, starting.ABOUT)]
    peers = [text_tables.wrapped(f"  {name:<14} {about}", 17) for name, (_, about) in PEERS.items()]
    listed = [text_tables.wrapped(f"{name:<16} {about}", 17) for name, about in rows]
    traced = [f"  {each.name:<14} {each.about}" for each in shadow_rays.WORKLOADS]
    return "\n".join([*listed, "", "peers", *peers, "", "with --shadows", *traced])


def run(
    device: str | None = None,
    *,
    names: Sequence[str] = (),
    peers_named: Sequence[str] = DEFAULT,
    frames: int = BENCH_FRAMES,
    turn: int = BENCH_TURN,
    with_scaling: bool = False,
    targets: bool = False,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure, print the tables, and write the files.

    Returns True if every workload was drawn, and every available peer draws the same images.

    names: workloads; by default all. peers_named: empty for none. frames: number per workload; fewer if they take
    more than frame_timing.SECONDS. with_scaling: also draw growing scenes and images. targets: also
    say what each figure should be at least or at most. out: prefix of the files' names;
    None: no files. Raises InputError, DeviceError and OutputError.
    """
    stream = stream or sys.stdout
    if frames < 1:
        raise InputError(f"bench: --frames: expected a whole number above 0, found {frames}")
    if turn < 1:
        raise InputError(f"bench: --turn: expected a whole number above 0, found {turn}")
    # With --scaling and no names, only scaling is measured.
    chosen = pick(names, NAMES, "workload") if names or not with_scaling else []
    others = (*pick(peers_named, PEERS, "--peers"), *YARDSTICKS) if peers_named else ()
    if out is not None:
        for path in tables.paths(out):
            atomic_files.check(path)
    opened = open_device(device, profiling=True)
    say = partial(print, file=stream, flush=True)
    found = measure_all(opened, chosen, others, frames, with_scaling, say, turn)
    say("\n".join(["", *tables.lines(found, targets=targets)]))
    if out is not None:
        from . import figure

        written = tables.write(found, out, targets=targets)
        figure.plot(found, written[-1], targets=targets)
        say("\n".join(["", *(f"wrote {path}" for path in written)]))
    return found.passed


def measure_all(
    device: Device,
    names: Sequence[str],
    others: Sequence[str],
    frames: int,
    with_scaling: bool,
    say: Callable[[str], object],
    turn: int = BENCH_TURN,
) -> Speed:
    """Measure the named workloads and peers; pass a line to `say` as soon as each is measured."""
    found = Speed(device.title, machine(), peaks(device), ())
    say("\n".join(text_tables.wrapped(fact, 9) for fact in tables.facts(found)))
    results = []
    for workload in (each for each in WORKLOADS if each.name in names):
        results.append(measure(workload, device, others, frames, turn))
        say(tables.progress(results[-1]))

    def draw_point(name: str) -> FrameTiming:
        drawn = draw_apart(name, device.index, frames)
        say(f"{name}: {drawn.ms:.2f} ms")
        return drawn

    started: Started | None = None
    series: tuple[Series, ...] = ()
    failed = []
    try:
        started = start_up(device.index) if starting.NAME in names else None
    except ClshadeError as error:
        failed.append(f"{starting.NAME}: {error}")
    try:
        series = scaling(draw_point, device.memory) if with_scaling else ()
    except ClshadeError as error:
        failed.append(f"scaling: {error}")
    most = best(found.peaks, peaks(device))
    return replace(
        found,
        peaks=most,
        results=tuple(results),
        started=started,
        series=series,
        failed=tuple(failed),
    )


def measure(workload: Workload, device: Device, names: Sequence[str], frames: int, turn: int = BENCH_TURN) -> Result:
    """Measure our frames alone, then in turns with each named peer that can draw the workload."""
    try:
        if workload.apart:
            return Result(workload, draw_apart(workload.name, device.index, frames))
        scene = workload.make()
        drawn = draw(scene, device, frames)
    except ClshadeError as error:
        return Result(workload, None, failed=str(error))
    compared, missing = [], []
    for name in (name for name in workload.peers if name in names):
        try:
            compared.append(compare(name, scene, device, frames, turn))
        except ClshadeError as error:
            missing.append((name, str(error)))
    return Result(workload, drawn, tuple(compared), tuple(missing))


def compare(name: str, scene: Scene, device: Device, frames: int, turn: int = BENCH_TURN) -> Compared:
    """Compare with a peer. Raises MissingPeer if it is not available, another ClshadeError if it or clshade cannot draw
    the scene."""
    peer = open_peer(name, scene)
    try:
        image, first = _timed(peer.draw, scene.camera)
        same = _agreement(peer, image, device)
        path = cameras(scene.camera)

        def next_ms(draw_one: Callable[[Camera], object], number: int) -> float:
            return _timed(draw_one, path[number % PATH])[1]

        with warm_renderer(peer.scene, device) as renderer:
            draws = [partial(next_ms, renderer.render), *([] if peer.once else [partial(next_ms, peer.draw)])]
            usual = first if peer.once else next_ms(peer.draw, 0)  # the first one may upload and compile
            turn = min(turn, frames) if usual < SLOW else 1
            rounds = -(-frames // turn)
            turns = list(zip(*in_turns([turns_of(turn, one) for one in draws], rounds, SECONDS), strict=True))
        times = [[float(np.median(each)) for each in one] for one in turns]
        ours, theirs = times[0], [first] if peer.once else times[1]
        interval = None if peer.once else ratio_interval(theirs, ours)
        return Compared(name, peer.title, spread(ours), spread(theirs), len(ours), same, turn, interval)
    finally:
        peer.close()


def _timed(draw_one: Callable[[Camera], T], camera: Camera) -> tuple[T, float]:
    start = time.perf_counter()
    drawn = draw_one(camera)
    return drawn, (time.perf_counter() - start) * 1e3


def _agreement(peer: Peer, theirs: Array, device: Device) -> Agreement:
    frame = render(peer.scene, device=device, layers=("id",))
    textured = any(mesh.material.texture is not None for mesh in peer.scene.meshes)
    return agreement(frame.rgb, frame["id"], theirs, TEXTURED if textured else TOLERANCE)
