"""`bench --limits`: what `--budget` and `--tolerance` are asked for against what they get."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from statistics import median
from typing import Any, Literal, TextIO

import numpy as np

from ...base import atomic_files, console, text_tables
from ...base.text_tables import digits
from ...errors import InputError
from ...images.metrics import rmse
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ...scene.model import Scene
from ..report.auto_settings import select, selectable
from ..report.measure import frame_times
from ..report.reference_image import reference
from . import tables
from .workloads import knot, pick, thing

Kind = Literal["budget", "tolerance"]
RESOLUTION = (400, 300)  # above 65,536 pixels: errors are estimated from windows
LEVELS: dict[Kind, tuple[float, ...]] = {
    "budget": (4.0, 8.0, 16.0, 33.0, 100.0),  # milliseconds
    "tolerance": (0.03, 0.01, 0.005, 0.003, 0.001),  # RMSE
}
RUNS = 2  # of each choice, which should agree
FRAMES, SECONDS = 15, 3.0  # of each variant of a scene, in turns
NEAR, SHARE = 1.1, 0.9  # what is chosen is at most NEAR times the limit in SHARE of all cases,
FAR = 2.0  # and in none more than FAR times
SCENES: dict[str, tuple[Callable[[], Scene], dict[str, Any]]] = {
    "teapot": (lambda: builtin("teapot"), {}),
    "torus_knot": (lambda: builtin("torus_knot", triangles=20_000), {}),
    "fine_knot": (lambda: knot(200_000), {}),
    "icosphere": (lambda: builtin("icosphere"), {}),
    "quads": (lambda: builtin("quads", count=8), {}),
    "box_room": (lambda: builtin("box_room"), {}),
    "course": (lambda: builtin("course"), {}),
    "object": (lambda: thing(300), {}),
    "textured": (lambda: thing(300, textured=True), {}),
    "lights": (lambda: thing(300, lights=16), {}),
    "shadows": (lambda: builtin("teapot"), {"shadows": True}),
    "pbr": (lambda: builtin("torus_knot", triangles=20_000), {"shader": "pbr"}),
}
NOTE = (
    "Asked: the limit. Got: the time or the RMSE of what was chosen, measured anew: times at once, errors in all pixels "
    "against the converged image, of which `--tolerance` looks at windows. Best: the least error within the budget, or the "
    "least time within the tolerance, of all variants."
)
HEADER = ("scene", "limit", "asked", "chosen", "got", "of asked", "error or time", "of the best")


@dataclass(frozen=True)
class Outcome:
    """What was got for one limit.

    chosen: the name of the variant in the first run, "" if the limit was refused. got: what is limited, of that variant, or
    the least of all if none was chosen; other: its error for a budget, its time for a tolerance. best: the least of that
    among variants that keep the limit; None if none does. same: whether all runs chose alike.
    """

    scene: str
    kind: Kind
    asked: float
    chosen: str
    got: float
    other: float | None
    best: float | None
    same: bool

    @property
    def ratio(self) -> float:
        """Got, in parts of what was asked for."""
        return self.got / self.asked

    @property
    def is_wrong_refusal(self) -> bool:
        """Whether it was refused although something keeps it by more than measuring is off."""
        return not self.chosen and self.ratio * NEAR < 1.0

    def row(self) -> text_tables.Row:
        limit = f"{digits(self.asked)} ms" if self.kind == "budget" else digits(self.asked)
        of_best = "-" if self.other is None or not self.best else digits(self.other / self.best)
        chosen = self.chosen or "refused"
        return (self.scene, self.kind, limit, chosen, digits(self.got), digits(self.ratio), digits(self.other), of_best)


@dataclass(frozen=True)
class Truth:
    """What all variants of a scene cost, milliseconds and RMSE, by name."""

    ms: dict[str, float]
    error: dict[str, float]

    def outcome(self, scene: str, kind: Kind, asked: float, choices: Sequence[str], ms: float | None = None) -> Outcome:
        """Return the outcome of a limit for which these variants were chosen, "" for refusals. ms: of the first one's frame,
        measured at once, because other programs may change times later."""
        limited, other = (self.ms, self.error) if kind == "budget" else (self.error, self.ms)
        chosen = choices[0]
        got = limited[chosen] if chosen else min(limited.values())
        got = ms if ms is not None and kind == "budget" else got
        best = min((other[name] for name, value in limited.items() if value <= asked), default=None)
        same = len(set(choices)) == 1
        return Outcome(scene, kind, asked, chosen, got, other[chosen] if chosen else None, best, same)


def truth(name: str, device: Device, frames: int) -> Truth:
    """Measure all variants that may be chosen for a scene."""
    make, fields = SCENES[name]
    scene, base, fixed, variants = selectable(make(), device, resolution=RESOLUTION, **fields)
    converged = reference(scene, base, device, fixed)
    errors = {}
    with ExitStack() as opened:
        renderers = []
        for each in variants:
            renderers.append(opened.enter_context(Renderer(scene, settings=each.settings(base), device=device)))
            errors[each.shown_name] = rmse(np.asarray(renderers[-1].render().rgb), converged.rgb)
        times = frame_times(renderers, frames, SECONDS)
    return Truth({each.shown_name: median(ms) for each, ms in zip(variants, times, strict=True)}, errors)


def outcomes(name: str, device: Device, frames: int) -> Iterator[Outcome]:
    """Yield the outcomes of all limits for a scene."""
    make, fields = SCENES[name]
    scene = make()
    known = truth(name, device, frames)
    for kind, asked in LEVELS.items():
        for limit in asked:
            found = [_chosen(scene, device, {kind: limit}, fields, frames) for _ in range(RUNS)]
            yield known.outcome(name, kind, limit, [chosen for chosen, _ in found], found[0][1])


def _chosen(
    scene: Scene, device: Device, limit: dict[str, float], fields: dict[str, Any], frames: int
) -> tuple[str, float | None]:
    """Return the name of the variant chosen for a limit and the milliseconds of its frame; "" and None if it is refused."""
    limits: dict[str, Any] = {**limit, **fields}
    try:
        chosen = select(scene, device=device, resolution=RESOLUTION, **limits)
    except InputError:
        return "", None
    with Renderer(scene, settings=chosen.settings, resolution=RESOLUTION, device=device) as renderer:
        renderer.render()
        return chosen.used.variant.shown_name, median(frame_times([renderer], frames, SECONDS)[0])


def statements(found: Sequence[Outcome]) -> tuple[list[str], bool]:
    """Return how well the limits were kept, by kind, and whether as well as they should be."""
    said, passed = [], True
    for kind in LEVELS:
        mine = [each for each in found if each.kind == kind]
        kept = [each for each in mine if each.chosen]
        near = sum(each.ratio <= NEAR for each in kept)
        most = max((each.ratio for each in kept), default=0.0)
        wrong = sum(each.is_wrong_refusal for each in mine)
        alike = sum(each.same for each in mine)
        passed &= near >= SHARE * len(kept) and most <= FAR and not wrong
        said.append(
            f"{kind}: {near} of {len(kept)} at most {NEAR - 1.0:.0%} above what was asked for, the most {digits(most)} "
            f"times it; {len(mine) - len(kept)} refused, {wrong} of them wrongly; {alike} of {len(mine)} chosen alike in "
            f"{RUNS} runs"
        )
    return said, passed


def run(
    device: str | None = None,
    *,
    names: Collection[str] = (),
    frames: int = FRAMES,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure, print the table, and write it as PREFIX.csv, .json and .md. Returns True if limits are kept to NEAR for SHARE
    of what is chosen, never exceeded FAR times, and refused rightly.

    names: of SCENES, all by default. frames: of each variant, in turns. Raises InputError, DeviceError and OutputError.
    """
    if frames < 1:
        raise InputError(f"bench: --frames: expected a whole number above 0, found {frames}")
    chosen = pick(names, SCENES, "scene")
    files = [] if out is None else tables.paths(out)[:3]
    for path in files:
        atomic_files.check(path)
    opened = open_device(device, profiling=True)
    found: list[Outcome] = []
    with console.at_level(console.QUIET):  # of doubts about each choice
        for name in chosen:
            found += outcomes(name, opened, frames)
    said, passed = statements(found)
    rows = [each.row() for each in found]
    stats = {"device": opened.title, "outcomes": [{**vars(each), "ratio": each.ratio} for each in found]}
    columns, lines = RESOLUTION
    title = f"{opened.title}, {columns}x{lines}"
    tables.show(title, HEADER, rows, NOTE, said, stats, files, stream or sys.stdout, left=2)
    return passed
