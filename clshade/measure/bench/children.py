"""Child processes, to measure start-up times and the peak memory of one workload."""

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
    """Failure of a child process; the message is the last line of its output."""


def completed(*arguments: object, cwd: Path | None = None, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run `python -m ARGUMENTS` with this clshade and further environment variables; return its exit code and output."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        [sys.executable, "-m", *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": path, **variables},
        capture_output=True,
        text=True,
    )


def run_module(*arguments: object, cwd: Path | None = None, **variables: str) -> str:
    """Return the standard output of `completed`. Raises ChildError if the exit code is not 0."""
    done = completed(*arguments, cwd=cwd, **variables)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
        raise ChildError(f"bench: python -m {arguments[0]}: {said[-1]}")
    return done.stdout


def draw_apart(name: str, device: str, frames: int) -> FrameTiming:
    """Run `frame_timing.draw` on the named workload in a child process, and include its peak memory."""
    return FrameTiming.from_stats(json.loads(run_module("clshade.measure.bench.apart", name, device, frames)))
