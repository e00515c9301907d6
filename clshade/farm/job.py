"""What is to be drawn, and who draws and writes it: the part of a farm that runs wherever a frame is drawn."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import ClshadeError, WorkerError
from ..images.cryptomatte import MatteKind
from ..pipeline.flow import flow
from ..pipeline.frame import Frame
from ..pipeline.frame_files import FILES, FileKind, SavingOptions, chosen_paths, visible_path
from ..pipeline.frame_results import Flow, FlowName
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


@dataclass(frozen=True, eq=False)
class Beside:
    """Camera and pose of the frame before or after another one. name: of the flow that leads there."""

    name: FlowName
    camera: Camera
    pose: Pose | None = None


@dataclass(frozen=True, eq=False)
class Task:
    """A frame to draw. path: of its files, as for `Frame.save`, absolute: other processes have other current folders.
    files: which of them are written. pose: of the scene, None as it is. beside: the frames to which its flow leads."""

    number: int
    camera: Camera
    path: Path
    files: Sequence[FileKind] = FILES
    pose: Pose | None = None
    beside: tuple[Beside, ...] = ()

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
    warnings: tuple[str, ...]
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
        self._renderers: dict[bool, Renderer] = {}
        self._compiled: set[bool] = set()  # kinds of views of which a pose was drawn
        self._lock = threading.Lock()

    def _renderer(self, camera: Camera, compiled: bool) -> Renderer:
        """Return a renderer for perspective or for orthographic views; a job may have both.

        compiled: a new one draws a small image first, as some runtimes compile a kernel when it first runs.
        """
        with self._lock:
            kind = camera.orthographic
            if kind not in self._renderers:
                scene = replace(self._job.scene, camera=camera)
                renderer = Renderer(scene, settings=self._job.settings, device=self._job.device)
                self._renderers[kind] = renderer
                if compiled:
                    renderer.render(replace(self._job.scene.camera, orthographic=kind).with_resolution(SMALL))
            return self._renderers[kind]

    @contextlib.contextmanager
    def _renderer_of(self, task: Task, compiled: bool) -> Iterator[Renderer]:
        """Return a renderer of the task's pose in the block."""
        if task.pose is None:
            yield self._renderer(task.camera, compiled)
            return
        scene = replace(task.pose.of(self._job.scene), camera=task.camera)
        with Renderer(scene, settings=self._job.settings, device=self._job.device) as renderer:
            kind = task.camera.orthographic
            if compiled and kind not in self._compiled:
                renderer.render(task.camera.with_resolution(SMALL))
                self._compiled.add(kind)
            yield renderer

    def _flow(self, frame: Frame, beside: Beside) -> Flow:
        scene = self._job.scene if beside.pose is None else beside.pose.of(self._job.scene)
        return flow(frame, replace(scene, camera=beside.camera), device=self._job.device)

    def draw(self, task: Task, ready: Callable[[], None] | None = None) -> DrawnFrame:
        """Draw and write a frame. ready: called when the kernels are compiled and only the frame's own work is left.

        Raises a ClshadeError that names the frame: WorkerError, with the traceback as a note, for a bug.
        """
        try:
            start = time.perf_counter()
            with self._renderer_of(task, compiled=ready is not None) as renderer:
                if ready is not None:
                    ready()
                frame = renderer.render(task.camera)
            frame.flows = {beside.name: self._flow(frame, beside) for beside in task.beside}
            if self._job.mattes:
                frame.mattes = cryptomatte(frame, self._job.mattes, device=self._job.device)
            if self._job.visible is not None:
                table = visible(frame.scene, settings=frame.settings, device=self._job.device)
                table.save(visible_path(task.path, self._job.visible))
            drawn = time.perf_counter()
            saving: SavingOptions = {**self._job.saving, "files": task.files}
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
        return DrawnFrame(task.number, (drawn - start) * 1e3, (done - drawn) * 1e3, size, tuple(warnings), worker)

    def close(self) -> None:
        with self._lock:
            while self._renderers:
                self._renderers.popitem()[1].close()

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
