"""`python -m clshade fuzz`: random scenes against the float64 oracle, mutated files against the loaders."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TextIO

import numpy as np

from .. import oracle, telling
from ..device import Device, open_device
from ..errors import InputError
from ..features import OPTIONAL
from ..frame import Frame
from ..oracle import OracleFrame
from ..renderer import Renderer
from ..scene import Scene, Settings
from ..validation import Array
from . import compare, mutations
from .compare_layers import assert_layers
from .random_scenes import Drawn, scene_of

ALPHA_MARGIN = 1e-5  # alpha this near to the cutoff: float32 may decide either way (see `decided_by_alpha`)
SHRINKING = 20.0  # seconds spent on making a failing scene smaller


@dataclass(frozen=True)
class Failure:
    """What went wrong with scene or file `number`. shrunk: how little of the scene still does it."""

    what: str
    number: int
    reason: str
    shrunk: str = ""

    def __str__(self) -> str:
        return f"{self.what} {self.number}: {self.reason}" + (f" [{self.shrunk}]" if self.shrunk else "")


def draw(device: Device, drawn: Drawn) -> Frame:
    """The frame of a random scene, all layers; in float32 where the device has no float64. A warning of arithmetic is an
    error."""
    kind, settings = drawn.kind, drawn.settings
    lanes = kind.lanes if device.is_cpu else None
    if not device.has_fp64:
        settings = replace(settings, precision="float32")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        with Renderer(
            drawn.scene, device=device, settings=settings, forced=() if kind.specialize else OPTIONAL, lanes=lanes
        ) as renderer:
            return renderer.render()


def decided_by_alpha(scene: Scene, settings: Settings) -> Array:
    """(M, N) bool: pixels of which some sample's owner depends on alphas within ALPHA_MARGIN of their cutoff.

    Alpha is a mean of at most four texels with weights that float32 pairs give to 2^-22, and is rounded in float32:
    some 2^-21 of the largest alpha, 1, in all. The margin is ten times that.
    """

    def moved(margin: float) -> OracleFrame:
        meshes = []
        for mesh in scene.meshes:
            cutoff = mesh.material.alpha_cutoff
            changed = mesh.material if cutoff is None else replace(mesh.material, alpha_cutoff=cutoff + margin)
            meshes.append(replace(mesh, material=changed))
        return oracle.render(replace(scene, meshes=tuple(meshes)), settings)

    less, more = moved(-ALPHA_MARGIN), moved(ALPHA_MARGIN)
    return (less.id != more.id) | (less.alpha != more.alpha) | (less.rgb != more.rgb).any(axis=-1)


def problem(frame: Frame, expected: OracleFrame | None = None) -> str:
    """What is wrong with a frame, "" if nothing: ids and coverage exact but for proven ties, depths within roundings, colors
    and further layers within their bounds, all finite."""
    scene, settings = frame.scene, frame.settings
    with np.errstate(all="ignore"):
        if expected is None:
            expected = oracle.render(scene, settings)
        try:
            skip = _excused_by_alpha(frame, expected)
            # Images of a few pixels may lie at a gate wholly.
            compare.assert_frame(frame, expected, scene, settings, gate_fraction=1.0, skip=skip)
            ties = compare.assert_same_ids(frame, expected, scene, settings, skip=skip)
            assert_layers(frame, oracle.render_layers(scene, settings), scene, settings, skip=ties)
        except AssertionError as error:
            return " ".join(str(error).split())
    return ""


def _excused_by_alpha(frame: Frame, expected: OracleFrame) -> Array | None:
    """(M, N) bool: pixels that an alpha test may have decided either way, where owners or coverage differ; else None."""
    scene, settings = frame.scene, frame.settings
    if all(mesh.material.alpha_cutoff is None for mesh in scene.meshes):
        return None
    try:
        compare.assert_same_ids(frame, expected, scene, settings)
    except AssertionError:
        return decided_by_alpha(scene, settings)
    return None


def scene_problem(device: Device, drawn: Drawn) -> str:
    """What is wrong with the frame of a scene, or with drawing it at all."""
    try:
        frame = draw(device, drawn)
    except Exception as error:  # a valid scene: whatever it meets is a finding
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return problem(frame)


def shrink(drawn: Drawn, failing: Callable[[Drawn], bool], seconds: float = SHRINKING) -> str:
    """How little of a failing scene fails too, in words. The first mesh stays: it keeps the program the same."""
    end = time.perf_counter() + seconds

    def attempt(scene: Scene) -> bool:
        nonlocal drawn
        if time.perf_counter() > end or not failing(replace(drawn, scene=scene)):
            return False
        drawn = replace(drawn, scene=scene)
        return True

    for kind in ("meshes", "lights"):
        for k in reversed(range(1, len(getattr(drawn.scene, kind)))):
            items = getattr(drawn.scene, kind)
            fewer: dict[str, Any] = {kind: (*items[:k], *items[k + 1 :])}
            attempt(replace(drawn.scene, **fewer))
    for k in range(1, len(drawn.scene.meshes)):
        step = len(drawn.scene.meshes[k].faces) // 2
        while step:
            start = 0
            while start < len(drawn.scene.meshes[k].faces) > 1:
                if not attempt(_without(drawn.scene, k, slice(start, start + step))):
                    start += step
            step //= 2
    faces = [len(mesh.faces) for mesh in drawn.scene.meshes]
    return f"so do meshes of {faces} faces with {len(drawn.scene.lights)} lights"


def _without(scene: Scene, k: int, faces: slice) -> Scene:
    """The scene without these faces of mesh k."""
    mesh, meshes = scene.meshes[k], list(scene.meshes)
    names = ("faces", "normal_faces", "uv_faces")
    kept: dict[str, Any] = {
        n: np.delete(getattr(mesh, n), faces, axis=0) for n in names if getattr(mesh, n) is not None
    }
    meshes[k] = replace(mesh, **kept)
    return replace(scene, meshes=tuple(meshes))


def scene_failures(device: Device, numbers: Iterable[int], seed: int = 0) -> list[Failure]:
    """The failures among random scenes."""
    found = []
    for number in numbers:
        drawn = scene_of(number, seed)
        reason = scene_problem(device, drawn)
        if reason:
            shrunk = shrink(drawn, lambda smaller: bool(scene_problem(device, smaller)))
            found.append(Failure("scene", number, reason, shrunk))
    return found


def file_failures(numbers: Iterable[int], seed: int = 0) -> list[Failure]:
    """The failures among mutated files."""
    reasons = ((number, mutations.problem(number, seed)) for number in numbers)
    return [Failure("file", number, reason) for number, reason in reasons if reason]


def run(
    device: str | None = None,
    *,
    scenes: int = 1000,
    files: int = 1000,
    seed: int = 0,
    first: int = 0,
    stream: TextIO | None = None,
) -> bool:
    """Draws scenes and loads files `first`, `first` + 1, ...; prints each failure as it is found, then the counts. True
    if there is none. Raises InputError and DeviceError."""
    from tqdm import tqdm

    stream = stream or sys.stdout
    for name, value in (("scenes", scenes), ("files", files), ("seed", seed), ("first", first)):
        if value < 0:
            raise InputError(f"fuzz: --{name}: expected a whole number from 0, found {value}")
    failed = 0
    jobs: list[tuple[str, int, Callable[[Iterable[int], int], list[Failure]]]] = [("files", files, file_failures)]
    if scenes:
        jobs.append(("scenes", scenes, partial(scene_failures, open_device(device))))
    for name, count, failures in jobs:
        start, wrong = time.perf_counter(), 0
        # None: shown on a terminal alone.
        hidden = telling.quiet() or None
        for number in tqdm(range(first, first + count), desc=name, unit="", disable=hidden, leave=False):
            for failure in failures([number], seed):
                wrong += 1
                tqdm.write(str(failure), file=stream)
        failed += wrong
        print(f"{count} {name} (seed {seed}): {wrong} failed, {time.perf_counter() - start:.1f} s", file=stream)
    return failed == 0
