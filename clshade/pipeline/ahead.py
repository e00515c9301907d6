"""Programs that the next pictures are likely to need, compiled after a picture by a process that yields to all others."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.atomic_files import lock_file
from ..scene.geometry import bounding_box
from ..scene.model import Scene, Settings
from . import programs
from .opencl.environment import cache_root, keeps_cache
from .opencl.probe import can_probe, own_command
from .renderer import Renderer, trial_of
from .struct_layout import kernels_digest

AHEAD = "CLSHADE_COMPILE_AHEAD"  # environment variable: 0 turns it off
_DONE = "compiled-ahead"  # a file of the cache: the kernels for which all has been compiled


def start(scene: Scene, settings: Settings, device: str | None = None) -> None:
    """Start the process, which compiles the optimized programs of this scene first, unless there is nothing to compile.

    device: a name, None for CLSHADE_DEVICE or the default. The process ends by itself.
    """
    turned_off = os.environ.get(AHEAD, "0" if os.environ.get("CI") else "1") == "0"
    stores = any(program.folder is not None for program in programs.built())  # what PoCL compiles
    if turned_off or not (stores and can_probe() and keeps_cache()):
        return
    with contextlib.suppress(OSError):
        done = cache_root() / _DONE
        if not programs.this_thread.has_first and done.exists() and done.read_text() == kernels_digest():
            return
        with tempfile.TemporaryFile() as trial:
            trial.write(trial_of(scene, settings, ()))
            trial.seek(0)
            command, quiet = own_command("clshade.pipeline.ahead"), subprocess.DEVNULL
            variables = os.environ if device is None else {**os.environ, "CLSHADE_DEVICE": device}
            subprocess.Popen(command, stdin=trial, stdout=quiet, stderr=quiet, env=variables, start_new_session=True)


def main() -> None:
    """Compile what standard input describes, as `trial_of` does, and then what other scenes are likely to need."""
    _leave_processors()
    lock = lock_file(cache_root() / f"{_DONE}.lock")
    if lock is None:  # another process is at it
        return
    trial, pictures = sys.stdin.buffer.read(), 0
    for scene in ([pickle.loads(trial)[0]] if trial else []) + _likely():
        with contextlib.suppress(Exception), Renderer(**scene) as renderer:
            renderer.render()
            pictures += 1
            # From its middle, where faces are clipped: such a frame is sorted, by kernels that others do not launch.
            camera, middle = renderer.scene.camera, np.mean(bounding_box(renderer.scene), axis=0)
            renderer.render(replace(camera, eye=middle, lookat=middle + (camera.lookat - camera.eye)))
    if pictures:
        (cache_root() / _DONE).write_text(kernels_digest())


def _leave_processors() -> None:
    """Let this process, and the threads that it starts, run only while no other has work."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(19)
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if hasattr(os, "getsid") and os.getsid(0) == os.getpid():  # priorities count within a session
        with contextlib.suppress(OSError), open("/proc/self/autogroup", "wb") as group:
            group.write(b"19")


def _likely() -> list[dict[str, Any]]:
    """Return arguments of renderers for the shaders and settings that the command line takes most."""
    from ..scene.builtin.scenes import builtin

    scene = builtin("icosphere", resolution=(64, 48))
    kinds = ("pbr", 4, False), ("standard", 4, False), ("standard", 1, False), ("pbr", 4, True), ("standard", 4, True)
    return [{"scene": scene, "preset": p, "samples": n, "shadows": shadows} for p, n, shadows in kinds]
