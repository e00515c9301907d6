"""What `python -m clshade render` chooses for a budget and for a tolerance, each several times."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...errors import OutputError
from .children import run_module

NAME = "choices"
ABOUT = "`render teapot --budget 20ms` and `--tolerance 0.01`, each in six processes: what they choose, in what time"
RUNS = 6
LIMITS = (("--budget", "20ms"), ("--tolerance", "0.01"))
RESOLUTION = "800,600"


@dataclass(frozen=True)
class Choices:
    """The choices of all runs for one limit. seconds: of each, spent on choosing. doubts: as `Selection.doubt`."""

    limit: str
    names: tuple[str, ...]
    seconds: tuple[float, ...]
    doubts: tuple[str, ...]

    def row(self) -> tuple[str, str, str, str]:
        """Return the limit, what was chosen how often, the seconds, and how many choices lay within noise."""
        counted = ", ".join(f"{name} {times} times" for name, times in Counter(self.names).most_common())
        doubtful = sum(map(bool, self.doubts))
        return self.limit, counted, f"{min(self.seconds):.1f} to {max(self.seconds):.1f}", str(doubtful)

    def line(self) -> str:
        """Return a line for the terminal."""
        limit, counted, seconds, doubtful = self.row()
        return f"{NAME} {limit}: {counted}, in {seconds} s; within noise {doubtful} times"

    def stats(self) -> dict[str, Any]:
        return dict(vars(self))


def choices(device: str, say: Callable[[str], object], runs: int = RUNS) -> tuple[Choices, ...]:
    """Render so many times for each limit; pass each result to `say`. The first run, which may compile, is not counted.

    Raises OutputError without a temporary folder, ChildError if rendering fails.
    """
    found = []
    try:
        folder = TemporaryDirectory()
    except OSError as error:
        raise OutputError(f"bench: temporary folder: expected one that can be written to, found: {error}") from None
    with folder as name:
        for limit in LIMITS:
            chosen = [_chosen(Path(name), device, limit) for _ in range(runs + 1)][1:]
            columns = (tuple(each[key] for each in chosen) for key in ("variant", "seconds", "doubt"))
            found.append(Choices(" ".join(limit), *columns))
            say(found[-1].line())
    return tuple(found)


def _chosen(folder: Path, device: str, limit: tuple[str, str]) -> dict[str, Any]:
    options = ("--resolution", RESOLUTION, "--device", device, "-o", "out", "--json")
    chosen: dict[str, Any] = json.loads(run_module("clshade", "render", "teapot", *limit, *options, cwd=folder))[
        "chosen"
    ]
    return chosen
