"""The cost of a variant, and the two errors of its image: arithmetic and approximation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from ...base.arrays import Bytes
from ...images.metrics import ImageError, image_error, rms, rmse
from ...images.tonemap import tonemap
from ...pipeline.frame import Frame
from ...pipeline.frame_results import Check
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene import adjust_camera
from ...scene.camera import Camera
from ...scene.model import Scene, Settings, default_tonemap
from ..check.check import check
from ..timing import Spread, in_turns, spread
from .model_errors import ModelErrors
from .reference_image import Reference
from .variants import Variant

SECONDS, FEW_SECONDS = 12.0, 5.0  # for the frames of all variants; without details
SAMPLES_CHECKED = 1 << 17  # of an image, recomputed in float64: a second or less
FEW_CHECKED = 1 << 13  # likewise, without details
CODES = 2  # of 255: differences that are hardly ever seen
PAIRS_CHECKED = 1 << 22  # of shadow rays and triangles, all of which the oracle tries: also a second
FEWEST_CHECKED = 8  # pixels
STEP = 0.05  # degrees that the camera moves between frames


@dataclass(frozen=True, eq=False)
class Measured:
    """Measurements of a variant on one scene and device, drawn with `settings`.

    arithmetic: errors against the float64 oracle with the same settings. approximation: errors against the
    reference, from all causes. close: share of the pixels whose 8-bit codes are within CODES of the reference's. model: RMSE
    of its model alone, in images of equal and many samples; sampling: RMSE of its sampling alone, against the converged
    image of the same model. times: milliseconds of frames, with the scene resident on the device.
    """

    variant: Variant
    settings: Settings
    arithmetic: Check
    approximation: ImageError
    close: float
    model: float
    sampling: float
    times: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """For people."""
        return self.variant.title

    @property
    def frame_ms(self) -> Spread:
        return spread(self.times)

    @property
    def cost(self) -> float:
        """Milliseconds per frame."""
        return self.frame_ms.median

    @property
    def error(self) -> float:
        """RMSE of the approximation."""
        return self.approximation.rmse


def measure(
    scene: Scene,
    variants: Sequence[Variant],
    base: Settings,
    device: Device,
    reference: Reference,
    models: ModelErrors,
    *,
    frames: int,
    checked: int = SAMPLES_CHECKED,
    seconds: float = SECONDS,
    advance: Callable[[], object] = bool,
) -> list[Measured]:
    """Measure the costs and the errors of all variants. base: settings that they change. models: of the reference's
    settings. frames, seconds: see `frame_times`. checked: samples of each image that are compared with the oracle. advance:
    called after each variant's errors."""
    operator = default_tonemap(scene)
    codes = tonemap(reference.rgb, operator)

    def errors(variant: Variant, renderer: Renderer) -> Measured:
        image = renderer.render()  # released on return: the images of all variants may not fit in memory
        model = models.difference(renderer.settings)
        return Measured(
            variant,
            renderer.settings,
            arithmetic=check(image, _pixels_to_check(image, checked)),
            approximation=image_error(image.rgb, reference.rgb),
            close=close_share(tonemap(image.rgb, operator), codes),
            model=rms(model),
            sampling=rmse(image.rgb, reference.rgb + model),
        )

    with ExitStack() as stack:
        renderers, measured = [], []
        for variant in variants:
            renderer = stack.enter_context(Renderer(scene, settings=variant.settings(base), device=device))
            renderers.append(renderer)
            measured.append(errors(variant, renderer))
            advance()
        times = frame_times(renderers, frames, seconds)
    return [replace(each, times=ms) for each, ms in zip(measured, times, strict=True)]


def frame_times(renderers: Sequence[Renderer], frames: int, seconds: float = SECONDS) -> list[tuple[float, ...]]:
    """Return the times of the frames of each renderer, in milliseconds, drawn in turns while the camera moves.

    Each renderer must have drawn one frame before, as runtimes may compile during it. frames: number per renderer;
    fewer if all of them take more than `seconds`.
    """
    if not renderers:
        return []
    cameras = [adjust_camera.adjusted(renderers[0].scene.camera, azimuth=STEP * (k + 1)) for k in range(frames)]
    count = len(renderers)

    def next_ms(place: int, number: int) -> float:
        return frame_ms(renderers[(place + number) % count], cameras[number])

    # Each round begins with another renderer: which one was drawn before makes a difference.
    turns = in_turns([partial(next_ms, place) for place in range(count)], frames, seconds)
    return [tuple(turn[(k - number) % count] for number, turn in enumerate(turns)) for k in range(count)]


def frame_ms(renderer: Renderer, camera: Camera | None = None) -> float:
    """Return the time of one frame in milliseconds."""
    milliseconds: float = renderer.render(camera=camera).stats["times_ms"]["frame"]
    return milliseconds


def close_share(codes: Bytes, others: Bytes) -> float:
    """Return the share of the pixels of two 8-bit images, (M, N, 3), no channel of which differs by more than CODES."""
    apart = np.abs(codes.astype(np.int16) - others).max(axis=2)
    return float(np.mean(apart <= CODES))


def _pixels_to_check(image: Frame, samples: int) -> int | Literal["all"]:
    """Return "all", or the number of pixels that there is time for. samples: at most."""
    scene, settings = image.scene, image.settings
    affordable = max(samples // settings.samples, FEWEST_CHECKED)
    rays = settings.ambient_occlusion
    if settings.shadows:
        rays += sum(settings.light_samples if light.has_size else 1 for light in scene.lights)
    if rays:
        # At edges two surfaces are lit.
        rays *= settings.samples if settings.sample_shading else min(settings.samples, 2)
        affordable = min(affordable, max(PAIRS_CHECKED // max(rays * scene.face_count, 1), FEWEST_CHECKED))
    return "all" if image.alpha.size <= affordable else affordable
