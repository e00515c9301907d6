"""The measurements of `report --peers`: every renderer on every scene, at one sample and at several."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Array
from ...pipeline.opencl.device import Device
from ...scene.model import Scene, Settings
from ..report.reference_image import averaged, best_settings
from ..timing import Spread, in_turns, spread
from . import PEERS, process
from .drawing import NO_DEPTH, SAMPLES, Picture
from .exact import Exact, exact
from .process import PeerError, Process
from .scenes import PeerScene, Resolution

CONVERGED = (8, 4)  # subpixels along a pixel's side, and samples in each, of the converged image: 256 a pixel
OTHER = 0.01  # of the scene's range of depths: a pixel that is farther off shows another surface
SECONDS = 20.0  # for the turns of a scene


class Errors(NamedTuple):
    """How wrong an image is. Of one sample: wrong: pixels of wrong coverage. other: that show another surface. depth,
    depth_largest: RMS and largest error of the others' depth, in scene units. color: RMSE of the linear color of these, or
    of several samples of all pixels. alpha: RMSE of the covered part, of several samples. None: not measured, or no
    pixel is left."""

    wrong: int | None = None
    other: int | None = None
    depth: float | None = None
    depth_largest: float | None = None
    color: float | None = None
    alpha: float | None = None


@dataclass(frozen=True)
class Result:
    """A renderer on a scene. same_runs, same_threads: whether the bits of two frames are equal, and those of one thread and
    of all; None: it has one. times: milliseconds of its frames, by round."""

    scene: str
    renderer: str
    samples: int
    title: str
    errors: Errors
    same_runs: bool
    same_threads: bool | None
    times: tuple[float, ...]

    @property
    def ms(self) -> Spread:
        return spread(self.times)

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {**vars(self), "errors": self.errors._asdict(), "ms": self.ms._asdict()}


class Failure(NamedTuple):
    """A renderer that could not draw a scene, or not all of it, and why, with its name."""

    scene: str
    renderer: str
    samples: int
    reason: str


Found = list["Result | Failure"]


def measure(
    chosen: PeerScene, resolution: Resolution, names: Sequence[str], device: Device, rounds: int, limit: float
) -> Found:
    """Draw a scene with all renderers, in turns. device: draws the converged image. limit: seconds for each answer."""
    scene = chosen.make(resolution)
    able = [name for name in names if not (chosen.backs and PEERS[name].backs)]
    found: Found = [
        Failure(chosen.name, name, samples, f"{name}: {PEERS[name].backs}")
        for name in names
        if name not in able
        for samples in SAMPLES
    ]
    right = exact(scene)
    converged = _converged(scene, device)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene"
        path.write_bytes(pickle.dumps(scene))
        for samples in SAMPLES:

            def errors(picture: Picture, samples: int = samples) -> Errors:
                return exact_errors(picture, right) if samples == 1 else converged_errors(picture, converged)

            mine = [name for name in able if samples > 1 or not PEERS[name].several]
            found += _at(chosen.name, path, samples, mine, errors, rounds, limit)
    return found


def _converged(scene: Scene, device: Device) -> Picture:
    """Return color and alpha of many samples a pixel, in float64."""
    best = best_settings(Settings.from_preset("standard"), device)
    (mesh,) = scene.meshes
    white = replace(scene, meshes=(replace(mesh, normals=None),))
    rgb = averaged(scene, device, best, *CONVERGED)
    alpha = averaged(white, device, replace(best, shader="nolight"), *CONVERGED)[..., 0]
    return Picture(rgb, NO_DEPTH, alpha)


def exact_errors(picture: Picture, right: Exact) -> Errors:
    """Return how wrong an image of one sample at the pixels' centers is. Pixels whose center is on an edge, where either
    answer is right, are left out."""
    covered = picture.alpha > 0.0
    wrong = (covered != right.covered) & ~right.tied
    both = covered & right.covered & ~right.tied
    depth = np.abs(picture.depth[both].astype(np.float64) - right.depth[both])
    span = float(np.ptp(right.depth[right.covered])) if right.covered.any() else 0.0
    other = ~(depth <= OTHER * span)
    color = picture.rgb[both][~other] - right.rgb[both][~other]
    return Errors(
        wrong=int(wrong.sum()),
        other=int(other.sum()),
        depth=_rms(depth[~other]),
        depth_largest=None if other.all() else float(depth[~other].max()),
        color=_rms(color),
    )


def converged_errors(picture: Picture, converged: Picture) -> Errors:
    """Return how wrong an image of several samples a pixel is."""
    return Errors(color=_rms(picture.rgb - converged.rgb), alpha=_rms(picture.alpha - converged.alpha))


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) if values.size else None


def same_bits(one: Picture, other: Picture) -> bool:
    return all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in zip(one, other, strict=True))


class _Open(NamedTuple):
    """A renderer that has drawn: its process, its first frame, and whether it draws the same with one thread."""

    process: Process
    picture: Picture
    same_runs: bool
    same_threads: bool | None


def _at(
    scene: str,
    path: Path,
    samples: int,
    names: Sequence[str],
    errors: Callable[[Picture], Errors],
    rounds: int,
    limit: float,
) -> Iterator[Result | Failure]:
    with ExitStack() as stack:
        drawn: list[_Open] = []
        for name in names:
            try:
                drawn.append(_opened(name, path, samples, limit, stack))
            except PeerError as error:
                yield Failure(scene, name, samples, str(error))
        failed: dict[str, str] = {}
        turns = [_turn(each.process, failed) for each in drawn]
        times = in_turns(turns, rounds, SECONDS) if turns else []
        for k, each in enumerate(drawn):
            mine = tuple(float(ms) for ms in (turn[k] for turn in times) if ms is not None)
            name, title = each.process.name, each.process.title
            if name in failed:
                yield Failure(scene, name, samples, failed[name])
            else:
                same = each.same_runs, each.same_threads
                yield Result(scene, name, samples, title, errors(each.picture), *same, mine)


def _opened(name: str, path: Path, samples: int, limit: float, stack: ExitStack) -> _Open:
    """Open a renderer twice, with one thread and with all; the first is closed. Raises PeerError."""
    of_one = None
    if not PEERS[name].single:
        with closing(Process(name, *process.command(name, path, samples, 1), limit)) as alone:
            alone.draw()
            of_one = alone.picture()
    running = stack.enter_context(closing(Process(name, *process.command(name, path, samples, 0), limit)))
    running.draw()
    picture = running.picture()
    running.draw()
    same_runs = same_bits(picture, running.picture())
    return _Open(running, picture, same_runs, None if of_one is None else same_bits(picture, of_one))


def _turn(running: Process, failed: dict[str, str]) -> Callable[[int], float | None]:
    """Return what draws two frames and returns the time of the second: after another program's frames, the first finds cold
    caches. One that fails is named in `failed`, and draws no more."""

    def turn(_: int) -> float | None:
        if running.name in failed:
            return None
        try:
            running.draw()
            return running.draw()
        except PeerError as error:
            failed[running.name] = str(error)
            return None

    return turn
