"""The measurements of `report` on one scene."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

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
    draws, if they were asked for. overrides: settings in place of the scene's own."""

    scene: Scene
    device: str
    machine: str
    reference: Reference
    measured: tuple[Measured, ...]
    pictures: dict[str, Array]
    usual: str = ""
    causes: Decomposition | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)

    @property
    def default(self) -> Measured | None:
        """The variant that `render` draws by default, if it was measured."""
        return next((variant for variant in self.measured if variant.variant.name == self.usual), None)

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
    fields = dict(settings or {})
    base = base_settings(scene, **fields)
    with Bar(len(variants) + 2, "report", clock=running_time, hidden=console.quiet() or None) as bar:
        converged = reference(scene, base, device)
        bar.advance()
        models = ModelErrors(scene, converged.settings, device)
        checked, seconds = (SAMPLES_CHECKED, SECONDS) if details else (FEW_CHECKED, FEW_SECONDS)
        effort: dict[str, Any] = {"frames": frames, "checked": checked, "seconds": seconds}
        measured = measure(scene, variants, base, device, converged, models, advance=bar.advance, **effort)
        off = pictures(scene, device, measured, converged)
        usual = picture_settings(scene, **fields)
        causes = decompose(scene, usual, device, converged, models) if details else None
        bar.advance()
    default = default_variant(scene, base, variants, **fields).name
    return Study(scene, device.title, machine(), converged, tuple(measured), off, default, causes, fields)


def pictures(scene: Scene, device: Device, measured: Sequence[Measured], converged: Reference) -> dict[str, Array]:
    """Return what the first image is off by, and those of the Pareto front, from its fastest to its most accurate."""
    best = front(measured, converged.error)
    places = np.linspace(0, len(best) - 1, min(len(best), SHOWN - 1)).round().astype(int)
    chosen = dict.fromkeys([measured[0], *(best[place] for place in places)])
    return {
        f"{variant.name}, off by": render(scene, settings=variant.settings, device=device).rgb - converged.rgb
        for variant in chosen
    }


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
