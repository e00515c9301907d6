"""Times of consecutive frames of a scene resident on the device: each stage and the whole frame."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene import adjust_camera
from ...scene.camera import Camera
from ...scene.model import Scene
from ..defaults import BENCH_FRAMES
from ..timing import Spread, in_turns, spread
from .device_peaks import Peaks

SECONDS = 20.0  # for the frames of one workload, or of a workload and a peer
PATH = 20  # steps of the camera's path, which repeats
STEP = 0.05  # degrees
NO_OPTIONS: Mapping[str, Any] = MappingProxyType({})

# Operations of the Phong model per pixel; an fma counts as two, everything else, roots and quotients included, as one:
# perspective-correct barycentric coordinates 21, point and normal 30, their unit vectors 20, the coefficients 15. And
# per light: direction 13, cosine 6, mirrored direction and its distance from the eye's 16, power by two polynomials 24,
# sums 12.
PIXEL_FLOPS, LIGHT_FLOPS = 86, 71

NOT_STAGES = ("pack", "open", "upload", "frame")  # of frame.stats["times_ms"]


@dataclass(frozen=True)
class FrameTiming:
    """Frame times of a workload.

    covered: covered pixels. stages: name -> median ms; `host` is the rest of the frame.
    bytes: the least memory traffic with this scene layout: positions, faces and attributes read once, the float32 image
    written once. flops: the reflection model at the covered pixels, see PIXEL_FLOPS.
    peak_mib: peak memory of the process, if drawn in a process of its own.
    """

    resolution: tuple[int, int]
    triangles: int
    covered: int
    frames: int
    frame_ms: Spread
    stages: dict[str, float]
    bytes: int
    flops: int
    peak_mib: float | None = None

    @property
    def ms(self) -> float:
        return self.frame_ms.median

    @property
    def figures(self) -> dict[str, float | None]:
        """Time in ms, peak memory, and rates: triangles and covered pixels in 1e6 per second, bytes and flops in
        1e9."""
        return {
            "ms": self.ms,
            "mtri_s": self.triangles / self.ms / 1e3,
            "mpix_s": self.covered / self.ms / 1e3,
            "gb_s": self.bytes / self.ms / 1e6,
            "gflops": self.flops / self.ms / 1e6,
            "peak_mib": self.peak_mib,
        }

    def floor_ms(self, peaks: Peaks) -> float:
        """Return the least time of a frame: its bytes at the rate of a fill, or its flops at the peak rate."""
        return 1e3 * max(self.bytes / peaks.fill, self.flops / peaks.flops)

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON; `from_stats` reverses it."""
        return {**asdict(self), "frame_ms": self.frame_ms._asdict()}

    @classmethod
    def from_stats(cls, stats: dict[str, Any]) -> FrameTiming:
        lists = {"resolution": tuple(stats["resolution"]), "frame_ms": Spread(**stats["frame_ms"])}
        return cls(**{**stats, **lists})


def cameras(camera: Camera) -> list[Camera]:
    """Return the cameras of consecutive frames; the path is cyclic."""
    return [adjust_camera.adjusted(camera, azimuth=STEP * (k + 1)) for k in range(PATH)]


@contextmanager
def warm_renderer(scene: Scene, device: Device, options: Mapping[str, Any] = NO_OPTIONS) -> Iterator[Renderer]:
    """Yield a renderer that has drawn a frame: runtimes may compile and allocate during the first."""
    with Renderer(scene, device=device, **options) as renderer:
        for _ in range(2):
            renderer.render()
        yield renderer


def draw(
    scene: Scene,
    device: Device,
    frames: int = BENCH_FRAMES,
    seconds: float = SECONDS,
    options: Mapping[str, Any] = NO_OPTIONS,
) -> FrameTiming:
    """Time `frames` frames, fewer if they take more than `seconds`. options: of Renderer. Raises DeviceError if the scene
    does not fit."""
    with warm_renderer(scene, device, options) as renderer:
        frame = renderer.render()
        covered, stats = int(np.count_nonzero(frame.alpha)), frame.stats
        del frame  # releases its memory for the next
        path = cameras(scene.camera)

        def next_frame(number: int) -> tuple[float, dict[str, float]]:
            start = time.perf_counter()
            frame = renderer.render(path[number % PATH])
            return (time.perf_counter() - start) * 1e3, frame.stats["times_ms"]

        turns = [one for (one,) in in_turns([next_frame], frames, seconds)]
    return FrameTiming(
        resolution=scene.camera.resolution,
        triangles=scene.face_count,
        covered=covered,
        frames=len(turns),
        frame_ms=spread([ms for ms, _ in turns]),
        stages=_stages([stages for _, stages in turns], [ms for ms, _ in turns]),
        bytes=stats["bytes"]["scene"] + stats["bytes"]["image"],
        flops=covered * (PIXEL_FLOPS + LIGHT_FLOPS * len(scene.lights)),
    )


def _stages(times: Sequence[dict[str, float]], frames: Sequence[float]) -> dict[str, float]:
    """Return the medians of the stages' times, and of the rest of each frame."""
    names = [name for name in times[0] if name not in NOT_STAGES]
    found = {name: float(np.median([each.get(name, 0.0) for each in times])) for name in names}
    rest = [ms - sum(each.get(name, 0.0) for name in names) for each, ms in zip(times, frames, strict=True)]
    return {**found, "host": float(np.median(rest))}
