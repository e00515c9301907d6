"""What approximations of the model cost: differences from `standard` with the same samples, in which aliasing cancels."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...base.arrays import Array
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import render
from ...scene.model import Scene, Settings

# Fields of Settings by which an image approximates another model, and what that is called.
APPROXIMATIONS = {
    "visibility": "painter's order",
    "interpolation": "affine interpolation",
    "lighting_at": "light at the centroid",
    "texture_at": "texture at vertices",
    "texture_filter": "mip maps",
    "shader": "Gouraud shading",
    "resolve": "weighted mean",
}
SAMPLES = 64  # of each pixel, each of them shaded


class ModelErrors:
    """Images of approximate models of one scene, less that of the best model.

    best: settings of the reference. Its precision is irrelevant here: float32 serves.
    """

    def __init__(self, scene: Scene, best: Settings, device: Device) -> None:
        self._scene, self._device = scene, device
        self._best = replace(best, precision="float32", samples=SAMPLES, sample_shading=True)
        self._images: dict[Settings, Array] = {}

    def approximated(self, settings: Settings) -> list[str]:
        """Return the fields in which the settings' model differs from the best."""
        return [name for name in APPROXIMATIONS if getattr(settings, name) != getattr(self._best, name)]

    def difference(self, settings: Settings, names: Collection[str] = tuple(APPROXIMATIONS)) -> Array:
        """Return the image of a model less the best model's, (M, N, 3) float64. The model takes the fields `names` from the
        settings."""
        model = replace(self._best, **{name: getattr(settings, name) for name in names})
        return self._image(model) - self._image(self._best)

    def _image(self, settings: Settings) -> Array:
        """Return the image of these settings, (M, N, 3) float64, drawn when first asked for."""
        if settings not in self._images:
            self._images[settings] = np.asarray(render(self._scene, settings=settings, device=self._device).rgb)
        return self._images[settings].astype(np.float64)
