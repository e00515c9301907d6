"""What is to be drawn, and who draws and writes it: the part of a farm that runs wherever a frame is drawn."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..errors import ClshadeError, WorkerError
from ..images.cryptomatte import MatteKind
from ..pipeline.flow import flow
from ..pipeline.frame_files import FILES, FileKind, SavingOptions, chosen_paths, visible_path
from ..pipeline.frame_results import FlowName
from ..pipeline.renderer import Renderer
from ..pipeline.visible import cryptomatte, visible
from ..scene.camera import Camera
from ..scene.model import Scene, Settings
from ..scene.pose import Pose

SMALL = (16, 16)  # pixels of an image drawn only to compile its kernels


@dataclass(frozen=True, eq=False)
class Job:
    """What all frames share. device: a name as for `open_device`. saving: arguments of `Frame.save`. visible: ending of
    each frame's table of instances, None without one. mattes: kinds of Cryptomatte layers in each EXR."""

    scene: Scene
    settings: Settings
    device: str | None
    saving: SavingOptions
    visible: str | None = None
    mattes: Sequence[MatteKind] = ()

    def view(self, camera: Camera, pose: Pose | None) -> Scene:
        """Return the scene in a pose, None as it is, with a camera."""
        return replace(self.scene if pose is None else pose.of(self.scene), camera=camera)


@dataclass(frozen=True, eq=False)
class Task:
    """A frame to draw. path: of its files, as for `Frame.save`, absolute: other processes have other current folders.
    files: which of them are written. pose: of the scene, None as it is. flows: camera and pose of the frames to which
    its flow leads."""

    number: int
    camera: Camera
    path: Path
    files: Sequence[FileKind] = FILES
    pose: Pose | None = None
    flows: Mapping[FlowName, tuple[Camera, Pose | None]] = field(default_factory=dict)

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return list(chosen_paths(self.path, self.files).values())


@dataclass(frozen=True)
class DrawnFrame:
    """A frame whose files are written. render_ms, save_ms: time to draw and to write it. size: bytes of its files.
    worker: the process that drew it, host:pid."""

    number: int
    render_ms: float
    save_ms: float
    size: int
    warnings: Sequence[str]
    worker: str


@dataclass(frozen=True)
class Lost:
    """A worker that ended before these frames were done; others draw them. reason: how it ended, a predicate."""

    numbers: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Silent:
    """A worker, its process id or address, that has given no sign of these frames for `seconds`."""

    numbers: tuple[int, ...]
    worker: str
    seconds: float


class FrameWriter:
    """A renderer and writer of a job's frames. The scene stays on the device from the first frame on, until `close`; poses
    are uploaded each for its frame."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._renderers: dict[bool, Renderer] = {}  # of perspective and of orthographic views; a job may have both
        self._compiled: set[bool] = set()  # those of which a small image was drawn
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def _renderer(self, task: Task, compiled: bool) -> Iterator[Renderer]:
        """Yield a renderer of the task's pose. compiled: its kernels are compiled before."""
        if task.pose is not None:
            with self._open(task, compiled) as renderer:
                yield renderer
            return
        kind = task.camera.orthographic
        with self._lock:
            if kind not in self._renderers:
                self._renderers[kind] = self._open(task, compiled)
        yield self._renderers[kind]

    def _open(self, task: Task, compiled: bool) -> Renderer:
        job, kind = self._job, task.camera.orthographic
        renderer = Renderer(job.view(task.camera, task.pose), settings=job.settings, device=job.device)
        if compiled and kind not in self._compiled:  # by a small image, as some runtimes compile what first runs
            try:
                renderer.render(replace(job.scene.camera, orthographic=kind).with_resolution(SMALL))
            except BaseException:
                renderer.close()
                raise
            self._compiled.add(kind)
        return renderer

    def draw(self, task: Task, ready: Callable[[], None] | None = None) -> DrawnFrame:
        """Draw and write a frame. ready: called when the kernels are compiled and only the frame's own work is left.

        Raises a ClshadeError that names the frame: WorkerError, with the traceback as a note, for a bug.
        """
        try:
            start = time.perf_counter()
            with self._renderer(task, compiled=ready is not None) as renderer:
                if ready is not None:
                    ready()
                frame = renderer.render(task.camera)
            job = self._job
            frame.flows = {name: flow(frame, job.view(*to), device=job.device) for name, to in task.flows.items()}
            if job.mattes:
                frame.mattes = cryptomatte(frame, job.mattes, device=job.device)
            if job.visible is not None:
                table = visible(frame.scene, settings=frame.settings, device=job.device)
                table.save(visible_path(task.path, job.visible))
            end = time.perf_counter()
            saving: SavingOptions = {**job.saving, "files": task.files}
            warnings = frame.write(task.path, **saving)
            done = time.perf_counter()
            size = sum(path.stat().st_size for path in task.paths)
        except ClshadeError as error:
            raise type(error)(f"frame {task.number}: {error}") from error
        except Exception as error:
            failure = WorkerError(f"frame {task.number}: {type(error).__name__}: {error}")
            failure.__notes__ = [traceback.format_exc()]  # pickled with it, unlike its cause
            raise failure from error
        worker = f"{socket.gethostname()}:{os.getpid()}"
        return DrawnFrame(task.number, (end - start) * 1e3, (done - end) * 1e3, size, tuple(warnings), worker)

    def close(self) -> None:
        with self._lock:
            while self._renderers:
                self._renderers.popitem()[1].close()

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
