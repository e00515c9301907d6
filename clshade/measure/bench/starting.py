"""Wall time of `python -m clshade render`, with and without cached programs."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ...errors import ClshadeError
from ...pipeline.programs import AHEAD
from ..timing import Spread, in_turns, spread

NAME = "start-up"
ABOUT = "`python -m clshade render --samples 1`: wall time of the process with a warm cache, and with an empty one"
ROUNDS = 5
SECONDS = 60.0


class Start(NamedTuple):
    """Wall times of the whole process, in seconds, with a warm or an empty cache."""

    cache: str
    seconds: Spread
    rounds: int


def start_up(device: str, rounds: int = ROUNDS) -> list[Start]:
    """Measure both cases in turns. Raises ClshadeError if rendering fails."""
    with TemporaryDirectory() as name:
        root = Path(name)
        _seconds(root, "warm", device)
        draws = [lambda _: _seconds(root, "warm", device), lambda number: _seconds(root, f"empty-{number}", device)]
        turns = in_turns(draws, rounds, SECONDS)
    both = zip(("warm", "empty"), zip(*turns, strict=True), strict=True)
    return [Start(cache, spread(times), len(turns)) for cache, times in both]


def _seconds(folder: Path, cache: str, device: str) -> float:
    """Return the seconds that a process takes, with its caches in a folder of this name."""
    own = folder / cache
    own.mkdir(exist_ok=True)
    environment = {**os.environ, "XDG_CACHE_HOME": str(own), "POCL_CACHE_DIR": "", AHEAD: "0"}
    out = ("-o", str(folder / "out"), "--device", device)
    start = time.perf_counter()
    command = [sys.executable, "-m", "clshade", "render", "--samples", "1", *out]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise ClshadeError(f"bench: {NAME}: {said[-1]}")
    return time.perf_counter() - start
