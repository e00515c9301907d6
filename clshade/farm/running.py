"""A run: the frames left to draw, who draws them, its progress on standard error, and its result."""

from __future__ import annotations

import importlib.util
import os
import stat
import statistics
import sys
import time
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ..base import console
from ..base.atomic_files import folder_made, shown
from ..base.progress_bar import Bar
from ..base.validation import arguments, choice, flag, integer, items, keywords, number, text, value_error
from ..errors import InputError
from ..images.cryptomatte import MatteKind
from ..images.figures import bar_width
from ..images.image_file import resolution_of
from ..pipeline.effective_settings import effective_settings
from ..pipeline.frame_files import FILES, SAVING, FileKind, SavingOptions, check_layers, check_output, chosen_paths
from ..pipeline.frame_results import FLOWS
from ..pipeline.visible import check_mattes
from ..scene.camera import Camera
from ..scene.model import Scene
from ..scene.pose import Pose
from ..scene.settings import FrameOptions
from .frames import Pattern, parse_pattern
from .job import DrawnFrame, FrameWriter, Job, Lost, Silent, Task
from .local import MOST_WORKERS, draw_locally

if TYPE_CHECKING:
    from typing_extensions import Unpack


_NAMES: dict[FileKind, str] = {"exr": "an EXR", "png": "a PNG", "npz": "an NPZ", "depth": "a depth PNG"}
_QUICKEST: tuple[FileKind, ...] = ("png", "depth", "exr", "npz")  # to read the resolution of
LINES = 10.0  # seconds between two lines of progress without a terminal
_MAX_COMPARED = 1000  # files of earlier runs whose sizes are looked at


def rate_text(rate: float) -> str:
    return f"{rate:.1f} frames/s" if rate >= 10.0 else f"{rate:.3g} frames/s"


@dataclass(frozen=True)
class Run:
    """The result of a run.

    Attributes
    ----------
    drawn, skipped, lost : int
        Numbers of frames drawn, of frames that existed already, and of workers that ended or hung
        before their frame was done.
    seconds : float
        Time until the last frame was drawn, including starting workers and compiling kernels.
    draw_ms : float
        Median time a worker took to draw and write a frame, in ms.
    size : int
        Bytes written.
    workers : int
        Number of workers that drew frames.
    first, last : str
        Names of the files with the lowest and the highest number, the first of each frame's.
    files : tuple of str
        Which files each frame has, see `Frame.save`.
    """

    drawn: int
    skipped: int
    lost: int
    seconds: float
    draw_ms: float
    size: int
    workers: int
    first: str
    last: str
    files: tuple[FileKind, ...] = FILES

    @property
    def rate(self) -> float:
        """Frames drawn per second, as the progress bar shows it; skipped frames do not count."""
        return self.drawn / self.seconds if self.seconds else 0.0

    def stats(self) -> dict[str, Any]:
        """Return the figures as a dict for JSON."""
        return {"frames": self.drawn + self.skipped, **asdict(self), "frames_per_second": self.rate}

    def lines(self) -> list[str]:
        """Return the result as lines for the terminal."""
        skipped = f", {self.skipped:,} there already (--overwrite draws them again)" if self.skipped else ""
        lost = f"; {self.lost} lost, the frames drawn again" if self.lost else ""
        workers = f"{self.workers} worker{'s' if self.workers != 1 else ''}{lost}"
        speed = f"{rate_text(self.rate)}; a frame {self.draw_ms:.0f} ms (median)"
        files = shown(self.first) if self.first == self.last else f"{shown(self.first)} ... {shown(self.last)}"
        others = " and ".join(_NAMES[kind] for kind in self.files[1:])
        beside = f", {others} beside each" if others else ""
        return [
            f"frames  {self.drawn:,} drawn{skipped}",
            *([f"time    {self.seconds:.1f} s, {speed}; {workers}"] if self.drawn else []),
            f"files   {files}{beside} ({self.size / 1e6:.1f} MB written)",
        ]


