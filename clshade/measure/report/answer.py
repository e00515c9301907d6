"""What a study of one scene means for its pictures: which settings to render with, as a few lines with commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ...base.text_tables import digits
from ...errors import InputError
from ...scene.model import Settings
from .measure import CODES, Measured
from .pareto import most_accurate_of_fastest, within_budget
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

    def stats(self, command: Command) -> dict[str, Any]:
        """Return it for JSON."""
        return {**self._texts(command), "variant": self.used.variant.name}

    def _texts(self, command: Command) -> dict[str, str]:
        return {"purpose": self.purpose, "found": self.found, "command": command(self.used.settings)}


def is_unseen(measured: Measured) -> bool:
    """Return whether nobody would see its difference from the converged image."""
    flip = measured.approximation.flip
    return measured.close >= CLOSE and (flip is None or flip <= FLIP)


def criterion(study: Study) -> str:
    """Return what `is_unseen` asks for, and what the chosen variant has of it."""
    used = _unseen(study)[0]
    close = f"{CLOSE:.0%} of pixels within {CODES} of 255 codes of the converged image ({used.close:.1%})"
    flip = used.approximation.flip
    found = "not measured" if flip is None else digits(flip, 2)
    return f"no visible error: {close}, and FLIP at most {FLIP:g} ({found})"


def answer(study: Study) -> list[Advice]:
    """Return at most five lines: the fastest variant whose difference is not seen, the most accurate within BUDGETS, what
    `render` draws by default, and whether more samples pay."""
    used, unseen = _unseen(study)
    found = [Advice("no visible error" if unseen else "closest", used, _cost(used))]
    found += [_within(study, budget) for budget in BUDGETS]
    default = study.default
    if default is not None:
        found.append(Advice("the default", default, f"{_cost(default)}{_compared(default, found)}"))
        found.append(_more_samples(study, default))
    return found


def _cost(measured: Measured) -> str:
    return f"{digits(measured.cost)} ms, RMSE {digits(measured.error, 2)}"


def _unseen(study: Study) -> tuple[Measured, bool]:
    """Return the fastest variant whose difference is not seen and True; if there is none the closest and False."""
    unseen = [each for each in study.measured if is_unseen(each)]
    if unseen:
        return most_accurate_of_fastest(unseen, study.reference.error), True
    return max(study.measured, key=lambda each: (each.close, -each.error)), False


def _within(study: Study, budget: float) -> Advice:
    """Return the most accurate variant within a budget; the fastest of all if none is."""
    purpose = f"within {budget:g} ms"
    try:
        used = within_budget(study.measured, budget, study.reference.error).used
        return Advice(purpose, used, _cost(used))
    except InputError:
        used = min(study.measured, key=lambda each: each.cost)
        return Advice(purpose, used, f"none; the fastest takes {_cost(used)}")


def _compared(default: Measured, others: Sequence[Advice]) -> str:
    """Return the time and the error of the default in those of other variants."""
    times = (default.cost / each.used.cost for each in others)
    errors = (default.error / each.used.error if each.used.error > 0.0 else 1.0 for each in others)
    time, error = (", ".join(f"x{digits(ratio, 2)}" for ratio in ratios) for ratios in (times, errors))
    return f"; to the above: time {time}, error {error}"


def _more_samples(study: Study, default: Measured) -> Advice:
    """Return whether more samples than the default has pay: whether the difference is then not seen, or much smaller."""
    purpose = "more samples"
    more = [each for each in study.measured if _samples(each) > _samples(default) and each.error < default.error]
    if is_unseen(default):
        return Advice(purpose, default, "not worth it, the error is not visible")
    enough = [each for each in more if is_unseen(each)]
    best = min(enough or more, key=lambda each: each.cost if enough else each.error, default=default)
    if not enough and best.error > WORTH * default.error:
        return Advice(purpose, default, f"not worth it, RMSE falls to {digits(best.error, 2)} at most")
    time, error = (f"x{digits(ratio, 2)}" for ratio in (best.cost / default.cost, best.error / default.error))
    seen = "not visible" if enough else "still visible"
    return Advice(purpose, best, f"worth it, time {time}, error {error}, which is {seen}")


def _samples(measured: Measured) -> tuple[int, bool]:
    return measured.settings.samples, measured.settings.sample_shading
