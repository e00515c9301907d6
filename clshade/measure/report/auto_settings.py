"""Settings for a time budget or an error tolerance: the variants of a scene are tried, and the best is taken."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from ...base.text_tables import digits
from ...errors import InputError
from ...pipeline.effective_settings import effective_settings
from ...pipeline.opencl.device import Device, shared_device
from ...pipeline.renderer import Renderer, render
from ...scene.model import Scene, Settings
from ...scene.settings import PRESET_FIELDS, Preset
from ..results import Column, Table
from ..timing import Spread, spread
from .measure import frame_ms, frame_times
from .pareto import within_budget, within_tolerance
from .reference_image import Reference, reference
from .thinned_image import Estimate, Thinned, thinned
from .variants import BASE, Variant, variants_for

# Families of variants. In each one every variant does all the work of those before it.
LADDER = (
    (BASE, "samples-4", "shaded-4", "shaded-16", "shaded-64"),
    ("samples-16", "samples-64"),
    ("gouraud", "gouraud-4", "gouraud-16"),
    ("trilinear", "trilinear-4"),
    *(("course",), ("vertex-texture",)),
)
TRIAL_FRAMES = 3  # of each variant that is drawn
FRAMES, SECONDS = 15, 0.6  # of each that may be chosen, in turns: fewer once all took so long
SLACK = 1.5  # trial frames may take this many times as long as later ones
NOT_DRAWN = "Not drawn, as they do more work than one that is too slow, or accurate enough: "
UNCHANGED = Variant("unchanged", "unchanged", {})  # the base may be other than the preset `standard`


@dataclass(eq=False)
class Tried:
    """A variant that was drawn. ms: of its frames. estimate: its RMSE."""

    variant: Variant
    ms: Sequence[float]
    estimate: Estimate

    @property
    def name(self) -> str:
        return self.variant.title

    @property
    def frame_ms(self) -> Spread:
        return spread(self.ms)

    @property
    def cost(self) -> float:
        return self.frame_ms.median

    @property
    def error(self) -> float:
        return self.estimate.rmse


def _interval(interval: tuple[float, float]) -> str:
    return " to ".join(map(digits, interval))


COLUMNS = (
    Column("variant", "about", attrgetter("name"), str),
    Column("ms a frame", "frame_ms", attrgetter("cost")),
    Column("half of them", "frame_ms_half", lambda tried: (tried.frame_ms.low, tried.frame_ms.high), _interval),
    Column("RMSE", "rmse", attrgetter("error")),
    Column("95 %", "rmse_95", lambda tried: tried.estimate[1:], _interval),
    Column("", "variant", attrgetter("variant.name")),
    Column("", "settings", attrgetter("variant.changes")),
)


@dataclass(frozen=True, eq=False)
class Selection:
    """The settings to render with. kept: fields of Settings that were given, or the scene's own. not_drawn: titles of
    variants. thinned: the pixels that errors were measured at. seconds: that trying took."""

    used: Tried
    settings: Settings
    kept: dict[str, Any]
    tried: Sequence[Tried]
    not_drawn: Sequence[str]
    reference: Reference
    thinned: Thinned
    seconds: float

    passed = True  # a limit that no variant meets raises an error instead

    @property
    def table(self) -> Table:
        notes = [NOT_DRAWN + ", ".join(self.not_drawn)] if self.not_drawn else []
        return Table("Variants tried", COLUMNS, self.tried, notes=notes)

    def lines(self) -> list[str]:
        """Return the choice as lines for the terminal."""
        used, variant = self.used, self.used.variant
        changed = f" ({variant.changed()})" if variant.changes else ""
        fixed = ", ".join(f"{name}={value}" for name, value in self.kept.items())
        count = len(self.tried)
        return [
            f"{used.name}{changed}: {digits(used.cost)} ms a frame after the first, RMSE {digits(used.error)}, "
            f"{_interval(used.estimate[1:])}",
            *([f"kept as they are: {fixed}"] if fixed else []),
            f"{count} of {count + len(self.not_drawn)} variants drawn, in {self.seconds:.1f} s",
            f"errors: of {self.thinned.about()}",
            f"reference: {self.reference.about()}",
        ]

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            **Table("", COLUMNS, [self.used]).plain()[0],
            "kept": self.kept,
            "reference": self.reference.about(),
            "errors_of": self.thinned.about(),
            "tried": self.table.plain(),
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
    `standard`, all fields that differ between presets are kept too. Raises DeviceError, and InputError if no variant
    meets the limit.
    """
    if (budget is None) == (tolerance is None):
        raise InputError("expected either a budget or a tolerance, found both or none")
    start = time.perf_counter()
    opened = device if isinstance(device, Device) else shared_device(device)  # as `render` opens it
    scene, base = effective_settings(scene, preset, resolution=resolution, **fields)
    fixed = set(fields)
    if preset is not None or scene.preset != BASE:
        preset_name = preset or scene.preset
        fixed |= PRESET_FIELDS["course" if preset_name == "standard" else preset_name].keys()
    trials = _Trials(scene, base, opened, fixed)
    used = trials.within_tolerance(tolerance or 0.0) if budget is None else trials.within_budget(budget)
    settings = used.variant.settings(base)
    values = {name: getattr(settings, name) for name in sorted(fixed - {"layers"})}
    seconds = time.perf_counter() - start
    return Selection(used, settings, values, trials.tried, trials.not_drawn, trials.reference, trials.thinned, seconds)


