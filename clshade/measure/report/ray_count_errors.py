"""What it costs that few rays are traced: differences from images with the most of them and the same samples."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ...base.arrays import Array
from ...images.metrics import rmse
from ...pipeline.frame import Frame
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings
from ...scene.settings import MAX_AMBIENT_OCCLUSION, MAX_LIGHT_SAMPLES

RayCount = Literal["light_samples", "ambient_occlusion"]
MOST: dict[RayCount, int] = {"light_samples": MAX_LIGHT_SAMPLES, "ambient_occlusion": MAX_AMBIENT_OCCLUSION // 2}


def known(field: RayCount) -> int:
    """Return the number of rays up to which errors are known: those of the images with most count little beside them."""
    return MOST[field] // 4


class RayCountErrors:
    """Errors of images of one scene because few rays are traced: to points of lights of finite size, or of ambient
    occlusion.

    Each is the RMSE against the image of the same settings but MOST rays. All else is the same in both, edges included, so
    that nothing but the rays differs.
    """

    def __init__(self, scene: Scene, device: Device) -> None:
        self._scene, self._device = scene, device
        self._images: dict[Settings, Array] = {}

    def error(self, frame: Frame, field: RayCount) -> float | None:
        """Return the error of a frame of the scene; None if that is not known: if it needs no such rays, or has more than
        `known`."""
        settings = frame.settings
        if not traced(self._scene, settings, field) or getattr(settings, field) > known(field):
            return None
        changes: dict[str, Any] = {field: MOST[field]}
        most = replace(settings, **changes)
        if most not in self._images:
            self._images[most] = np.asarray(render(self._scene, settings=most, device=self._device).rgb)
        return rmse(frame.rgb, self._images[most])


def traced(scene: Scene, settings: Settings, field: RayCount) -> bool:
    """Return whether the number of these rays makes a difference: whether any light has a size, or any are asked for."""
    return any(light.has_size for light in scene.lights) if field == "light_samples" else settings.ambient_occlusion > 0
