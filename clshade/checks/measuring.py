"""What a way of drawing costs, and the two errors of its image: of its arithmetic, and of what it approximates."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

from .. import viewpoint
from ..camera import Camera
from ..device import Device
from ..frame import Frame
from ..renderer import Renderer
from ..scene import Scene, Settings
from ..validation import Array
from .checking import Check, check
from .image_errors import ImageError, image_error
from .reference import Reference
from .timing import Spread, in_turns, spread
from .variants import Variant

SECONDS = 12.0  # for the frames of all variants
SAMPLES_CHECKED = 1 << 17  # of an image, computed again in float64: a second or less
STEP = 0.05  # degrees that the camera goes on from frame to frame


@dataclass(frozen=True, eq=False)
class Measured:
    """A variant on one scene and device.

    frame_ms: of frames of the scene that stays on the device. build_ms, upload_ms: before the first of them: programs
    built or loaded from the cache, and the scene packed and uploaded.
    arithmetic: against the float64 oracle with the same settings, if it was looked at. approximation: against the reference.
    rgb: the image, (M, N, 3).
    """

    variant: Variant
    frame_ms: Spread
    build_ms: float
    upload_ms: float
    arithmetic: Check | None
    approximation: ImageError
    rgb: Array = field(repr=False)

    @property
    def name(self) -> str:
        return self.variant.name

    @property
    def cost(self) -> float:
        """Milliseconds of a frame."""
        return self.frame_ms.median

    @property
    def error(self) -> float:
        """Of the approximation, RMSE."""
        return self.approximation.rmse

    def stats(self) -> dict[str, Any]:
        """The figures, as JSON takes them."""
        return {
            "variant": self.name,
            "about": self.variant.about,
            "settings": self.variant.changes,
            "frame_ms": self.frame_ms._asdict(),
            "build_ms": self.build_ms,
            "upload_ms": self.upload_ms,
            "arithmetic": self.arithmetic and self.arithmetic.stats(),
            "approximation": self.approximation.stats(),
        }


class Drawn(NamedTuple):
    """A variant whose first frame is drawn; renderer: which will draw others of it."""

    variant: Variant
    renderer: Renderer
    image: Frame
    approximation: ImageError

    def frame_ms(self, camera: Camera | None = None) -> float:
        """Milliseconds of one more frame. The first would be none to go by: runtimes may compile at it."""
        return self.renderer.render(camera=camera).stats["times_ms"]["frame"]


def draw(
    scene: Scene, variants: Sequence[Variant], base: Settings, device: Device, reference: Reference, stack: ExitStack
) -> list[Drawn]:
    """The variants' images. base: what the variants change. stack: closes the renderers."""
    found = []
    for variant in variants:
        renderer = stack.enter_context(Renderer(scene, settings=variant.settings(base), device=device))
        image = renderer.render()
        found.append(Drawn(variant, renderer, image, image_error(image.rgb, reference.rgb)))
    return found


def timed(drawn: Sequence[Drawn], frames: int, *, checked: bool = True) -> list[Measured]:
    """Times of further frames, drawn in turns while the camera moves; the variants that were drawn, measured.

    frames: of each; fewer where all of them take more than SECONDS. checked: whether the arithmetic is looked at too.
    """
    if not drawn:
        return []
    cameras = [viewpoint.moved(drawn[0].image.scene.camera, azimuth=STEP * (k + 1)) for k in range(frames)]
    turns = in_turns([partial(_next, each, cameras) for each in drawn], frames, SECONDS)
    found = []
    for each, ms in zip(drawn, zip(*turns, strict=True), strict=True):
        image, once = each.image, each.image.stats["times_ms"]
        arithmetic = check(image, _pixels_to_check(image)) if checked else None
        costs = spread(ms), once["build"], once["pack"] + once["upload"]
        found.append(Measured(each.variant, *costs, arithmetic, each.approximation, image.rgb))
    return found


def _next(drawn: Drawn, cameras: Sequence[Camera], number: int) -> float:
    return drawn.frame_ms(cameras[number])


def measure(
    scene: Scene, variants: Sequence[Variant], base: Settings, device: Device, reference: Reference, *, frames: int
) -> list[Measured]:
    """The costs and both errors of all variants; see `draw` and `timed`."""
    with ExitStack() as stack:
        return timed(draw(scene, variants, base, device, reference, stack), frames)


def _pixels_to_check(image: Frame) -> int | str:
    """All pixels, or as many as there is time for."""
    affordable = SAMPLES_CHECKED // image.settings.samples
    return "all" if image.alpha.size <= affordable else affordable
