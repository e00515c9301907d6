"""`bench --features`: what it would save to leave out features at compile time, each alone and in groups."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any, TextIO

from ...base import atomic_files, console
from ...base.text_tables import digits
from ...errors import InputError
from ...pipeline import programs
from ...pipeline.features import COMPILED, FEATURES, Features
from ...pipeline.frame import same_bits
from ...pipeline.launches import Stages, scene_stages
from ...pipeline.opencl.device import Device, open_device
from ...pipeline.renderer import Renderer
from ...pipeline.scene_drawing import SceneDrawing
from ...scene.builtin.scenes import builtin
from ...scene.model import Scene
from ..timing import in_turns
from . import tables
from .workloads import knot, pick, thing

BAR = 0.05  # of a frame: what leaving out a feature has to save for programs to be compiled without it
ROUNDS, TURN, SECONDS = 9, 4, 6.0
SCENES: dict[str, tuple[Callable[[], Scene], dict[str, Any]]] = {
    "phong": (lambda: thing(512), {}),
    "knot": (lambda: knot(50_000), {}),
    "textured": (lambda: builtin("teapot"), {}),
    "samples": (lambda: builtin("teapot"), {"samples": 4}),
    "gouraud": (lambda: builtin("teapot"), {"shader": "gouraud"}),
    "pbr": (lambda: builtin("icosphere"), {"shader": "pbr"}),
}
GROUPS = {
    "lights": ("LIGHT_SHAPES", "AREA_LIGHTS", "ENVIRONMENT", "EMISSION"),
    "colors": ("VERTEX_COLORS", "CORNER_COLORS", "SCALARS", "BRIGHT", "MATERIALS"),
    "textures": ("TEXTURED", "MIPMAPS", "NORMAL_MAP", "OCCLUSION_MAP", "EMISSION_MAP", "ROUGHNESS_MAP"),
    "alpha": ("ALPHA_TEST", "BLEND", "VERTEX_ALPHA"),
    "lines, layers": ("LINES", "LINES_ONLY", "OWNERS", "BACKDROP"),
    "all": tuple(feature.name for feature in FEATURES if not feature.compiled),
}
NOTE = (
    "Percentage of a frame's processor time that is saved if kernels are compiled without features that the scene does not "
    "need, instead of skipping them at run time; - where the scene needs them. Kernels are compiled without those marked *. "
    "FAST, DOUBLE, PHONG, PBR, DEPTH_TEST and INSTANCES are not listed: they change the image, or how it is drawn."
)


def _renderer(scene: Scene, device: Device, change: tuple[str, ...], options: dict[str, Any]) -> Renderer:
    """Return a renderer of programs without some features at compile time, or with some of COMPILED that the scene does not
    need."""

    class Drawing(SceneDrawing):
        def _build(self, lanes: int | None, layers: Features | None) -> Stages:
            features = self.features.without([name for name in change if name not in COMPILED])
            for name in set(change) & set(COMPILED):
                features = features.including(name)
            return scene_stages(self.device, features, lanes, layers)

    class Changed(Renderer):
        _drawing_type = Drawing

    return Changed(scene, device=device, **options)


@dataclass(frozen=True)
class Saving:
    """What compiling without features saves.

    scene: a name of SCENES. names: the row's title. fraction: of the frame's processor time. same: whether the image has the
    same bits. compile_seconds: of the changed programs.
    """

    scene: str
    names: str
    fraction: float
    same: bool
    compile_seconds: float


def rows_of(features: Features) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Return the rows of the table that a scene with these features has: title, and the features it does not need."""
    for title, names in GROUPS.items():
        if unneeded := tuple(name for name in names if not features[name]):
            yield title, unneeded
    for name in ("CASTERS", "SAMPLES"):
        if not features[name]:
            yield f"{name} *", (name,)
    for feature in FEATURES:
        if not feature.compiled and not features[feature.name]:
            yield feature.name, (feature.name,)


def savings(name: str, device: Device, rounds: int = ROUNDS) -> Iterator[Saving]:
    """Measure all rows of a scene. rounds: turns of TURN frames each; fewer if they take more than SECONDS."""
    make, options = SCENES[name]
    scene = make()
    with ExitStack() as opened:
        usual = opened.enter_context(_renderer(scene, device, (), options))
        image = usual.render()
        for title, change in rows_of(usual.features):
            before = programs.waited()
            with _renderer(scene, device, change, options) as changed:
                same = same_bits(image, changed.render())
                compiling = programs.waited() - before
                turns = in_turns([partial(_least, usual), partial(_least, changed)], rounds, SECONDS)
            ratio = median(ours / theirs for ours, theirs in turns)
            compiled = set(change) <= set(COMPILED)
            yield Saving(name, title, 1.0 / ratio - 1.0 if compiled else ratio - 1.0, same, compiling)


def _least(renderer: Renderer, _: int) -> float:
    """Return the least processor time of some frames, seconds."""
    times = []
    for _ in range(TURN):
        start = time.process_time()
        renderer.render()
        times.append(time.process_time() - start)
    return min(times)


def run(
    device: str | None = None,
    *,
    names: Collection[str] = (),
    rounds: int = ROUNDS,
    out: str | None = None,
    stream: TextIO | None = None,
) -> bool:
    """Measure, print the table, and write it as PREFIX.csv, .json and .md. Returns True if no image changed.

    names: of SCENES, all by default. rounds: as of `savings`. Raises InputError, DeviceError and OutputError.
    """
    if rounds < 1:
        raise InputError(f"bench: --frames: expected a whole number above 0, found {rounds}")
    chosen = pick(names, SCENES, "workload") if names else tuple(SCENES)
    files = [] if out is None else tables.paths(out)[:3]
    for path in files:
        atomic_files.check(path)
    opened = open_device(device, profiling=True)
    found: list[Saving] = []
    for name in chosen:
        console.progress(f"{name}: a program for each row")
        found += savings(name, opened, rounds)
    header, rows = _table(found, chosen)
    # With one sample of several, texture coordinates are interpolated another way.
    faults = [
        f"{each.scene}: other bits without {each.names}" for each in found if not (each.same or "SAMPLES" in each.names)
    ]
    stats = {"device": opened.title, "lanes": opened.lanes, "savings": [vars(each) for each in found]}
    title = f"{opened.title}, {opened.lanes} lanes"
    tables.show(title, header, rows, NOTE, faults, stats, files, stream or sys.stdout)
    return not faults


def _table(found: Sequence[Saving], scenes: Sequence[str]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the header and the rows, those that save most first."""
    most = {each.names: max(other.fraction for other in found if other.names == each.names) for each in found}
    of = {(each.names, each.scene): f"{100.0 * each.fraction:.1f}" for each in found}
    rows = [
        (
            names,
            *(of.get((names, scene), "-") for scene in scenes),
            digits(100.0 * saved, 2),
            "yes" if saved >= BAR else "",
        )
        for names, saved in sorted(most.items(), key=lambda item: -item[1])
    ]
    return ("without", *(f"{scene} %" for scene in scenes), "most %", f"{100.0 * BAR:.0f} % or more"), rows
