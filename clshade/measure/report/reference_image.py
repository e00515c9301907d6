"""The converged image that approximations are measured against.

It is the scene drawn with the best settings there are (preset `standard`, float64 where the device has it), each pixel
the plain mean of many samples, each of them shaded: what more and more samples approach.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ...base.arrays import Array
from ...images.metrics import rmse
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.camera import Camera
from ...scene.model import Scene, Settings
from ...scene.settings import Precision

MOST = 1 << 27  # samples that the reference may take altogether: some seconds
# Pixels of a larger image along a pixel's side, and samples in each of those. The reference takes one step, its error is
# estimated by the next, of a quarter of the samples. The larger image's samples lie where no variant has any: their own
# errors are not in the reference too.
STEPS = ((2, 64), (2, 16), (2, 4), (2, 1), (1, 1))
TILE = 1024  # pixels along a side of the larger image's tiles, which are drawn one after another
BELONGS = frozenset({"ambient", "cull", "near"})  # settings that say what is seen, not how well
CONVERGING = frozenset({"precision", "samples", "sample_shading", "resolve", "texture_filter", "layers"})  # how well


@dataclass(frozen=True, eq=False)
class Reference:
    """rgb: (M, N, 3) float64. samples: in each pixel. settings: that it was drawn with.

    error: estimate of its RMSE: half of what the image of a quarter of the samples is away from it, for errors fall at
    least with the square root of the number of samples.
    """

    rgb: Array = field(repr=False)
    samples: int
    settings: Settings
    error: float

    def about(self) -> str:
        each = "lit" if self.settings.shader != "nolight" else "looked up"
        return (
            f"{self.samples} samples a pixel, each {each}, {self.settings.precision}; its own RMSE is estimated at "
            f"{self.error:.2g}, half of what an image of a quarter of the samples is away"
        )

    def stats(self) -> dict[str, float]:
        """The figures, as JSON takes them."""
        return {"samples": self.samples, "estimated_error": self.error}


def reference(scene: Scene, base: Settings, device: Device, fixed: Collection[str] = ()) -> Reference:
    """As many samples as MOST allows, 256 a pixel at most and 4 at least.

    base: its ambient term, culling and near plane, and whether there is light at all, belong to the scene and are kept,
    as are the fields named in `fixed` but for those that say how well it converges.
    """
    best = best_settings(base, device, fixed)
    affordable = [_fits(scene, *step) for step in STEPS[:-2]]
    first = affordable.index(True) if any(affordable) else len(affordable)
    fine, coarse = (averaged(scene, device, best, *step) for step in STEPS[first : first + 2])
    scale, samples = STEPS[first]
    return Reference(fine, scale * scale * samples, best, rmse(coarse, fine) / 2.0)


def _fits(scene: Scene, scale: int, samples: int) -> bool:
    columns, rows = scene.camera.resolution
    return scale * scale * samples * columns * rows <= MOST


def best_settings(base: Settings, device: Device, fixed: Collection[str] = ()) -> Settings:
    kept = {name: getattr(base, name) for name in BELONGS.union(fixed) - CONVERGING}
    kept.setdefault("shader", "nolight" if base.shader == "nolight" else "phong")
    precision: Precision = "float64" if device.has_fp64 else "float32"
    return Settings.from_preset("standard", precision=precision, sample_shading=True, **kept)


def averaged(scene: Scene, device: Device, settings: Settings, scale: int, samples: int) -> Array:
    """(M, N, 3) float64: the mean of scale x scale pixels of a larger image, each of so many samples."""
    columns, rows = scene.camera.resolution
    image = np.empty((rows, columns, 3))
    with Renderer(scene, settings=replace(settings, samples=samples), device=device) as renderer:
        for left, top, camera in tiles(scene.camera, scale):
            width, height = (side // scale for side in camera.resolution)
            found = np.asarray(renderer.render(camera=camera).rgb, np.float64)
            blocks = found.reshape(height, scale, width, scale, 3)
            image[top : top + height, left : left + width] = blocks.mean(axis=(1, 3))
    return image


def tiles(camera: Camera, scale: int) -> Iterator[tuple[int, int, Camera]]:
    """Cameras that each see a part of the image, scale times as large; its first column and row in the image."""
    columns, rows = camera.resolution
    (height, width), (right, up) = camera.plane, camera.principal
    side = TILE // scale
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            across, down = min(side, columns - left), min(side, rows - top)
            below = rows - top - down
            yield (
                left,
                top,
                replace(
                    camera,
                    resolution=(scale * across, scale * down),
                    plane=(height * down / rows, width * across / columns),
                    principal=((right * columns - left) / across, (up * rows - below) / down),
                ),
            )
