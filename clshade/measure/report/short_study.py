"""A short study of a scene for one limit: the cheapest variants first, and only those that may be chosen."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from statistics import median
from typing import Any, NamedTuple

from ...base.arrays import Array
from ...errors import InputError
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.model import Scene, Settings
from ..timing import Waiting, median_interval, spread
from .measure import frame_ms, frame_times
from .pareto import NEARLY, within_budget, within_tolerance
from .reference_image import Reference, reference_windows
from .thinned_image import Estimate, Thinned, thinned
from .variants import SAVINGS, Variant

FIRST_FRAMES, FIRST_MS = (2, 3), 60.0  # of each variant: fewest, and most unless they take so long
FRAMES, SECONDS = 15, 0.6  # of each that may be chosen, in turns: fewer once all took so long
SLACK = 2.0  # the first frames may take this many times as long as later ones
CAUTION = 0.75  # what is predicted may be off by this


@dataclass(eq=False)
class Candidate:
    """A variant that was drawn. times: milliseconds of its frames. pixels: its image, thinned. estimate: its RMSE
    against the reference, None if nobody asked for it."""

    variant: Variant
    times: Sequence[float]
    pixels: Array = field(repr=False)
    estimate: Estimate | None = None

    @property
    def name(self) -> str:
        return self.variant.shown_title

    @property
    def cost(self) -> float:
        """Milliseconds per frame, the median."""
        return median(self.times)

    @property
    def fastest(self) -> float:
        """Milliseconds of the fastest frame, which other load on the machine disturbs least."""
        return min(self.times)

    @property
    def quartiles(self) -> tuple[float, float]:
        """Of the milliseconds per frame."""
        low, _, high = spread(self.times)
        return low, high

    @property
    def error(self) -> float:
        """RMSE against the reference; infinite if it is unknown."""
        return math.inf if self.estimate is None else self.estimate.rmse


class Dropped(NamedTuple):
    """A variant that was not drawn, and why. likely: no bound says so, but what similar variants did."""

    variant: Variant
    why: str
    likely: bool


@dataclass(frozen=True)
class Limit:
    """Either a budget, milliseconds per frame, or a tolerance, RMSE."""

    budget: float | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if (self.budget is None) == (self.tolerance is None):
            raise InputError("expected either a budget or a tolerance, found both or none")


class ShortStudy:
    """The variants of a scene that may be chosen for a limit. fixed: names of settings that the reference keeps.

    drawn, dropped: the variants that were, cheapest first. waiting: for other programs, during the last frames.
    """

    def __init__(self, scene: Scene, base: Settings, device: Device, limit: Limit, fixed: Collection[str] = ()) -> None:
        self.scene, self.base, self.device, self.limit, self.fixed = scene, base, device, limit, fixed
        self.drawn: list[Candidate] = []
        self.dropped: list[Dropped] = []
        self.waiting = Waiting()
        self._thinned: Thinned | None = None
        self._reference: Reference | None = None

    @property
    def thinned(self) -> Thinned:
        """The windows that errors are measured in, chosen by the first image."""
        if self._thinned is None:
            raise RuntimeError("nothing is drawn yet")
        return self._thinned

    @property
    def reference(self) -> Reference:
        """The reference in these windows, drawn when first asked for."""
        if self._reference is None:
            self._reference = reference_windows(self.scene, self.base, self.device, self.thinned, self.fixed)
        return self._reference

    def choose(self, variants: Sequence[Variant]) -> Candidate:
        """Draw what may be chosen of the variants, the first of which is the base, and choose. Raises InputError if none
        of them keeps the limit."""
        self._consider(sorted(variants, key=_work), likely=True)
        if not self._kept():  # what was likely may be wrong
            again = [each for each in self.dropped if each.likely]
            self.dropped = [each for each in self.dropped if not each.likely]
            self._consider([each.variant for each in again], likely=False)
        self._time(self._contenders())
        judged = self.limit.tolerance is not None or bool(self._kept())  # to refuse a budget needs no reference
        if judged:
            self._estimate(self.drawn)
        known = self.reference.error if judged else 0.0
        if self.limit.budget is not None:
            return within_budget(self.drawn, self.limit.budget, known)
        return within_tolerance(self.drawn, self.limit.tolerance or 0.0, known)

    def outcome(self, candidate: Candidate, used: Candidate) -> str:
        """Return what became of a candidate."""
        if candidate is used:
            return "used"
        if candidate not in self._kept():
            return "too slow" if self.limit.tolerance is None else "not accurate enough"
        if candidate.error > used.error + self.reference.error:
            return "less accurate"
        return "as accurate" if self.limit.tolerance is None else "slower"

    def _consider(self, variants: Sequence[Variant], *, likely: bool) -> None:
        for variant in variants:
            found = self._dropped(variant, likely)
            if found is None:
                self.drawn.append(self._drawn(variant))
            else:
                self.dropped.append(found)

    def _dropped(self, variant: Variant, likely: bool) -> Dropped | None:
        """Return the variant with the reason why it need not be drawn, if there is one."""
        least = least_ms(variant, self.drawn)
        if self.limit.budget is not None:
            if CAUTION * least > self.limit.budget:
                return Dropped(variant, f"cannot fit: at least {least:.3g} ms", False)
            sure = [each for each in self.drawn if each.cost <= CAUTION * self.limit.budget]
        else:
            sure = self._kept()
            for each in sure:
                if no_more_work(each.variant, variant):
                    return Dropped(variant, f"no faster than {each.name}", False)
            if sure and CAUTION * least > min(each.cost for each in sure):
                return Dropped(variant, f"slower: at least {least:.3g} ms", False)
        if not likely or not (sure or self.limit.tolerance is not None):
            return None
        self._estimate(self.drawn)
        most = self.limit.tolerance if self.limit.tolerance is not None else min(each.error for each in sure)
        error = likely_error(variant, self.drawn)
        return Dropped(variant, f"RMSE likely above {error:.2g}", True) if error >= most else None

    def _drawn(self, variant: Variant) -> Candidate:
        """Draw a variant. The first frame is not timed, as runtimes may compile during it."""
        with Renderer(self.scene, settings=variant.settings(self.base), device=self.device) as renderer:
            image = renderer.render().rgb
            times: list[float] = []
            while len(times) < FIRST_FRAMES[0] or (len(times) < FIRST_FRAMES[1] and sum(times) < FIRST_MS):
                times.append(frame_ms(renderer))
        if self._thinned is None:
            self._thinned = thinned(image, self.scene.face_count)
        found = Candidate(variant, times, self.thinned.of(image))
        if self.limit.tolerance is not None:
            self._estimate([found])
        return found

    def _estimate(self, candidates: Sequence[Candidate]) -> None:
        for each in candidates:
            if each.estimate is None:
                found = self.thinned.estimate(each.pixels, self.reference.rgb)
                each.estimate = found.widened(self.reference.error)

    def _kept(self) -> list[Candidate]:
        """Return the candidates that keep the limit."""
        if self.limit.budget is not None:
            return [each for each in self.drawn if each.quartiles[0] <= NEARLY * self.limit.budget]
        tolerance = self.limit.tolerance or 0.0
        return [each for each in self.drawn if each.error <= tolerance + self.reference.error]

    def _contenders(self) -> list[Candidate]:
        """Return the candidates that may be chosen after further frames, or else the nearest one."""
        if self.limit.budget is None:
            exact = self._kept() or [min(self.drawn, key=lambda each: each.error)]
            return [each for each in exact if each.fastest <= SLACK * min(other.cost for other in exact)]
        near = [each for each in self.drawn if each.fastest <= SLACK * self.limit.budget]
        sure = [each for each in self.drawn if each.cost <= CAUTION * self.limit.budget]
        if sure:
            self._estimate(near)
        least = min((each.error for each in sure), default=math.inf)
        return [each for each in near if each.error <= least] or [min(self.drawn, key=lambda each: each.cost)]

    def _time(self, candidates: Sequence[Candidate]) -> None:
        """Replace the times of the candidates by those of further frames."""
        with ExitStack() as stack:
            renderers = []
            for each in candidates:
                settings = each.variant.settings(self.base)
                renderer = stack.enter_context(Renderer(self.scene, settings=settings, device=self.device))
                renderer.render()
                renderers.append(renderer)
            with self.waiting:
                found = frame_times(renderers, FRAMES, SECONDS)
            for each, times in zip(candidates, found, strict=True):
                each.times = times


def row(each: Candidate | Dropped, outcome: str = "") -> dict[str, Any]:
    """Return the figures of a variant for JSON. outcome: of one that was drawn."""
    found: dict[str, Any] = {
        "variant": each.variant.shown_name,
        "about": each.variant.shown_title,
        "settings": each.variant.changes,
    }
    if isinstance(each, Dropped):
        return {**found, "outcome": each.why}
    low, high = each.quartiles
    found |= {"outcome": outcome, "frames": len(each.times), "frame_ms": each.cost, "frame_ms_quartiles": (low, high)}
    found["frame_ms_95"] = median_interval(each.times)
    if each.estimate is not None:
        found |= {"rmse": each.estimate.rmse, "rmse_95": each.estimate[1:]}
    return found


def _work(variant: Variant) -> tuple[int, bool]:
    return variant.changes.get("samples", 1), variant.changes.get("sample_shading", False)


def _others(variant: Variant) -> dict[str, Any]:
    return {name: value for name, value in variant.changes.items() if name not in ("samples", "sample_shading")}


def no_more_work(a: Variant, b: Variant) -> bool:
    """Return whether `b` does all that `a` does, and perhaps more samples, or more work for each."""
    return _others(a) == _others(b) and all(x <= y for x, y in zip(_work(a), _work(b), strict=True))


def least_ms(variant: Variant, drawn: Sequence[Candidate]) -> float:
    """Return a lower bound of a variant's milliseconds per frame; 0 if nothing comparable is drawn.

    It takes as long as one that does no more work. After two numbers of samples, time grows on with at least half of the
    power of the number that it grew with between them.
    """
    less = [each for each in drawn if no_more_work(each.variant, variant)]
    bound = max((each.fastest for each in less), default=0.0)
    count, shading = _work(variant)
    family = [each for each in less if _work(each.variant)[1] == shading and 1 < _work(each.variant)[0] < count]
    if len(family) < 2:
        return bound
    few, many = sorted(family, key=lambda each: _work(each.variant))[-2:]
    few_samples, many_samples = _work(few.variant)[0], _work(many.variant)[0]
    power = math.log(many.fastest / few.fastest) / math.log(many_samples / few_samples)
    grown: float = many.fastest * (count / many_samples) ** (max(power, 0.0) / 2.0)
    return max(bound, grown)


def likely_error(variant: Variant, drawn: Sequence[Candidate]) -> float:
    """Return what the RMSE of a variant is likely not below; 0 if nothing comparable is drawn.

    One of SAVINGS is no more accurate than the base. Of other changes the error is left that more samples do not remove:
    errors that are independent add by their squares.
    """
    base = next((each.error for each in drawn if not each.variant.changes), 0.0)
    if variant.name in SAVINGS:
        return base
    changed = _others(variant)
    alone = [each for each in drawn if changed and each.variant.changes == changed]
    return max((CAUTION * math.sqrt(max(each.error**2 - base**2, 0.0)) for each in alone), default=0.0)
