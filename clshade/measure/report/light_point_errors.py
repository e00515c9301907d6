"""What it costs that few points stand for a light: differences from images with the most points and the same samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...base.arrays import Array
from ...images.metrics import rmse
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.lights import has_size
from ...scene.model import Scene, Settings
from ...scene.settings import MAX_LIGHT_SAMPLES

KNOWN = (
    MAX_LIGHT_SAMPLES // 4
)  # points up to which errors are known: those of the images with most count little beside them


class LightPointErrors:
    """Errors of images of one scene because few points stand for a light of finite size.

    Each is the RMSE against the image of the same settings but MAX_LIGHT_SAMPLES points. All else is the same in both, edges
    included, so that nothing but the light's points differs.
    """

    def __init__(self, scene: Scene, device: Device) -> None:
        self._scene, self._device = scene, device
        self._sized = any(map(has_size, scene.lights))
        self._images: dict[Settings, Array] = {}

    def error(self, frame: Frame) -> float | None:
        """Return the error of a frame of the scene; None if that is not known: if no light has a size, or the frame has more
        than KNOWN points."""
        if not self._sized or frame.settings.light_samples > KNOWN:
            return None
        most = replace(frame.settings, light_samples=MAX_LIGHT_SAMPLES)
        if most not in self._images:
            self._images[most] = np.asarray(render(self._scene, settings=most, device=self._device).rgb)
        return rmse(frame.rgb, self._images[most])
