"""The measurements of `report` on one scene."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...base import atomic_files, console
from ...base.arrays import Array
from ...base.progress_bar import Bar
from ...pipeline.opencl.device import Device
from ...pipeline.programs import running_time
from ...pipeline.renderer import render
from ...scene.model import Scene
from .decomposition import Decomposition, decompose
from .measure import FEW_CHECKED, FEW_SECONDS, SAMPLES_CHECKED, SECONDS, Measured, measure
from .model_errors import ModelErrors
from .pareto import front
from .reference_image import Reference, reference
from .variants import Variant, base_settings, default_variant, picture_settings

SHOWN = 4  # differences that are kept as pictures


@dataclass(frozen=True, eq=False)
class Study:
    """Measurements of one scene. device, machine: descriptions. pictures: differences (M, N, 3) of up to SHOWN images, by
    what they show. usual: name of the variant that `render` draws by default. causes: of the error of the image that it
    draws, if they were asked for. given: settings in place of the scene's own."""

    scene: Scene
    device: str
    machine: str
    reference: Reference
    measured: tuple[Measured, ...]
    pictures: dict[str, Array]
    usual: str = ""
    causes: Decomposition | None = None
    given: Mapping[str, Any] = field(default_factory=dict)

    @property
    def default(self) -> Measured | None:
        """The variant that `render` draws by default, if it was measured."""
        return next((each for each in self.measured if each.variant.name == self.usual), None)

    @property
    def front(self) -> list[Measured]:
        """Pareto front of the variants, fastest first."""
        return front(self.measured, self.reference.error)

    @property
    def title(self) -> str:
        columns, rows = self.scene.camera.resolution
        name = atomic_files.shown(self.scene.name or "unnamed")
        return f"{name}, {self.scene.face_count:,} triangles, {columns}x{rows}"


def study(
    scene: Scene,
    device: Device,
    variants: Sequence[Variant],
    frames: int,
    settings: Mapping[str, Any] | None = None,
    details: bool = True,
) -> Study:
    """Measure the variants (see `measure`), and with details the causes of the image's error, and more of its pixels.
    settings: fields of Settings in place of the scene's own."""
    given = dict(settings or {})
    base = base_settings(scene, **given)
    steps = len(variants) + (3 if details else 2)
    with Bar(steps, "report", clock=running_time, hidden=console.quiet() or None) as bar:
        converged = reference(scene, base, device)
        bar.advance()
        models = ModelErrors(scene, converged.settings, device)
        checked, seconds = (SAMPLES_CHECKED, SECONDS) if details else (FEW_CHECKED, FEW_SECONDS)
        effort: dict[str, Any] = {"frames": frames, "checked": checked, "seconds": seconds}
        measured = measure(scene, variants, base, device, converged, models, advance=bar.advance, **effort)
        off = pictures(scene, device, measured, converged, models)
        bar.advance()
        causes = None
        if details:
            causes = decompose(scene, picture_settings(scene, **given), device, converged, models)
            bar.advance()
    usual = default_variant(scene, base, variants, **given).name
    return Study(scene, device.title, machine(), converged, tuple(measured), off, usual, causes, given)


def pictures(
    scene: Scene, device: Device, measured: Sequence[Measured], converged: Reference, models: ModelErrors
) -> dict[str, Array]:
    """Return what the first and the most accurate image are off by, and between them the models that are off most."""
    ends = list(dict.fromkeys([*measured[:1], *sorted(measured, key=lambda each: each.error)[:1]]))
    off = {
        f"{each.name}, off by": render(scene, settings=each.settings, device=device).rgb - converged.rgb
        for each in ends
    }
    alone = {each.name: each for each in measured if len(models.approximated(each.settings)) == 1 and each.model > 0.0}
    distinct = {tuple(models.approximated(each.settings)): each for each in reversed(list(alone.values()))}
    worst = sorted(distinct.values(), key=lambda each: -each.model)[: SHOWN - len(ends)]
    between = {f"{each.name}, its model off by": models.difference(each.settings) for each in worst}
    (first, picture), *last = off.items()
    return {first: picture, **between, **dict(last)}


def machine() -> str:
    """Return the processor, the number of cores available to this process, and the system."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as file:
            model = next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), model)
    except OSError:
        pass  # another system
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{model}, {count} processors, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