@arguments(
    workers=partial(integer, least=1, most=MOST_WORKERS),
    timeout=partial(number, above=0.0),
    frame_timeout=partial(number, above=0.0),
    overwrite=flag,
    progress=flag,
    saving=partial(keywords, allowed=SAVING),
    scheduler=text,
    flow=flag,
    visible=partial(choice, allowed=("csv", "json")),
    mattes=items,
)
def draw_frames(
    scene: Scene,
    cameras: Mapping[int, Camera],
    output: str,
    *,
    poses: Mapping[int, Pose] | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    timeout: float = 10.0,
    frame_timeout: float | None = None,
    overwrite: bool = False,
    progress: bool = True,
    device: str | None = None,
    saving: SavingOptions | None = None,
    flow: bool = False,
    visible: Literal["csv", "json"] | None = None,
    mattes: Sequence[MatteKind] = (),
    **settings: Unpack[FrameOptions],
) -> Run:
    """Draw frames of a scene and write each as EXR and PNG, or other files, the same whoever draws them.

    Frames whose files exist are skipped, and refused if their resolution is another one. They are
    complete, for files are replaced atomically (``clshade.base.atomic_files``).

    With several workers a script needs the usual ``if __name__ == "__main__":``.

    Parameters
    ----------
    scene : Scene
        The scene to draw.
    cameras : mapping of int to Camera
        Camera of each frame, by frame number; the frame has its resolution.
    output : str
        Name of the files, such as ``"out.####.exr"``, with one run of # for the number of the
        frame. The folder is created if missing, and removed again if nothing is drawn.
    poses : mapping of int to Pose, optional
        What each frame changes in the scene, by frame number, as from `clshade.load_animation`.
    workers : int, default 1
        Number of processes on this machine, 1 to 256; 1 means this process.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers draw instead, such as ``"tcp://host:8786"``.
    timeout : float, default 10.0
        Seconds to wait for the scheduler.
    frame_timeout : float, optional
        Seconds after which a worker whose kernels are compiled counts as hanging if it has not drawn
        its frame: others draw what it has. Default: wait for it, with a warning after ten seconds.
    overwrite : bool, default False
        Draw frames whose files exist as well.
    progress : bool, default True
        Show a progress bar, or lines, on standard error.
    saving : dict, optional
        Keywords of `Frame.save`.
    flow : bool, default False
        Write optical flow (`clshade.flow`) and the layer id to the EXR of each frame: as ``flow`` to the
        frame with the next number, as ``flow_back`` to the one before, with the masks of what these do
        not show. The first frame has no ``flow_back``, the last no ``flow``.
    visible : {"csv", "json"}, optional
        Write the table of `clshade.visible` beside each frame: ``out.0001_visible.csv``.
    mattes : sequence of {"object", "material", "instance"}, optional
        Write Cryptomatte layers of these kinds to the EXR of each frame, see `clshade.cryptomatte`.
    device, **settings
        See `clshade.render`.

    Raises
    ------
    InputError, DeviceError, OutputError, WorkerError
        If an argument is refused, no OpenCL device works, a file cannot be written, or workers fail.
        Frames already drawn stay.

    Examples
    --------
    >>> import clshade
    >>> from clshade import farm
    >>> scene = clshade.builtin("teapot", resolution=(320, 240))
    >>> frames = farm.parse_frames("1..36")
    >>> cameras = farm.orbit(scene.camera, frames.numbers, frames)
    >>> run = farm.draw_frames(scene, cameras, "out.##.exr", samples=4)
    """
    check_numbered(cameras, poses)  # each camera is checked when its frame is drawn
    if frame_timeout is not None and workers == 1 and scheduler is None:
        expected = "two --workers or more, or a --scheduler, to draw the frames of one that hangs"
        raise InputError(f"--frame-timeout: needs {expected}")
    pattern = parse_pattern(output, len(cameras))
    options: SavingOptions = {**saving} if saving else {}
    scene, settled = effective_settings(scene, **settings)
    files = options["files"] = tuple(chosen_paths(output, options.get("files")))
    if flow:
        if not {"exr", "npz"} & set(files):
            raise InputError("draw_frames: flow: needs exr or npz among the files, which hold it")
        settled = replace(settled, layers=(*settled.layers, "id"))
    check_layers(files, settled.layers)
    if mattes:
        check_mattes(mattes, files)
    left = list(cameras) if overwrite else _left(pattern, cameras, files)
    skipped = len(cameras) - len(left)
    if skipped:
        _compare_sizes(pattern, files, cameras, left, colorbar=options.get("colorbar", False))
    folder = Path(pattern.names(next(iter(cameras)))[0]).parent
    with folder_made(folder), Progress(len(cameras), skipped, progress) as bar:
        results: Iterator[DrawnFrame | Lost | Silent] = iter(())
        if left:
            check_output(pattern.names(left[0])[0], settled, **options)
            job = Job(scene, settled, device, options, visible, mattes)
            tasks = _tasks(cameras, poses, pattern, left, files, flow=flow)
            results = _results(job, tasks, workers, scheduler, timeout, frame_timeout)
        bar.follow(results, limited=frame_timeout is not None)
    return Run(
        drawn=bar.drawn,
        skipped=skipped,
        lost=bar.lost,
        seconds=bar.seconds,
        draw_ms=statistics.median(bar.draw_ms or [0.0]),
        size=bar.size,
        workers=len(bar.workers),
        first=pattern.names(min(cameras), files)[0],
        last=pattern.names(max(cameras), files)[0],
        files=files,
    )


