"""Settings chosen for a time budget or an error tolerance, by a short study of the scene."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...base import console
from ...images.metrics import rmse
from ...pipeline.effective_settings import effective_settings
from ...pipeline.opencl.device import Device, shared_device
from ...pipeline.renderer import Renderer
from ...scene.model import Scene, Settings
from ...scene.settings import PRESETS, Preset
from ..timing import spread
from .measure import frame_ms, frame_times
from .pareto import chosen
from .reference_image import Reference, reference
from .variants import BASE, SHORT, Variant, variants_for

FRAMES = 5  # of each variant
SLACK = 2.0  # a single frame may take this many times as long as the median


class Candidate(NamedTuple):
    """A variant with its measured cost, milliseconds per frame, the quartiles of that, and error, RMSE against the
    reference."""

    variant: Variant
    cost: float
    quartiles: tuple[float, float]
    error: float

    @property
    def name(self) -> str:
        """Name of the variant; `standard` would be misleading if the given settings differ from it."""
        return self.variant.name if self.variant.changes else "unchanged"


@dataclass(frozen=True, eq=False)
class Selection:
    """The settings to render with.

    kept: fields of Settings that were given, or the scene's own. tried: the variants drawn. seconds: duration of the
    study.
    """

    used: Candidate
    settings: Settings
    kept: tuple[str, ...]
    tried: tuple[str, ...]
    reference: Reference
    seconds: float

    passed = True  # a limit that no variant meets raises an error instead

    def lines(self) -> list[str]:
        """Return the choice as lines for the terminal."""
        used = self.used
        changed = f" ({used.variant.changed()})" if used.variant.changes else ""
        kept = ", ".join(f"{name}={getattr(self.settings, name)}" for name in self.kept)
        return [
            f"{used.name}{changed}: {used.cost:.3g} ms a frame after the first, RMSE {used.error:.3g}",
            *([f"kept as they are: {kept}"] if kept else []),
            f"of {len(self.tried)} ways tried in {self.seconds:.1f} s: {', '.join(self.tried)}",
            f"reference: {self.reference.about()}",
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        used = self.used
        return {
            "variant": used.name,
            "settings": used.variant.changes,
            "frame_ms": used.cost,
            "rmse": used.error,
            "kept": {name: getattr(self.settings, name) for name in self.kept},
            "reference": self.reference.stats(),
            "tried": self.tried,
            "seconds": self.seconds,
        }


def select(
    scene: Scene,
    *,
    budget: float | None = None,
    tolerance: float | None = None,
    preset: Preset | None = None,
    device: Device | str | None = None,
    resolution: tuple[int, int] | None = None,
    **fields: Any,
) -> Selection:
    """Select the most accurate variant within `budget` milliseconds per frame, or the fastest with an RMSE of at most
    `tolerance`.

    fields: fields of Settings that are kept, also in the reference. If a preset is given, or the scene's is not
    `standard`, all fields that differ between presets are kept too. The variants of SHORT change the others. Raises
    DeviceError, and InputError if no variant meets the limit.
    """
    start = time.perf_counter()
    opened = device if isinstance(device, Device) else shared_device(device, profiling=True)  # as `render` opens it
    scene, base = effective_settings(scene, preset, resolution=resolution, **fields)
    fixed = set(fields) | (preset_fields() if preset is not None or scene.preset != BASE else set())
    variants = [
        each for each in variants_for(scene, base, opened) if each.name in SHORT and not fixed & set(each.changes)
    ]
    converged = reference(scene, base, opened, fixed)
    tried = [_tried(scene, each, base, opened, converged) for each in variants]
    candidates = _timed(scene, worth_timing(tried, budget, tolerance), base, opened)
    choice = chosen(candidates, budget, tolerance, converged.error)
    assert choice is not None, "either budget or tolerance"
    used = choice.used
    if choice.doubt:
        console.warning(f"within noise: {choice.doubt}")
    kept, names = tuple(sorted(fixed - {"layers"})), tuple(each.name for each in tried)
    return Selection(used, used.variant.settings(base), kept, names, converged, time.perf_counter() - start)


def _tried(scene: Scene, variant: Variant, base: Settings, device: Device, converged: Reference) -> Candidate:
    """Measure a variant; the cost is that of its second frame, as runtimes may compile during the first."""
    with Renderer(scene, settings=variant.settings(base), device=device) as renderer:
        error = rmse(renderer.render().rgb, converged.rgb)
        cost = frame_ms(renderer)
        return Candidate(variant, cost, (cost, cost), error)


def _timed(scene: Scene, candidates: Sequence[Candidate], base: Settings, device: Device) -> list[Candidate]:
    """Return the candidates with the median time of further frames as cost."""
    with ExitStack() as stack:
        renderers = []
        for each in candidates:
            renderer = stack.enter_context(Renderer(scene, settings=each.variant.settings(base), device=device))
            renderer.render()
            renderers.append(renderer)
        times = frame_times(renderers, FRAMES)
    spreads = [spread(ms) for ms in times]
    return [
        each._replace(cost=ms.median, quartiles=(ms.low, ms.high)) for each, ms in zip(candidates, spreads, strict=True)
    ]


def worth_timing(tried: Sequence[Candidate], budget: float | None, tolerance: float | None) -> list[Candidate]:
    """Return the candidates that may meet the limit, judged by one frame, or else the nearest one."""
    if tolerance is not None:
        exact = [each for each in tried if each.error <= tolerance]
        tried = exact or [min(tried, key=lambda each: each.error)]
    limit = SLACK * max(budget or 0.0, min(each.cost for each in tried))
    return [each for each in tried if each.cost <= limit]


def preset_fields() -> set[str]:
    """Return the fields of Settings that differ between the presets."""
    first, second = (vars(Settings.from_preset(preset)) for preset in PRESETS)
    return {name for name, value in first.items() if second[name] != value}
