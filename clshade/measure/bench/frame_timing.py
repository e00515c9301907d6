"""Times of consecutive frames of a scene resident on the device: each stage and the whole frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...pipeline.renderer import Renderer
from ...scene import adjust_camera
from ...scene.camera import Camera
from ..timing import Spread, in_turns, spread
from .agreement import Agreement
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


class Compared(NamedTuple):
    """Frame times of OpenGL and ours in ms, drawn in turns. interval: 95 % interval of the ratio,
    None where the pictures differ."""

    title: str
    ours: float
    theirs: float
    turns: int
    interval: tuple[float | None, float | None]
    agreement: Agreement

    @property
    def ratio(self) -> float | None:
        """How many times as fast as OpenGL; None if the images differ."""
        return self.theirs / self.ours if self.agreement.same else None


@dataclass(frozen=True)
class FrameTiming:
    """Frame times of a scene.

    covered: covered pixels. ms: of a frame. stages: name -> median ms; `host` is the rest of the frame. held: bytes on the
    device by what they hold, as in `Frame.stats`. flops: of the Phong model at the covered pixels, see PIXEL_FLOPS; None of
    other shaders.
    """

    name: str
    resolution: tuple[int, int]
    triangles: int
    covered: int
    frames: int
    ms: Spread
    stages: dict[str, float]
    held: dict[str, int]
    flops: int | None
    compared: Compared | None = None

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


def time_frames(name: str, renderer: Renderer, frames: int) -> FrameTiming:
    """Time so many frames, fewer if they take more than SECONDS."""
    scene = renderer.scene
    for _ in range(2):  # runtimes may compile and allocate during the first frame
        frame = renderer.render()
    covered, held = int(np.count_nonzero(frame.alpha)), frame.stats["bytes"]
    del frame  # releases its memory for the next
    path = cameras(scene.camera)

    def next_frame(number: int) -> dict[str, float]:
        start = time.perf_counter()
        times: dict[str, float] = renderer.render(path[number % PATH]).stats["times_ms"]
        return {**times, "frame": (time.perf_counter() - start) * 1e3}

    times = [frame for (frame,) in in_turns([next_frame], frames, SECONDS)]
    is_phong = renderer.settings.shader == "phong"
    return FrameTiming(
        name=name,
        resolution=scene.camera.resolution,
        triangles=scene.face_count,
        covered=covered,
        frames=len(times),
        ms=spread([frame["frame"] for frame in times]),
        stages=_stages(times),
        held=held,
        flops=covered * (PIXEL_FLOPS + LIGHT_FLOPS * len(scene.lights)) if is_phong else None,
    )


def _stages(times: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the medians of the stages' times, and of the rest of each frame."""
    names = [name for name in times[0] if name not in NOT_STAGES]
    stages = [{name: frame.get(name, 0.0) for name in names} for frame in times]
    remainder = [frame["frame"] - sum(durations.values()) for frame, durations in zip(times, stages, strict=True)]
    medians = {name: float(np.median([durations[name] for durations in stages])) for name in names}
    return {**medians, "host": float(np.median(remainder))}
