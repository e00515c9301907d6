"""The stiff and extreme cases: each a generated scene or input with the outcome of a correct renderer.

Each module holds one kind of case, in a tuple `CASES`; `all_cases` sorts them by number.
"""

from __future__ import annotations

import re

from . import coverage, light, lights, order, shadows, surfaces
from .bench import Bench, Case, Outcome

__all__ = ["Bench", "Case", "Outcome", "all_cases"]

MODULES = coverage, order, light, lights, shadows, surfaces


def all_cases() -> tuple[Case, ...]:
    """Return every case, by number."""
    cases = [case for module in MODULES for case in module.CASES]
    return tuple(sorted(cases, key=lambda case: (int(re.sub(r"\D", "", case.number)), case.number)))
