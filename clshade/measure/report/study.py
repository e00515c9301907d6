"""All that `report` measures of one scene."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...base.arrays import Array
from ...base.atomic_files import shown
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene
from .format_errors import Kept, formats
from .measure import Measured, measure
from .pareto import front
from .reference_image import Reference, reference
from .tessellation import Tessellation, loglog_slope, tessellation
from .variants import BASE, Variant, base_settings

SHOWN = 4  # variants whose pictures are kept
FAMILIES = ("samples-", "shaded-")  # of variants that differ in the number of samples alone


@dataclass(frozen=True, eq=False)
class Study:
    """What was measured. device, machine: in words. pictures: of SHOWN variants, by name, (M, N, 3)."""

    scene: Scene
    device: str
    machine: str
    reference: Reference
    measured: tuple[Measured, ...]
    pictures: dict[str, Array]
    tessellation: Tessellation
    kept: tuple[Kept, ...]

    @property
    def front(self) -> list[Measured]:
        """The variants than which no other is both as fast and as right; fastest first."""
        return front(self.measured)

    def sampling(self) -> dict[str, tuple[float, float]]:
        """Of samples shaded once and each: the fitted power of their number by which the RMSE falls, and how many times
        as large as with most samples it is with one. Without errors that the reference is not good enough for; empty
        without the variants that tell."""
        found = {}
        for family in FAMILIES:
            errors = {
                each.variant.changes.get("samples", 1): each.error
                for each in self.measured
                if each.name == BASE or each.name.startswith(family)
                if each.error > self.reference.error
            }
            if len(errors) > 2 and 1 in errors:
                counts = sorted(errors)
                slope = loglog_slope(counts, [errors[count] for count in counts])
                found[family.rstrip("-")] = slope, errors[1] / errors[counts[-1]]
        return found

    @property
    def title(self) -> str:
        columns, rows = self.scene.camera.resolution
        return f"{shown(self.scene.name or 'unnamed')}, {self.scene.face_count:,} triangles, {columns}x{rows}"

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        return {
            "scene": self.scene.name,
            "triangles": self.scene.face_count,
            "resolution": self.scene.camera.resolution,
            "device": self.device,
            "machine": self.machine,
            "reference": self.reference.stats(),
            "variants": [each.stats() for each in self.measured],
            "pareto_front": [each.name for each in self.front],
            "sampling": {name: {"slope": slope, "gain": gain} for name, (slope, gain) in self.sampling().items()},
            "tessellation": self.tessellation.stats(),
            "formats": [each.stats() for each in self.kept],
        }


def study(scene: Scene, device: Device, variants: Sequence[Variant], frames: int) -> Study:
    """Measures the variants (see `measure`), the formats of an image, and the sphere."""
    base = base_settings(scene)
    converged = reference(scene, base, device)
    measured = measure(scene, variants, base, device, converged, frames=frames)
    pictures = {each.name: render(scene, settings=each.settings, device=device).rgb for each in worth_showing(measured)}
    kept = formats(render(scene, settings=base, device=device))
    return Study(
        scene, device.title, machine(), converged, tuple(measured), pictures, tessellation(device), tuple(kept)
    )


def worth_showing(measured: Sequence[Measured]) -> list[Measured]:
    """The first variant, the ends of the Pareto front and what is in its middle: those that differ, fastest first."""
    best = front(measured)
    middle = sorted(best, key=lambda each: abs(best.index(each) - len(best) // 2))
    picked = [*measured[:1], *best[:1], *best[-1:], *middle, *measured]
    return sorted(list(dict.fromkeys(picked))[:SHOWN], key=lambda each: each.cost)


def machine() -> str:
    """Processor, how many of them this process may use, system."""
    model = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as file:
            model = next((line.partition(":")[2].strip() for line in file if line.startswith("model name")), model)
    except OSError:
        pass  # another system
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{model}, {count} processors, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
