"""The stiff and extreme cases: each a generated scene or input with the outcome of a correct renderer.

Each module holds one kind of case, in a tuple `CASES`; `all_cases` sorts them by number.
"""

from __future__ import annotations

import re

from .bench import Bench, Case, Outcome

__all__ = ["Bench", "Case", "Outcome", "all_cases"]


def all_cases() -> tuple[Case, ...]:
    """Return every case, by number."""
    from . import (
        around,
        coverage,
        edges,
        extremes,
        files,
        light,
        lights,
        maps,
        microfacets,
        order,
        surfaces,
        transparency,
    )

    modules = (
        coverage,
        extremes,
        order,
        light,
        lights,
        microfacets,
        around,
        surfaces,
        maps,
        files,
        edges,
        transparency,
    )
    found = [case for module in modules for case in module.CASES]
    return tuple(sorted(found, key=lambda case: (int(re.sub(r"\D", "", case.number)), case.number)))
