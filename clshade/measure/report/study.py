"""The measurements of `report` on one scene."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...base import atomic_files
from ...base.arrays import Array
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene
from .format_errors import Kept, formats
from .measure import Measured, measure
from .pareto import front, ties
from .reference_image import Reference, reference
from .tessellation import Tessellation, loglog_slope, tessellation
from .variants import BASE, Variant, base_settings

SHOWN = 4  # variants whose images are kept
FAMILIES = ("samples-", "shaded-")  # prefixes of variants that differ only in the number of samples


@dataclass(frozen=True, eq=False)
class Study:
    """Measurements of one scene. device, machine: descriptions. pictures: images (M, N, 3) of SHOWN variants, by
    name."""

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
        """Pareto front of the variants, fastest first, as far as measuring can tell them apart."""
        return front(self.measured, self.reference.error)

    @property
    def ties(self) -> list[list[Measured]]:
        """Groups of variants on the front that measuring cannot tell apart."""
        return ties(self.front, self.reference.error)

    def sampling(self) -> dict[str, tuple[float, float]]:
        """Return, for samples shaded once and for samples shaded each, the fitted power of the RMSE in the number of
        samples, and the ratio of the RMSE with one sample to that with the most.

        Errors that the reference cannot resolve are left out; empty without the variants needed.
        """
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
        return (
            f"{atomic_files.shown(self.scene.name or 'unnamed')}, {self.scene.face_count:,} triangles, {columns}x{rows}"
        )

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "scene": self.scene.name,
            "triangles": self.scene.face_count,
            "resolution": self.scene.camera.resolution,
            "device": self.device,
            "machine": self.machine,
            "reference": self.reference.stats(),
            "variants": [each.stats() for each in self.measured],
            "pareto_front": [each.name for each in self.front],
            "ties": [[each.name for each in group] for group in self.ties],
            "sampling": {name: {"slope": slope, "gain": gain} for name, (slope, gain) in self.sampling().items()},
            "tessellation": self.tessellation.stats(),
            "formats": [each.stats() for each in self.kept],
        }


def study(scene: Scene, device: Device, variants: Sequence[Variant], frames: int) -> Study:
    """Measure the variants (see `measure`), the file formats, and the sphere."""
    base = base_settings(scene)
    converged = reference(scene, base, device)
    measured = measure(scene, variants, base, device, converged, frames=frames)
    shown = worth_showing(measured, converged.error)
    pictures = {each.name: render(scene, settings=each.settings, device=device).rgb for each in shown}
    kept = formats(render(scene, settings=base, device=device))
    return Study(
        scene, device.title, machine(), converged, tuple(measured), pictures, tessellation(device), tuple(kept)
    )


def worth_showing(measured: Sequence[Measured], known: float) -> list[Measured]:
    """Return the first variant, the ends of the Pareto front and its middle, without duplicates, fastest first. known:
    uncertainty of the errors."""
    best = front(measured, known)
    middle = sorted(best, key=lambda each: abs(best.index(each) - len(best) // 2))
    picked = [*measured[:1], *best[:1], *best[-1:], *middle, *measured]
    return sorted(list(dict.fromkeys(picked))[:SHOWN], key=lambda each: each.cost)


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
