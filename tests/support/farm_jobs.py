"""A small job for several processes or a cluster to draw."""

import time
from pathlib import Path
from typing import Any

from clshade.farm.frames import orbit, parse_frames
from clshade.farm.job import Job, Task
from clshade.scene.builtin.scenes import builtin
from clshade.scene.camera import Camera
from clshade.scene.model import Settings


def job(device: str | None = None) -> Job:
    return Job(builtin("icosphere"), Settings.from_preset("course"), device=device, saving={"deterministic": True})


def tasks(folder: Path, count: int, resolution: tuple[int, int] = (32, 24)) -> list[Task]:
    """Return frames 1 to `count` of a turn."""
    frames = parse_frames(f"1..{count}")
    cameras = orbit(builtin("icosphere").camera.with_resolution(resolution), frames.numbers, frames)
    return [Task(number, camera, folder / f"{number:03d}") for number, camera in cameras.items()]


class HangingCamera(Camera):
    """A camera with which a frame never finishes."""

    def __getattribute__(self, name: str) -> Any:
        while name == "resolution":
            time.sleep(1.0)
        return super().__getattribute__(name)


def hanging(task: Task) -> Task:
    """Return the task with a camera that hangs."""
    camera = object.__new__(HangingCamera)
    camera.__dict__.update(task.camera.__dict__)
    return Task(task.number, camera, task.path)
