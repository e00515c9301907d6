"""A run: which frames are still to be drawn, who draws them, how far it is, and what came of it."""

from __future__ import annotations

import importlib.util
import os
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import png, telling
from ..camera import Camera
from ..errors import InputError
from ..frame import check_output
from ..renderer import settle
from ..scene import Scene
from ..validation import integer, number
from .frames import Pattern, parse_pattern
from .job import Drawn, FrameWriter, Job, Lost, Task
from .local import MOST_WORKERS, draw_locally

if TYPE_CHECKING:
    from tqdm import tqdm


@dataclass(frozen=True)
class Run:
    """What came of a run.

    drawn, skipped: numbers of frames. lost: workers that ended before their frame was done. seconds: from start to end,
    starting workers included. draw_ms: median of what a frame took its worker to draw and write. size: bytes written.
    workers: those that drew frames.
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

    @property
    def rate(self) -> float:
        """Frames per second."""
        return self.drawn / self.seconds if self.seconds else 0.0

    def stats(self) -> dict[str, Any]:
        return {"frames": self.drawn + self.skipped, **asdict(self), "frames_per_second": self.rate}

    def lines(self) -> list[str]:
        """For the terminal."""
        skipped = f", {self.skipped:,} there already (--overwrite draws them again)" if self.skipped else ""
        lost = f"; {self.lost} ended early, the frames drawn again" if self.lost else ""
        workers = f"{self.workers} worker{'s' if self.workers != 1 else ''}{lost}"
        files = self.first if self.first == self.last else f"{self.first} ... {self.last}"
        return [
            f"frames  {self.drawn:,} drawn{skipped}",
            f"time    {self.seconds:.1f} s, {self.rate:.1f} frames/s, {self.draw_ms:.0f} ms a frame; {workers}",
            f"files   {files}, a PNG beside each ({self.size / 1e6:.1f} MB written)",
        ]


def draw_frames(
    scene: Scene,
    cameras: Mapping[int, Camera],
    output: str,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    timeout: float = 10.0,
    overwrite: bool = False,
    progress: bool = True,
    device: str | None = None,
    saving: Mapping[str, Any] | None = None,
    **settings: Any,
) -> Run:
    """Draws frames of a scene and writes each as EXR and PNG, the same files whoever draws them.

    cameras: by number of the frame. output: the files' names, such as `out.####.exr`.
    workers: processes on this machine; 1: this one. scheduler: address of a Dask scheduler, whose workers draw instead;
    timeout: seconds to wait for it. overwrite: draw frames whose two files exist, too; they are skipped otherwise. An
    existing file is whole, for files appear at once (`clshade.atomic`).
    progress: a bar on standard error. saving: keywords of `Frame.save`. settings: of `clshade.render`.
    With several workers a script needs the usual `if __name__ == "__main__":`.
    Raises InputError, DeviceError, OutputError, and WorkerError for workers that fail; what is drawn stays.
    """
    start = time.perf_counter()
    integer("draw_frames", "workers", workers, 1, MOST_WORKERS)
    number("draw_frames", "timeout", timeout, above=0.0)
    if not cameras:
        raise InputError("draw_frames: cameras: expected one or more, found none")
    pattern = parse_pattern(output, len(cameras))
    saving = dict(saving or {})
    check = {name: value for name, value in saving.items() if name in ("tonemap", "exposure", "compression")}
    scene, settled = settle(scene, **settings)
    left = [number for number in cameras if overwrite or not all(map(_is_there, pattern.names(number)))]
    if left:
        check_output(pattern.names(left[0])[0], **check)
    skipped = len(cameras) - len(left)
    if skipped:
        drawn_now = set(left)
        _compare_sizes(pattern, next(number for number in cameras if number not in drawn_now), cameras)
    job = Job(scene, settled, device, saving)
    tasks = (Task(number, cameras[number], Path(pattern.names(number)[0]).absolute()) for number in left)
    draw_ms: list[float] = []
    drawn_by: set[str] = set()
    size = lost = 0
    with _Progress(len(cameras), skipped, progress) as bar:
        for each in _results(job, tasks, workers, scheduler, timeout) if left else ():
            if isinstance(each, Lost):
                lost += 1
                many = len(each.numbers) > 1
                numbers = ", ".join(map(str, each.numbers))
                bar.say(f"frame{'s' * many} {numbers} drawn again: the worker {each.reason}")
                continue
            draw_ms.append(each.render_ms + each.save_ms)
            drawn_by.add(each.worker)
            size += each.size
            bar.advance(each)
    return Run(
        drawn=len(draw_ms),
        skipped=skipped,
        lost=lost,
        seconds=time.perf_counter() - start,
        draw_ms=_median(draw_ms),
        size=size,
        workers=len(drawn_by),
        first=pattern.names(min(cameras))[0],
        last=pattern.names(max(cameras))[0],
    )


def _is_there(name: str) -> bool:
    """Whether a file is; an empty one, which other programs leave, is no frame."""
    try:
        found = os.stat(name)
    except (OSError, ValueError):  # a null character, which `check_output` refuses
        return False
    return stat.S_ISREG(found.st_mode) and found.st_size > 0


def _compare_sizes(pattern: Pattern, number: int, cameras: Mapping[int, Camera]) -> None:
    """Warns of a frame that is there in another resolution, of an earlier run with other options."""
    name = pattern.names(number)[1]
    found, expected = png.resolution(name), cameras[number].resolution
    if found is not None and found != expected:
        there, here = ("{}x{}".format(*size) for size in (found, expected))
        telling.warning(f"{name}, there already, is {there}, not {here}: --overwrite draws what is there again")


def _results(
    job: Job, tasks: Iterable[Task], workers: int, scheduler: str | None, timeout: float
) -> Iterator[Drawn | Lost]:
    if scheduler is not None:
        if importlib.util.find_spec("distributed") is None:
            raise InputError('--scheduler: expected dask.distributed, found none: `pip install "clshade[cluster]"`')
        from .cluster import draw_on_cluster

        return draw_on_cluster(job, list(tasks), scheduler, timeout)
    if workers > 1:
        return draw_locally(job, tasks, workers)
    return _draw_here(job, tasks)


def _draw_here(job: Job, tasks: Iterable[Task]) -> Iterator[Drawn]:
    with FrameWriter(job) as writer:
        for task in tasks:
            yield writer.draw(task)


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2] if values else 0.0


class _Progress:
    """A bar with rate and remaining time on standard error, and lines above it; warnings of frames once each.

    It appears with the first frame: what is refused is told in one line.
    """

    def __init__(self, total: int, done: int, shown: bool) -> None:
        self._total, self._done, self._shown = total, done, shown
        self._start = time.time()  # tqdm's clock
        self._bar: tqdm | None = None
        self._said: set[str] = set()

    def _appear(self) -> tqdm:
        if self._bar is None:
            from tqdm import tqdm

            # A log gets a line now and then, a terminal what changes.
            interval = 0.1 if sys.stderr is not None and sys.stderr.isatty() else 10.0
            options = {"unit": "frame", "mininterval": interval, "smoothing": 0.1, "disable": not self._shown}
            self._bar = tqdm(total=self._total, initial=self._done, **options)
            self._bar.start_t = self._bar.last_print_t = self._start
        return self._bar

    def say(self, message: str) -> None:
        self._appear().clear()
        telling.warning(message)

    def advance(self, drawn: Drawn) -> None:
        for warning in drawn.warnings:
            if warning not in self._said:
                self._said.add(warning)
                self.say(f"frame {drawn.number}: {warning}")
        self._appear().update()

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()
