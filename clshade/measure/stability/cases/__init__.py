"""The stiff and extreme cases, each a scene or input made in code with the outcome that a right renderer has.

One module for each kind of case; each holds a tuple `CASES`. `all_cases` puts them in the order of their numbers.
"""

from __future__ import annotations

import re

from .bench import Bench, Case, Outcome

__all__ = ["Bench", "Case", "Outcome", "all_cases"]


def all_cases() -> tuple[Case, ...]:
    """Every case, by number."""
    from . import coverage, extremes, files, light, order, surfaces

    found = [case for module in (coverage, extremes, order, light, surfaces, files) for case in module.CASES]
    return tuple(sorted(found, key=lambda case: (int(re.sub(r"\D", "", case.number)), case.number)))
