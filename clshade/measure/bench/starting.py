"""Wall time of `python -m clshade render`, with and without cached programs."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from ...errors import ClshadeError, OutputError
from ..timing import Spread, in_turns, spread

NAME = "start-up"
ABOUT = "`python -m clshade render --samples 1`: wall time of the process with a warm cache, and with an empty one"
ROOT = Path(__file__).resolve().parents[3]
ROUNDS = 5
SECONDS = 60.0


class Start(NamedTuple):
    """Wall times of the whole process, in seconds, with a warm or an empty cache."""

    cache: str
    seconds: Spread
    rounds: int


def start_up(device: str, rounds: int = ROUNDS) -> list[Start]:
    """Measure both cases in turns. Raises OutputError without a temporary folder, ClshadeError if rendering fails."""
    try:
        folder = TemporaryDirectory()
    except OSError as error:
        raise OutputError(f"bench: temporary folder: expected one that can be written to, found: {error}") from None
    with folder as name:
        root = Path(name)
        _seconds(root, "warm", device)
        draws = [lambda _: _seconds(root, "warm", device), lambda number: _seconds(root, f"empty-{number}", device)]
        turns = in_turns(draws, rounds, SECONDS)
    both = zip(("warm", "empty"), zip(*turns, strict=True), strict=True)
    return [Start(cache, spread(times), len(turns)) for cache, times in both]


def _seconds(folder: Path, cache: str, device: str) -> float:
    """Return the seconds that a process takes, with its caches in a folder of this name."""
    (folder / cache).mkdir(exist_ok=True)
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    caches = {"XDG_CACHE_HOME": str(folder / cache), "POCL_CACHE_DIR": ""}
    command = [sys.executable, "-m", "clshade", "render", "--samples", "1", "-o", "out", "--device", device]
    start = time.perf_counter()
    environment = {**os.environ, "PYTHONPATH": path, **caches}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise ClshadeError(f"bench: {NAME}: {said[-1]}")
    return time.perf_counter() - start
