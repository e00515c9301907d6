"""Which settings to render a scene with, for a budget of time or a tolerated error: from a short study of this scene."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

from ..device import Device, shared_device
from ..renderer import settle
from ..scene import PRESETS, Scene, Settings
from .choosing import chosen
from .measuring import Drawn, Measured, draw, timed
from .reference import Reference, reference
from .variants import SHORT, base_settings, variants_for

FRAMES = 5  # of each variant
SLACK = 2.0  # one frame may take so many times as long as others do


@dataclass(frozen=True, eq=False)
class Selection:
    """What to render with. tried: the variants drawn. seconds: that it took."""

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
            f"of {len(self.tried)} ways tried in {self.seconds:.1f} s: {', '.join(self.tried)}",
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
    candidates = [
        each for each in variants_for(scene, base, opened) if each.name in SHORT and not fixed & set(each.changes)
    ]
    converged = reference(scene, base, opened)
    with ExitStack() as stack:
        tried = draw(scene, candidates, base, opened, converged, stack)
        measured = timed(worth_timing(tried, budget, tolerance), FRAMES, checked=False)
    used = chosen(measured, budget, tolerance, converged.error)
    assert used is not None, "either budget or tolerance"
    names = tuple(each.variant.name for each in tried)
    return Selection(used, used.variant.settings(base), names, converged, time.perf_counter() - start)


def worth_timing(tried: Sequence[Drawn], budget: float | None, tolerance: float | None) -> list[Drawn]:
    """Those that may be chosen, as one frame tells; where none may be, the one that comes nearest."""
    if tolerance is not None:
        exact = [each for each in tried if each.approximation.rmse <= tolerance]
        tried = exact or [min(tried, key=lambda each: each.approximation.rmse)]
    ms = [each.frame_ms() for each in tried]
    limit = SLACK * max(budget or 0.0, min(ms))
    return [each for each, its in zip(tried, ms, strict=True) if its <= limit]


def preset_fields() -> set[str]:
    """Fields of Settings that differ between the presets."""
    first, second = (vars(Settings.from_preset(preset)) for preset in PRESETS)
    return {name for name, value in first.items() if second[name] != value}