def check_numbered(cameras: Mapping[int, Camera], poses: Mapping[int, Pose] | None) -> None:
    """Raise InputError for anything but cameras, and poses or none, by numbers of frames."""
    numbered = isinstance(cameras, Mapping) and all(isinstance(number, Integral) for number in cameras)
    if not numbered or not cameras:
        raise value_error("draw_frames", "cameras", "a camera or more by number of the frame, as {1: camera}", cameras)
    if poses is not None and not (isinstance(poses, Mapping) and all(number in poses for number in cameras)):
        raise value_error("draw_frames", "poses", "a pose for the number of each camera, as {1: pose}", poses)


def _camera(cameras: Mapping[int, Camera], number: int) -> Camera:
    camera = cameras[number]
    if not isinstance(camera, Camera):
        raise value_error("draw_frames", f"cameras: frame {number}", "a Camera", camera)
    return camera


# Frames of earlier runs


def _left(pattern: Pattern, numbers: Iterable[int], files: Sequence[FileKind] = FILES) -> list[int]:
    """Return the frames that lack one of their files. The folder is listed once: a stat per file of a million
    frames takes a minute."""
    folder = os.path.dirname(pattern.names(0)[0]) or os.curdir
    listed: set[str] | None = None  # a folder that may be entered but not read, or an invalid name
    try:
        listed = {name.lower() for name in os.listdir(folder)}
    except FileNotFoundError:
        return list(numbers)
    except (OSError, ValueError):
        pass

    def is_there(name: str) -> bool:
        # Some file systems ignore case, or Unicode normalization.
        base = os.path.basename(name)
        return (listed is None or base.lower() in listed or not base.isascii()) and _is_there(name)

    return [number for number in numbers if not all(map(is_there, pattern.names(number, files)))]


def _is_there(name: str) -> bool:
    """Return whether a non-empty file exists; an empty one, which other programs leave, is no frame."""
    try:
        status = os.stat(name)
    except (OSError, ValueError):  # a null character, which `check_output` refuses
        return False
    return stat.S_ISREG(status.st_mode) and status.st_size > 0


