"""What a study of one scene means for its pictures: which settings to render with, as a few lines with commands."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from ...base.text_tables import digits
from ...scene.model import Settings
from .measure import CODES, Measured
from .pareto import most_accurate, most_accurate_of_fastest
from .study import Study

CLOSE, FLIP = 0.99, 0.005  # share of pixels within CODES at least, and mean FLIP at most: such an error is not visible
BUDGETS = (16.0, 100.0)  # milliseconds: the frame of a display at 60 Hz; what is felt as immediate
WORTH = 0.7  # ratio of errors: samples that change less are not worth their time

Command = Callable[[Settings], str]


@dataclass(frozen=True)
class Advice:
    """One line. purpose: what the settings are for. used: the variant to render with. found: what it costs."""

    purpose: str
    used: Measured
    found: str

    def line(self, command: Command) -> str:
        """Return it for the terminal; commands are not wrapped, so that they can be copied."""
        return f"{self.purpose + ':':<17} {self.found}: {command(self.used.settings)}"


def is_unseen(measured: Measured) -> bool:
    """Return whether nobody would see its difference from the converged image."""
    flip = measured.approximation.flip
    return measured.close >= CLOSE and (flip is None or flip <= FLIP)


def criterion(study: Study) -> str:
    """Return what `is_unseen` asks for, and what the variant of the first line has of it."""
    used = _unseen(study)[0]
    flip = used.approximation.flip
    condition = f"at least {CLOSE:.0%} of pixels within {CODES} of 255 codes of the converged image"
    if flip is None:
        return f"no visible error: {condition}; the first line has {used.close:.1%} (FLIP is not measured)"
    has = f"the first line has {used.close:.1%} and {digits(flip, 2)}"
    return f"no visible error: {condition}, and FLIP at most {FLIP:g}; {has}"


def answer(study: Study) -> list[Advice]:
    """Return at most five lines: the fastest variant whose difference is not seen, the most accurate within BUDGETS, what
    `render` draws by default, and whether more samples pay."""
    used, unseen = _unseen(study)
    advice = [Advice("no visible error" if unseen else "closest", used, _cost(used))]
    advice += [_within(study, budget) for budget in BUDGETS]
    default = study.default
    if default is not None:
        advice.append(Advice("the default", default, f"{_cost(default)}{_compared(default, advice)}"))
        advice.append(_more_samples(study, default))
    return advice


def _cost(measured: Measured) -> str:
    return f"{digits(measured.cost)} ms, RMSE {digits(measured.error, 2)}"


def _unseen(study: Study) -> tuple[Measured, bool]:
    """Return the fastest variant whose difference is not seen and True; if there is none the closest and False."""
    unseen = [measured for measured in study.measured if is_unseen(measured)]
    if unseen:
        return most_accurate_of_fastest(unseen, study.reference.error), True
    return max(study.measured, key=lambda measured: (measured.close, -measured.error)), False


def _within(study: Study, budget: float) -> Advice:
    """Return the most accurate variant within a budget; the fastest of all if none is."""
    purpose = f"within {budget:g} ms"
    candidates = [measured for measured in study.measured if measured.cost <= budget]
    if candidates:
        used = most_accurate(candidates, study.reference.error)
        return Advice(purpose, used, _cost(used))
    used = min(study.measured, key=lambda measured: measured.cost)
    return Advice(purpose, used, f"none; the fastest takes {_cost(used)}")


def _compared(default: Measured, others: Sequence[Advice]) -> str:
    """Return the time and the error of the default in those of other variants."""
    times = (default.cost / slower.used.cost for slower in others)
    errors = (_ratio(default.error, slower.used.error) for slower in others)
    time, error = (", ".join(f"x{digits(ratio, 2)}" for ratio in ratios) for ratios in (times, errors))
    return f"; compared with the lines above: time {time}, error {error}"


def _ratio(error: float, other: float) -> float:
    return error / other if other > 0.0 else math.inf if error > 0.0 else 1.0


def _more_samples(study: Study, default: Measured) -> Advice:
    """Return whether more samples of the default's model pay: whether the error is then not visible, or much smaller."""
    purpose, model = "more samples", _model(default)
    more = [
        measured for measured in study.measured if _model(measured) == model and _samples(measured) > _samples(default)
    ]
    if is_unseen(default):
        return Advice(purpose, default, "not worth it, the error is not visible")
    enough = [measured for measured in more if is_unseen(measured)]
    best = min(enough or more, key=lambda measured: measured.cost if enough else measured.error, default=None)
    if best is None:
        return Advice(purpose, default, "not measured")
    time, error = best.cost / default.cost, _ratio(best.error, default.error)
    ratios = f"time x{digits(time, 2)}, error x{digits(error, 2)}"
    if not enough and error > WORTH:
        return Advice(purpose, best, f"not worth it, {ratios}")
    return Advice(purpose, best, f"worth it, {ratios}, which is {'not' if enough else 'still'} visible")


def _model(measured: Measured) -> Settings:
    return replace(measured.settings, samples=1, sample_shading=False)


def _samples(measured: Measured) -> tuple[int, bool]:
    return measured.settings.samples, measured.settings.sample_shading
