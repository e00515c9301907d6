"""Small kernels, each of one construct of OpenCL C that the renderer's kernels rely on, with what they have to write."""

from __future__ import annotations

from .case import Case
from .constructs_of_groups import groups
from .constructs_of_loops import loops
from .constructs_of_memory import memory
from .constructs_of_values import values
from .constructs_of_vectors import vectors


def all_cases(double: bool = True) -> list[Case]:
    """Return all cases. double: whether with those that need float64."""
    found = [*loops(), *groups(), *vectors(), *values(), *memory()]
    return [case for case in found if double or not case.double]