def _compare_sizes(
    pattern: Pattern, files: Sequence[FileKind], cameras: Mapping[int, Camera], left: Iterable[int], *, colorbar: bool
) -> None:
    """Raise InputError if a frame that is not left has another resolution than its camera."""
    kind = next(kind for kind in _QUICKEST if kind in files)
    skipped = sorted(set(cameras).difference(left))
    for frame in skipped[:: -(-len(skipped) // _MAX_COMPARED)]:
        (name,) = pattern.names(frame, (kind,))
        columns, rows = _camera(cameras, frame).resolution
        if kind == "png" and colorbar:
            columns += bar_width(rows)
        size = resolution_of(name)
        if size is not None and size != (columns, rows):
            problem = "found {}x{} of an earlier run: --overwrite draws it again".format(*size)
            raise InputError(f"{shown(name)}: expected {columns}x{rows} of the frames to draw, {problem}")


# Frames to draw


def _tasks(
    cameras: Mapping[int, Camera],
    poses: Mapping[int, Pose] | None,
    pattern: Pattern,
    left: Iterable[int],
    files: Sequence[FileKind],
    *,
    flow: bool,
) -> Iterator[Task]:
    after = dict(pairwise(sorted(cameras))) if flow else {}
    before = {later: number for number, later in after.items()}

    def view(number: int) -> tuple[Camera, Pose | None]:
        return _camera(cameras, number), None if poses is None else poses[number]

    for frame in left:
        targets = zip(FLOWS, (after.get(frame), before.get(frame)), strict=True)
        flows = {name: view(target) for name, target in targets if target is not None}
        camera, pose = view(frame)
        yield Task(frame, camera, Path(pattern.names(frame)[0]).absolute(), files, pose, flows)


def _results(
    job: Job, tasks: Iterable[Task], workers: int, scheduler: str | None, timeout: float, frame_timeout: float | None
) -> Iterator[DrawnFrame | Lost | Silent]:
    if scheduler is not None:
        if importlib.util.find_spec("distributed") is None:
            raise InputError('--scheduler: expected dask.distributed, found none: `pip install "dask[distributed]"`')
        from .cluster import draw_on_cluster

        yield from draw_on_cluster(job, tasks, scheduler, timeout, frame_timeout)
    elif workers > 1:
        yield from draw_locally(job, tasks, workers, frame_timeout)
    else:
        with FrameWriter(job) as writer:
            yield from map(writer.draw, tasks)


class Progress:
    """A counter of frames that shows progress, and each distinct warning once. Nothing is shown before the first frame,
    so that a refusal is a single line.

    total: frames of the run. done: those that existed before it, which do not count in the rate.
    """

    def __init__(self, total: int, done: int, visible: bool) -> None:
        self._total, self._done, self._shown = total, done, visible and sys.stderr is not None
        self._start, self._began = time.perf_counter(), time.time()  # for the rate, and for the bar
        self._bar: Bar | None = None
        self._last_line = self._start
        self._warnings: set[str] = set()
        self.draw_ms = array("d")  # to draw and write each frame
        self.workers: set[str] = set()
        self.size = self.lost = 0  # bytes, workers
        self.seconds = 0.0  # from the start to the latest frame
        self._first = 0.0  # to the first one, which waits for the compiler: it says nothing about those to come

    @property
    def drawn(self) -> int:
        return len(self.draw_ms)

    @property
    def rate(self) -> float:
        """Frames drawn per second, since the start."""
        return self.drawn / self.seconds if self.seconds else 0.0

    def follow(self, results: Iterable[DrawnFrame | Lost | Silent], limited: bool) -> None:
        """Count the results as they come, and report losses and silence. limited: hanging workers are replaced."""
        for result in results:
            if isinstance(result, DrawnFrame):
                self.advance(result)
                continue
            frames = f"frame{'s' * (len(result.numbers) > 1)} {', '.join(map(str, result.numbers))}"
            if isinstance(result, Lost):
                self.lost += 1
                self.say(f"{frames} drawn again: the worker {result.reason}")
            else:
                hint = "" if limited else " (--frame-timeout SECONDS gives frames of such workers to others)"
                self.say(f"no sign of worker {result.worker} for {result.seconds:.0f} s, at {frames}{hint}")

    def say(self, message: str) -> None:
        """Print a warning above the bar."""
        if self._bar is not None:
            self._bar.clear()
        console.warning(message)

    def advance(self, frame: DrawnFrame) -> None:
        for warning in frame.warnings:
            if warning not in self._warnings:
                self._warnings.add(warning)
                self.say(f"frame {frame.number}: {warning}")
        self.draw_ms.append(frame.render_ms + frame.save_ms)
        self.workers.add(frame.worker)
        self.size += frame.size
        self.seconds = time.perf_counter() - self._start
        self._first = self._first or self.seconds
        if self._shown and sys.stderr.isatty():
            if self._bar is None:
                self._bar = Bar(self._total, clock=time.perf_counter, done=self._done, left=True, began=self._began)
            self._bar.advance(rate_text(self.rate))
        elif self._shown:
            self._print_line()

    def _print_line(self) -> None:
        """Print a line: a log would keep every state of a bar."""
        count, now = self._done + self.drawn, self._start + self.seconds
        if count < self._total and now - self._last_line < LINES:
            return
        self._last_line = now
        line = f"{count}/{self._total} frames, {rate_text(self.rate)}"
        if count < self._total and self.seconds > self._first:
            left = (self._total - count) * (self.seconds - self._first) / (self.drawn - 1)
            line += f", about {left:.0f} s left"
        console.progress(line)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
