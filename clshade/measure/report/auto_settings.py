"""Which settings to render a scene with, for a budget of time or a tolerated error: from a short study of this scene."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...images.metrics import rmse
from ...pipeline.opencl.device import Device, shared_device
from ...pipeline.renderer import Renderer, effective_settings
from ...scene.model import Scene, Settings
from ...scene.settings import PRESETS, Preset
from .measure import frame_ms, frame_times
from .pareto import chosen
from .reference_image import Reference, reference
from .variants import BASE, SHORT, Variant, variants_for

FRAMES = 5  # of each variant
SLACK = 2.0  # one frame may take so many times as long as others do


class Candidate(NamedTuple):
    """A variant that was drawn. cost: milliseconds of a frame. error: RMSE against the reference."""

    variant: Variant
    cost: float
    error: float

    @property
    def name(self) -> str:
        """`standard` would be the wrong word where the settings that were given are others."""
        return self.variant.name if self.variant.changes else "unchanged"


@dataclass(frozen=True, eq=False)
class Selection:
    """What to render with. kept: fields of the settings that were given, or the scene's own. tried: the variants drawn.
    seconds: that it took."""

    used: Candidate
    settings: Settings
    kept: tuple[str, ...]
    tried: tuple[str, ...]
    reference: Reference
    seconds: float

    passed = True  # what no variant keeps is refused, not failed

    def lines(self) -> list[str]:
        """What was chosen, for the terminal."""
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
        """The figures, as JSON takes them."""
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
    """The most exact way within `budget` milliseconds a frame, or the fastest with an RMSE of at most `tolerance`.

    fields: of Settings, which stay as they are given, as those of a preset do, and those of a scene that has another
    preset than `standard`: the reference has them too. The rest is what SHORT changes. Raises InputError where nothing
    keeps the limit, and DeviceError.
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
    used = chosen(candidates, budget, tolerance, converged.error)
    assert used is not None, "either budget or tolerance"
    kept, names = tuple(sorted(fixed - {"layers"})), tuple(each.name for each in tried)
    return Selection(used, used.variant.settings(base), kept, names, converged, time.perf_counter() - start)


def _tried(scene: Scene, variant: Variant, base: Settings, device: Device, converged: Reference) -> Candidate:
    """Its cost is that of the second frame: runtimes may compile at the first."""
    with Renderer(scene, settings=variant.settings(base), device=device) as renderer:
        error = rmse(renderer.render().rgb, converged.rgb)
        return Candidate(variant, frame_ms(renderer), error)


def _timed(scene: Scene, candidates: Sequence[Candidate], base: Settings, device: Device) -> list[Candidate]:
    """With the median of further frames as cost."""
    with ExitStack() as stack:
        renderers = []
        for each in candidates:
            renderer = stack.enter_context(Renderer(scene, settings=each.variant.settings(base), device=device))
            renderer.render()
            renderers.append(renderer)
        times = frame_times(renderers, FRAMES)
    return [each._replace(cost=ms.median) for each, ms in zip(candidates, times, strict=True)]


def worth_timing(tried: Sequence[Candidate], budget: float | None, tolerance: float | None) -> list[Candidate]:
    """Those that may be chosen, as one frame tells; where none may be, the one that comes nearest."""
    if tolerance is not None:
        exact = [each for each in tried if each.error <= tolerance]
        tried = exact or [min(tried, key=lambda each: each.error)]
    limit = SLACK * max(budget or 0.0, min(each.cost for each in tried))
    return [each for each in tried if each.cost <= limit]


def preset_fields() -> set[str]:
    """Fields of Settings that differ between the presets."""
    first, second = (vars(Settings.from_preset(preset)) for preset in PRESETS)
    return {name for name, value in first.items() if second[name] != value}
