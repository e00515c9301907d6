"""Where an image's error comes from: its parts by cause, each against an image in which only that cause differs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array
from ...images.metrics import rms
from ...images.tonemap import radiance, tonemap
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings, default_tonemap
from .model_errors import APPROXIMATIONS, ModelErrors
from .reference_image import Reference

SAMPLING, ARITHMETIC, OUTPUT = "sampling", "arithmetic", "8-bit PNG"


class Part(NamedTuple):
    """The error of one cause.

    rmse: of this cause alone. share: of the mean square of the image's total error: the mean of the products of both over
    that. The shares of all causes add up to 1; one that makes up for others has a negative share; the PNG's own part has
    None.
    """

    cause: str
    rmse: float
    share: float | None


@dataclass(frozen=True)
class Decomposition:
    """The error of the image that `settings` draw, by cause.

    Each part is the difference of two consecutive images, from the converged one to this one and its PNG, so that their sum
    is the total error in every pixel. total, png_total: its RMSE. reference_error: RMSE of the reference.
    """

    settings: Settings
    parts: tuple[Part, ...]
    total: float
    png_total: float
    reference_error: float

    def remarks(self) -> list[str]:
        """Return which causes are too small to be known, and which are not measured."""
        errors = {part.cause: part.rmse for part in self.parts}
        said = []
        if 0.0 < errors[SAMPLING] <= 2.0 * self.reference_error:
            said.append(f"{SAMPLING}: about as small as the reference's own error, {self.reference_error:.2g}")
        if ARITHMETIC not in errors:
            said.append(f"{ARITHMETIC}: not known: the device has no float64 to compare with")
        return said


def decompose(
    scene: Scene, settings: Settings, device: Device, converged: Reference, models: ModelErrors
) -> Decomposition:
    """Decompose the error of the image drawn with `settings`, and of its PNG.

    converged: reference of the scene, drawn with the best model. models: of the same model.
    """
    *steps, (output, lost) = _steps(scene, settings, device, converged, models)
    total = np.sum([difference for _, difference in steps], axis=0)
    square = float(np.mean(total * total)) or 1.0
    parts = [Part(cause, rms(off), float(np.mean(off * total)) / square) for cause, off in steps]
    parts.append(Part(output, rms(lost), None))
    return Decomposition(settings, tuple(parts), rms(total), rms(total + lost), converged.error)


def _steps(
    scene: Scene, settings: Settings, device: Device, converged: Reference, models: ModelErrors
) -> Iterator[tuple[str, Array]]:
    """Yield each cause and its error, (M, N, 3) float64."""
    approximated: list[str] = []
    before = np.zeros_like(converged.rgb)
    for name in models.approximated(settings):
        approximated.append(name)
        model = models.difference(settings, approximated)
        yield APPROXIMATIONS[name], model - before
        before = model
    frame = render(scene, settings=settings, device=device)
    image = exact = np.asarray(frame.rgb, np.float64)
    if device.has_fp64 and settings.precision != "float64":
        best = replace(settings, precision="float64")
        exact = np.asarray(render(scene, settings=best, device=device).rgb, np.float64)
    yield SAMPLING, exact - (converged.rgb + before)
    if device.has_fp64:
        yield ARITHMETIC, image - exact
    yield OUTPUT, png_radiance(frame) - image


def png_radiance(frame: Frame) -> Array:
    """Return the image as its PNG holds it, (M, N, 3) float64."""
    operator = default_tonemap(frame.scene)
    return radiance(tonemap(frame.rgb, operator), operator)
