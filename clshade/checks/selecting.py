"""Which settings to render a scene with, for a budget of time or a tolerated error: from a short study of this scene."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

from ..device import Device, shared_device
from ..renderer import settle
from ..scene import PRESETS, Scene, Settings
from .choosing import chosen
from .measuring import Measured, measure
from .reference import Reference, reference
from .variants import SHORT, base_settings, variants_for

FRAMES = 5  # of each variant


@dataclass(frozen=True, eq=False)
class Selection:
    """What to render with. tried: the variants measured. seconds: that it took."""

    used: Measured
    settings: Settings
    tried: tuple[str, ...]
    reference: Reference
    seconds: float

    passed = True  # what no variant keeps is refused, not failed

    def lines(self) -> list[str]:
        """What was chosen, for the terminal."""
        used = self.used
        return [
            f"{used.name} ({used.variant.about}): {used.cost:.3g} ms a frame, RMSE {used.error:.3g}",
            f"of {len(self.tried)} ways measured in {self.seconds:.1f} s: {', '.join(self.tried)}",
            f"reference: {self.reference.about()}",
        ]

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        return {**self.used.stats(), "tried": self.tried, "seconds": self.seconds}


def select(
    scene: Scene,
    *,
    budget: float | None = None,
    tolerance: float | None = None,
    preset: str | None = None,
    device: Device | str | None = None,
    resolution: tuple[int, int] | None = None,
    **fields: Any,
) -> Selection:
    """The most exact way within `budget` milliseconds a frame, or the fastest with an RMSE of at most `tolerance`.

    fields: of Settings, which stay as they are given, as those of a preset do; the rest is the preset `standard`, and
    what SHORT changes of it. Raises InputError where nothing keeps the limit, and DeviceError.
    """
    start = time.perf_counter()
    opened = device if isinstance(device, Device) else shared_device(device, profiling=True)  # as `render` opens it
    scene, _ = settle(scene, resolution=resolution)
    base = replace(base_settings(scene) if preset is None else Settings.from_preset(preset), **fields)
    fixed = set(fields) | (set() if preset is None else preset_fields())
    tried = [each for each in variants_for(scene, opened) if each.name in SHORT and not fixed & set(each.changes)]
    converged = reference(scene, base, opened)
    measured = measure(scene, tried, base, opened, converged, frames=FRAMES, checked=False)
    used = chosen(measured, budget, tolerance)
    assert used is not None, "either budget or tolerance"
    names = tuple(each.name for each in tried)
    return Selection(used, used.variant.settings(base), names, converged, time.perf_counter() - start)


def preset_fields() -> set[str]:
    """Fields of Settings that differ between the presets."""
    first, second = (vars(Settings.from_preset(preset)) for preset in PRESETS)
    return {name for name, value in first.items() if second[name] != value}
