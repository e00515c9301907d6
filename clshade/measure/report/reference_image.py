"""The converged reference image that approximations are measured against.

It is the scene drawn with the best settings (preset `standard`, float64 if the device has it), each pixel the plain
mean of many samples, each of them shaded: the limit of increasing sample counts.
"""

from __future__ import annotations

import math
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
from .thinned_image import Thinned, Window

MOST = 1 << 27  # samples of the whole reference, at most: some seconds
LIGHT_SAMPLES = 2  # points of each light in each sample, which has others than the next: 512 with 256 samples a pixel
OCCLUSION_RAYS = 2  # likewise, of ambient occlusion
# Subpixels along a pixel's side, which are pixels of a larger image, and samples in each. The reference uses one step;
# the next, with a quarter of the samples, gives the estimate of its error. The larger image's sample positions differ
# from every variant's, so that the reference does not share a variant's error.
STEPS = ((2, 64), (2, 16), (2, 4), (2, 1), (1, 1))
TILE = 1024  # side of the larger image's tiles in pixels; they are drawn one after another
BELONGS = {"ambient", "cull", "near", "shadows", "ao_distance"}  # settings that decide what is seen
CONVERGING = {  # how well
    *("precision", "samples", "sample_shading", "resolve"),
    *("texture_filter", "layers", "light_samples", "ambient_occlusion"),
}


@dataclass(frozen=True, eq=False)
class Reference:
    """A converged image.

    rgb: float64; (M, N, 3), or (K, 3) of a thinned image. samples: number per pixel. settings: those that it was drawn
    with. error: estimate of its RMSE: half of the RMSE between it and the image with a quarter of the samples, because
    errors fall at least with the square root of the number of samples.
    """

    rgb: Array = field(repr=False)
    samples: int
    settings: Settings
    error: float

    def about(self) -> str:
        action = "lit" if self.settings.shader != "nolight" else "looked up"
        return (
            f"{self.samples} samples a pixel, each {action}, {self.settings.precision}; its own RMSE is estimated at "
            f"{self.error:.2g}, half its distance from an image with a quarter of the samples"
        )


def reference(
    scene: Scene, base: Settings, device: Device, fixed: Collection[str] = (), thinned: Thinned | None = None
) -> Reference:
    """Render the reference with as many samples as MOST allows, at least 4 and at most 256 per pixel.

    base: its ambient term, culling and near plane, and whether there is lighting at all, belong to the scene and are
    kept, as are the fields named in `fixed`, except those that decide how accurately the image converges. thinned: draws
    only its pixels.
    """
    best = best_settings(base, device, fixed)
    pixels = thinned.count if thinned else math.prod(scene.camera.resolution)
    first = first_step(pixels * (1 + 10 * best.ambient_occlusion))  # a ray of it takes as long as ten samples
    fine, coarse = (averaged(scene, device, best, *step, thinned) for step in STEPS[first : first + 2])
    apart = thinned.estimate(coarse, fine).rmse if thinned else rmse(coarse, fine)
    scale, samples = STEPS[first]
    return Reference(fine, scale * scale * samples, best, apart / 2.0)


def first_step(pixels: int) -> int:
    """Return the place in STEPS of the most samples that MOST allows for so many pixels."""
    affordable = [scale * scale * samples * pixels <= MOST for scale, samples in STEPS[:-2]]
    return [*affordable, True].index(True)


def best_settings(base: Settings, device: Device, fixed: Collection[str] = ()) -> Settings:
    fields = {name: getattr(base, name) for name in BELONGS.union(fixed) - CONVERGING}
    fields.setdefault("shader", base.shader if base.shader in ("nolight", "pbr") else "phong")
    precision: Precision = "float64" if device.has_fp64 else "float32"
    return Settings.from_preset(
        "standard",
        precision=precision,
        sample_shading=True,
        light_samples=LIGHT_SAMPLES,
        ambient_occlusion=min(base.ambient_occlusion, 1) * OCCLUSION_RAYS,
        **fields,
    )


def averaged(
    scene: Scene, device: Device, settings: Settings, scale: int, samples: int, thinned: Thinned | None = None
) -> Array:
    """Return the means of scale x scale pixels of a larger image, each with `samples` samples, (M, N, 3) float64; or
    (K, 3), the pixels of a thinned image."""
    columns, rows = scene.camera.resolution
    image = np.empty((rows, columns, 3))
    windows = thinned.windows if thinned else tiles(scene.camera, scale)
    with Renderer(scene, settings=replace(settings, samples=samples), device=device) as renderer:
        for window in windows:
            large = np.asarray(renderer.render(camera=window.camera(scene.camera, scale)).rgb, np.float64)
            blocks = large.reshape(window.height, scale, window.width, scale, 3)
            image[window.place] = blocks.mean(axis=(1, 3))
    return thinned.of(image) if thinned else image


def tiles(camera: Camera, scale: int) -> Iterator[Window]:
    """Yield the tiles of an image to draw `scale` times as large, one after another."""
    columns, rows = camera.resolution
    side = TILE // scale
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            yield Window(left, top, min(side, columns - left), min(side, rows - top))
