"""Python processes of their own: a start from nothing, or a peak of memory that is nobody else's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from ...errors import ClshadeError
from .frame_timing import FrameTiming

ROOT = Path(__file__).resolve().parents[3]


class ChildError(ClshadeError):
    """A process failed; the message is the last line of what it said."""


def run_module(*arguments: object, cwd: Path | None = None, **variables: str) -> str:
    """Standard output of `python -m ARGUMENTS` with this clshade and further environment variables."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [sys.executable, "-m", *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": path, **variables},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise ChildError(f"bench: python -m {arguments[0]}: {said[-1]}")
    return done.stdout


def draw_apart(name: str, device: str, frames: int) -> FrameTiming:
    """`drawing.draw` of the workload of that name, in a process of its own, with its peak of memory."""
    return FrameTiming.from_stats(json.loads(run_module("clshade.measure.bench.apart", name, device, frames)))
