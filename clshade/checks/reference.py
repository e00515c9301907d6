"""The converged image that approximations are measured against.

It is the scene drawn with the best settings there are (preset `standard`, float64 where the device has it), each pixel
the plain mean of many samples, each of them shaded: what more and more samples approach.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..camera import MAX_RESOLUTION
from ..device import Device
from ..renderer import render
from ..scene import Scene, Settings
from ..validation import Array
from .image_errors import rmse

MOST = 1 << 26  # samples that the reference may take altogether: a second or a few
# Pixels of a larger image along a pixel's side, and samples in each of those: four times fewer at each step.
STEPS = ((2, 64), (1, 64), (1, 16), (1, 4), (1, 1))


@dataclass(frozen=True, eq=False)
class Reference:
    """rgb: (M, N, 3) float64. samples: in each pixel. settings: that it was drawn with.

    error: its RMSE against the image of a quarter of the samples. Its own is less than that, as that image's is of this
    size, and errors fall with the number of samples.
    """

    rgb: Array = field(repr=False)
    samples: int
    settings: Settings
    error: float

    def about(self) -> str:
        return (
            f"{self.samples} samples a pixel, each shaded, {self.settings.precision}; an image of a quarter of them is "
            f"{self.error:.2g} away (RMSE), so its own error is less"
        )


def reference(scene: Scene, base: Settings, device: Device) -> Reference:
    """As many samples as MOST allows, at most 256 a pixel.

    base: its ambient term, culling and near plane, and whether there is light at all, belong to the scene and are kept.
    """
    best = best_settings(base, device)
    affordable = [_fits(scene, *step) for step in STEPS[:-1]]
    first = affordable.index(True) if any(affordable) else len(affordable) - 1
    fine, coarse = (averaged(scene, device, best, *step) for step in STEPS[first : first + 2])
    scale, samples = STEPS[first]
    return Reference(fine, scale * scale * samples, best, rmse(coarse, fine))


def _fits(scene: Scene, scale: int, samples: int) -> bool:
    columns, rows = scene.camera.resolution
    return scale * max(columns, rows) <= MAX_RESOLUTION and scale * scale * samples * columns * rows <= MOST


def best_settings(base: Settings, device: Device) -> Settings:
    kept = {name: getattr(base, name) for name in ("ambient", "cull", "near")}
    shader = "nolight" if base.shader == "nolight" else "phong"
    precision = "float64" if device.has_fp64 else "float32"
    return Settings.from_preset("standard", shader=shader, precision=precision, sample_shading=True, **kept)


def averaged(scene: Scene, device: Device, settings: Settings, scale: int, samples: int) -> Array:
    """(M, N, 3) float64: the mean of scale x scale pixels of a larger image, each of so many samples."""
    columns, rows = scene.camera.resolution
    camera = replace(scene.camera, resolution=(scale * columns, scale * rows))
    frame = render(replace(scene, camera=camera), settings=replace(settings, samples=samples), device=device)
    blocks = np.asarray(frame.rgb, np.float64).reshape(rows, scale, columns, scale, 3)
    return blocks.mean(axis=(1, 3))
