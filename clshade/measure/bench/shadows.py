"""`bench --shadows`: rays of shadows and ambient occlusion of real images, traced by our kernel and by Intel Embree in
turns, one thread each."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Protocol, TextIO

import numpy as np

from ...base import atomic_files
from ...base.arrays import Array, Bools, Faces, Floats
from ...errors import InputError
from ...pipeline.opencl.device import Device, open_device
from ...scene.seen_points import triangles
from ..defaults import BENCH_FRAMES
from ..report.study import machine
from ..timing import in_turns
from . import shadow_tables
from .children import run_module
from .exact_shadows import Answer, answers
from .peers import MissingPeer
from .shadow_rays import RADIUS, WORKLOADS, Receivers, ShadowWorkload, occlusion_receivers, receivers
from .shadow_results import Answers, Built, LightTimes, ShadowTimes
from .tables import paths
from .workloads import pick

SECONDS = 20.0  # for the rays of one light
BUILDS = 5  # of each hierarchy, of which the last traces
DISPUTED, AGREED = 400, 40  # rays of a light, at most, that are decided exactly


class Tracer(Protocol):
    """A hierarchy over a mesh.

    title: what it is. seconds: that building took. bytes: of the hierarchy; None if not known.
    """

    @property
    def title(self) -> str: ...

    @property
    def seconds(self) -> float: ...

    @property
    def bytes(self) -> int | None: ...

    def tracing(self, rays: Receivers) -> Callable[[], Array]:
        """Return what traces all rays, whose inputs are where they are read; the call is timed."""

    def shadowed(self, found: Array, rays: Receivers) -> Bools:
        """Return what `tracing` found as (K,) bool, for the lanes that are asked."""


Builder = Callable[[Floats, Faces], Tracer]


def run(
    device: str | None = None,
    *,
    names: Sequence[str] = (),
    rounds: int = BENCH_FRAMES,
    targets: bool = False,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure each workload in a process of its own, print the tables, and write the files.

    Returns True if no answer of ours is proven wrong. names: workloads; by default all. rounds: turns of each light,
    fewer if they take more than SECONDS. targets: also say what each figure should be at least or at most. out: prefix
    of the files' names; None: no files. Raises InputError, OutputError, DeviceError, ChildError.
    """
    stream = stream or sys.stdout
    if rounds < 1:
        raise InputError(f"bench: --frames: expected a whole number above 0, found {rounds}")
    chosen = pick(names, [each.name for each in WORKLOADS], "workload of --shadows")
    if out is not None:
        for path in paths(out):
            atomic_files.check(path)
    opened = open_device(device)
    measured = [
        ShadowTimes.from_stats(
            json.loads(
                run_module(
                    "clshade.measure.bench.shadows_apart", name, opened.index, rounds, POCL_MAX_PTHREAD_COUNT="1"
                )
            )
        )
        for name in chosen
    ]
    found = shadow_tables.ShadowSpeed(opened.title, machine(), tuple(measured))
    print("\n".join(shadow_tables.lines(found, targets=targets)), file=stream)
    if out is not None:
        for path in shadow_tables.write(found, out, targets=targets):
            print(f"wrote {atomic_files.shown(path)}", file=stream)
    return found.passed


def measure(workload: ShadowWorkload, device: Device, ours: Builder, theirs: Builder, rounds: int) -> ShadowTimes:
    """Build both hierarchies, and trace the rays of each light in turns. device: draws the image."""
    scene = workload.make()
    verts, faces = triangles(scene)
    missing = ""
    mine, our_builds = _built(ours, verts, faces)
    try:
        peer, their_builds = _built(theirs, verts, faces)
    except MissingPeer as error:
        peer, missing = None, str(error)
    tracers = [mine] if peer is None else [mine, peer]
    radius = RADIUS * float(np.ptp(verts, axis=0).max())
    of_lights = [each for rays in receivers(scene, device) for each in (rays, rays.to_sphere(radius))]
    every = [*of_lights, occlusion_receivers(scene, device)]
    lights = tuple(_measured(tracers, rays, verts, faces, rounds) for rays in every)
    return ShadowTimes(
        workload.name,
        len(faces),
        our_builds,
        None if peer is None else their_builds,
        lights,
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        missing,
    )


def _built(build: Builder, verts: Floats, faces: Faces) -> tuple[Tracer, Built]:
    """Build several times; the process grows most by the first."""
    first = build(verts, faces)
    tracer, seconds = first, [first.seconds]
    for _ in range(BUILDS - 1):
        tracer = build(verts, faces)
        seconds.append(tracer.seconds)
    size = None if first.bytes is None else first.bytes / len(faces)
    return tracer, Built(tracer.title, tuple(1e3 * each for each in seconds), size)


def _measured(tracers: Sequence[Tracer], rays: Receivers, verts: Floats, faces: Faces, rounds: int) -> LightTimes:
    calls = [each.tracing(rays) for each in tracers]
    found = [each.shadowed(call(), rays) for each, call in zip(tracers, calls, strict=True)]

    def timed(call: Callable[[], Array]) -> Callable[[int], float]:
        def turn(_: int) -> float:
            start = time.perf_counter()
            call()
            return (time.perf_counter() - start) * 1e3

        return turn

    times = list(zip(*in_turns([timed(call) for call in calls], rounds, SECONDS), strict=True))
    decided = _decided(found[0], found[-1], rays, verts, faces)
    theirs = times[1] if len(tracers) > 1 else ()
    return LightTimes(
        () if rays.light is None else tuple(map(float, rays.light)),
        len(found[0]),
        int(found[0].sum()),
        tuple(times[0]),
        tuple(theirs),
        decided,
        rays.many,
    )


def _decided(ours: Bools, theirs: Bools, rays: Receivers, verts: Floats, faces: Faces) -> Answers:
    """Decide rays exactly, evenly spread over the image: those that are disputed, and some of the others."""
    points, owners, ends = rays.one_by_one()

    def of(chosen: Array) -> list[Answer]:
        if rays.ends is None:
            return answers(points[chosen], owners[chosen], ends, verts, faces)
        each = (answers(points[k : k + 1], owners[k : k + 1], ends[k], verts, faces) for k in chosen)
        return [found for (found,) in each]

    def exact(among: Array, most: int) -> tuple[Array, Array]:
        chosen = among[np.unique(np.linspace(0, len(among) - 1, min(most, len(among))).astype(np.int64))]
        return chosen, np.array([each.value for each in of(chosen)])

    disputed = np.flatnonzero(ours != theirs)
    chosen, right = exact(disputed, DISPUTED)
    ties = right == Answer.TIE.value
    dark = right == Answer.DARK.value
    agreed, rightly = exact(np.flatnonzero(ours == theirs), AGREED)
    wrong = (rightly != Answer.TIE.value) & ((rightly == Answer.DARK.value) != ours[agreed])
    return Answers(
        differ=len(disputed),
        checked=len(chosen),
        ties=int(ties.sum()),
        ours_wrong=int((~ties & (dark != ours[chosen])).sum()),
        theirs_wrong=int((~ties & (dark != theirs[chosen])).sum()),
        agreed=len(agreed),
        both_wrong=int(wrong.sum()),
    )
