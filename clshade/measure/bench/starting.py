"""Wall time of `python -m clshade render`, with and without cached programs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...errors import OutputError
from ..timing import Spread, in_turns, spread
from .children import run_module

NAME = "start-up"
ABOUT = "`python -m clshade render --samples 1`: wall time of the process with a warm cache, and with an empty one"
ROUNDS = 5
SECONDS = 60.0
WARM, EMPTY = 0.6, 3.0  # bars, seconds


@dataclass(frozen=True)
class Started:
    """Wall times of the whole process in seconds."""

    warm: Spread
    empty: Spread
    rounds: int

    def stats(self) -> dict[str, Any]:
        return {"warm_s": self.warm._asdict(), "empty_s": self.empty._asdict(), "rounds": self.rounds}


def start_up(device: str, rounds: int = ROUNDS) -> Started:
    """Measure both cases in turns. Raises OutputError without a temporary folder, ChildError if rendering fails."""
    try:
        folder = TemporaryDirectory()
    except OSError as error:
        raise OutputError(f"bench: temporary folder: expected one that can be written to, found: {error}") from None
    with folder as name:
        root = Path(name)
        _seconds(root, root / "warm", device)
        draws = [
            lambda _: _seconds(root, root / "warm", device),
            lambda number: _seconds(root, root / f"empty-{number}", device),
        ]
        turns = in_turns(draws, rounds, SECONDS)
    warm, empty = (spread(times) for times in zip(*turns, strict=True))
    return Started(warm, empty, len(turns))


def _seconds(folder: Path, cache: Path, device: str) -> float:
    cache.mkdir(exist_ok=True)
    caches = {"XDG_CACHE_HOME": str(cache), "POCL_CACHE_DIR": ""}
    start = time.perf_counter()
    run_module("clshade", "render", "--samples", "1", "-o", "out", "--device", device, cwd=folder, **caches)
    return time.perf_counter() - start