def _work(variant: Variant) -> tuple[int, bool]:
    return variant.changes.get("samples", 1), variant.changes.get("sample_shading", False)


class _Trials:
    """The variants of a scene that change none of the settings `kept`."""

    def __init__(self, scene: Scene, base: Settings, device: Device, kept: set[str]) -> None:
        self._scene, self._base, self._device = scene, base, device
        usable = {v.name: v for v in variants_for(scene, base, device) if not kept & set(v.changes)}
        usable[BASE] = UNCHANGED
        self._families = [[usable[name] for name in family if name in usable] for family in LADDER]
        self.thinned = thinned(render(scene, settings=base, device=device).rgb, scene.face_count)
        self.reference = reference(scene, base, device, kept, self.thinned)
        self.tried: list[Tried] = []

    def within_budget(self, budget: float) -> Tried:
        best = self._try(lambda tried: min(tried.ms) > SLACK * budget)
        sure = min((tried.error for tried in best if SLACK * min(tried.ms) <= budget), default=math.inf)
        self._time([tried for tried in best if min(tried.ms) <= SLACK * budget and tried.error <= sure])
        return within_budget(best, budget, self.reference.error)

    def within_tolerance(self, tolerance: float) -> Tried:
        limit = tolerance + self.reference.error
        best = self._try(lambda tried: tried.error <= limit)
        exact = [tried for tried in best if tried.error <= limit]
        fastest = min((min(tried.ms) for tried in exact), default=0.0)
        self._time([tried for tried in exact if min(tried.ms) <= SLACK * fastest])
        return within_tolerance(best, tolerance, self.reference.error)

    @property
    def not_drawn(self) -> list[str]:
        variants = [tried.variant for tried in self.tried]
        return [variant.title for family in self._families for variant in family if variant not in variants]

    def _try(self, is_last: Callable[[Tried], bool]) -> list[Tried]:
        """Draw the variants of each family until one is the last that may be chosen; return those drawn."""
        for family in self._families:
            for variant in family:
                self.tried.append(self._draw(variant))
                if is_last(self.tried[-1]):
                    break
        self.tried.sort(key=lambda tried: _work(tried.variant))  # of equally accurate ones the first is taken
        return self.tried

    def _draw(self, variant: Variant) -> Tried:
        """Draw a variant. The first frame is not timed, as runtimes may compile during it."""
        with Renderer(self._scene, settings=variant.settings(self._base), device=self._device) as renderer:
            image = renderer.render().rgb
            ms = [frame_ms(renderer) for _ in range(TRIAL_FRAMES)]
        error, low, high = self.thinned.estimate(self.thinned.of(image), self.reference.rgb)
        reference_error = self.reference.error  # an RMSE is a distance: the interval is wider by that of the reference
        return Tried(variant, ms, Estimate(error, max(low - reference_error, 0.0), high + reference_error))

    def _time(self, chosen: Sequence[Tried]) -> None:
        """Replace the times of these by those of further frames."""
        with ExitStack() as stack:
            renderers = []
            for tried in chosen:
                settings = tried.variant.settings(self._base)
                renderers.append(stack.enter_context(Renderer(self._scene, settings=settings, device=self._device)))
                renderers[-1].render()
            for tried, ms in zip(chosen, frame_times(renderers, FRAMES, SECONDS), strict=True):
                tried.ms = ms
