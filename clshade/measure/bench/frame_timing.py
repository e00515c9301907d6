"""Times of consecutive frames of a scene resident on the device: each stage and the whole frame."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene import adjust_camera
from ...scene.camera import Camera
from ...scene.model import Scene
from ..timing import Spread, in_turns, spread
from .device_peaks import Peaks

SECONDS = 20.0  # for the frames of one scene, alone or in turns with OpenGL's
PATH = 20  # steps of the camera's path, which repeats
STEP = 0.05  # degrees

# Operations of the Phong model per pixel; an fma counts as two, everything else, roots and quotients included, as one:
# perspective-correct barycentric coordinates 21, point and normal 30, their unit vectors 20, the coefficients 15. And
# per light: direction 13, cosine 6, mirrored direction and its distance from the eye's 16, power by two polynomials 24,
# sums 12.
PIXEL_FLOPS, LIGHT_FLOPS = 86, 71

NOT_STAGES = ("pack", "open", "upload", "frame")  # of frame.stats["times_ms"]


@dataclass(frozen=True)
class FrameTiming:
    """Frame times of a scene.

    covered: covered pixels. stages: name -> median ms; `host` is the rest of the frame. held: bytes on the device by what
    they hold, as in `Frame.stats`. flops: of the Phong model at the covered pixels, see PIXEL_FLOPS; None of other shaders.
    """

    resolution: tuple[int, int]
    triangles: int
    covered: int
    frames: int
    frame_ms: Spread
    stages: dict[str, float]
    held: dict[str, int]
    flops: int | None

    @property
    def ms(self) -> float:
        return self.frame_ms.median

    @property
    def bytes(self) -> int:
        """The least memory traffic with this scene layout: the scene read once, the float32 image written once."""
        return self.held["scene"] + self.held["image"]

    def floor_ms(self, peaks: Peaks) -> float:
        """Return the least time of a frame: its bytes at the rate of a fill, or its flops at the peak rate."""
        return 1e3 * max(self.bytes / peaks.fill, (self.flops or 0) / peaks.flops)


def cameras(camera: Camera) -> list[Camera]:
    """Return the cameras of consecutive frames; the path is cyclic."""
    return [adjust_camera.adjusted(camera, azimuth=STEP * (k + 1)) for k in range(PATH)]


@contextmanager
def warm_renderer(scene: Scene, device: Device, options: Mapping[str, Any]) -> Iterator[Renderer]:
    """Yield a renderer that has drawn a frame: runtimes may compile and allocate during the first."""
    with Renderer(scene, device=device, **options) as renderer:
        for _ in range(2):
            renderer.render()
        yield renderer


def time_frames(renderer: Renderer, frames: int) -> FrameTiming:
    """Time so many frames, fewer if they take more than SECONDS."""
    scene = renderer.scene
    frame = renderer.render()
    covered, held = int(np.count_nonzero(frame.alpha)), frame.stats["bytes"]
    del frame  # releases its memory for the next
    path = cameras(scene.camera)

    def next_frame(number: int) -> tuple[float, dict[str, float]]:
        start = time.perf_counter()
        frame = renderer.render(path[number % PATH])
        return (time.perf_counter() - start) * 1e3, frame.stats["times_ms"]

    turns = [one for (one,) in in_turns([next_frame], frames, SECONDS)]
    is_phong = renderer.settings.shader == "phong"
    return FrameTiming(
        resolution=scene.camera.resolution,
        triangles=scene.face_count,
        covered=covered,
        frames=len(turns),
        frame_ms=spread([ms for ms, _ in turns]),
        stages=_stages([stages for _, stages in turns], [ms for ms, _ in turns]),
        held=held,
        flops=covered * (PIXEL_FLOPS + LIGHT_FLOPS * len(scene.lights)) if is_phong else None,
    )


def _stages(times: Sequence[dict[str, float]], frames: Sequence[float]) -> dict[str, float]:
    """Return the medians of the stages' times, and of the rest of each frame."""
    names = [name for name in times[0] if name not in NOT_STAGES]
    found = {name: float(np.median([each.get(name, 0.0) for each in times])) for name in names}
    rest = [ms - sum(each.get(name, 0.0) for name in names) for each, ms in zip(times, frames, strict=True)]
    return {**found, "host": float(np.median(rest))}
