"""The converged reference image that approximations are measured against.

It is the scene drawn with the best settings (preset `standard`, float64 if the device has it), each pixel the plain
mean of many samples, each of them shaded: the limit of increasing sample counts.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

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
    """A converged image, or some windows of it.

    rgb: float64; (M, N, 3), or (K, 3) of the windows' pixels, see `thinned_image.Thinned`. samples: number per pixel.
    settings: those that it was drawn with.
    error: estimate of its RMSE: half of the RMSE between it and the image with a quarter of the samples, because errors
    fall at least with the square root of the number of samples.
    """

    rgb: Array = field(repr=False)
    samples: int
    settings: Settings
    error: float

    def about(self) -> str:
        each = "lit" if self.settings.shader != "nolight" else "looked up"
        return (
            f"{self.samples} samples a pixel, each {each}, {self.settings.precision}; its own RMSE is estimated at "
            f"{self.error:.2g}, half its distance from an image with a quarter of the samples"
        )

    def stats(self) -> dict[str, float]:
        """Return the figures for JSON."""
        return {"samples": self.samples, "estimated_error": self.error}


def reference(scene: Scene, base: Settings, device: Device, fixed: Collection[str] = ()) -> Reference:
    """Render the reference with as many samples as MOST allows, at least 4 and at most 256 per pixel.

    base: its ambient term, culling and near plane, and whether there is lighting at all, belong to the scene and are
    kept, as are the fields named in `fixed`, except those that decide how accurately the image converges.
    """
    columns, rows = scene.camera.resolution
    best = best_settings(base, device, fixed)
    return _converged(best, columns * rows, partial(averaged, scene, device), rmse)


def reference_windows(
    scene: Scene, base: Settings, device: Device, thinned: Thinned, fixed: Collection[str] = ()
) -> Reference:
    """Render the same as `reference`, but only the pixels of a thinned image."""

    def draw(settings: Settings, scale: int, samples: int) -> Array:
        found = window_means(scene, device, settings, scale, samples, thinned.windows)
        return np.concatenate([means.reshape(-1, 3) for _, means in found])

    def error(coarse: Array, fine: Array) -> float:
        return thinned.estimate(coarse, fine).rmse

    return _converged(best_settings(base, device, fixed), thinned.count, draw, error)


def _converged(
    best: Settings,
    pixels: int,
    draw: Callable[[Settings, int, int], Array],
    error: Callable[[Array, Array], float],
) -> Reference:
    """Return the reference of so many pixels. draw: takes settings and a step. error: returns an RMSE."""
    first = first_step(pixels * (1 + 10 * best.ambient_occlusion))  # a ray of it takes as long as ten samples
    fine, coarse = (draw(best, *step) for step in STEPS[first : first + 2])
    scale, samples = STEPS[first]
    return Reference(fine, scale * scale * samples, best, error(coarse, fine) / 2.0)


def first_step(pixels: int) -> int:
    """Return the place in STEPS of the most samples that MOST allows for so many pixels."""
    affordable = [scale * scale * samples * pixels <= MOST for scale, samples in STEPS[:-2]]
    return [*affordable, True].index(True)


def best_settings(base: Settings, device: Device, fixed: Collection[str] = ()) -> Settings:
    kept = {name: getattr(base, name) for name in BELONGS.union(fixed) - CONVERGING}
    kept.setdefault("shader", base.shader if base.shader in ("nolight", "pbr") else "phong")
    precision: Precision = "float64" if device.has_fp64 else "float32"
    return Settings.from_preset(
        "standard",
        precision=precision,
        sample_shading=True,
        light_samples=LIGHT_SAMPLES,
        ambient_occlusion=min(base.ambient_occlusion, 1) * OCCLUSION_RAYS,
        **kept,
    )


def averaged(scene: Scene, device: Device, settings: Settings, scale: int, samples: int) -> Array:
    """Return the means of scale x scale pixels of a larger image, each with `samples` samples, (M, N, 3) float64."""
    columns, rows = scene.camera.resolution
    image = np.empty((rows, columns, 3))
    for window, means in window_means(scene, device, settings, scale, samples, tiles(scene.camera, scale)):
        image[window.place] = means
    return image


def window_means(
    scene: Scene, device: Device, settings: Settings, scale: int, samples: int, windows: Iterable[Window]
) -> Iterator[tuple[Window, Array]]:
    """Yield each window with its part of what `averaged` returns, (height, width, 3) float64."""
    with Renderer(scene, settings=replace(settings, samples=samples), device=device) as renderer:
        for window in windows:
            found = np.asarray(renderer.render(camera=window.camera(scene.camera, scale)).rgb, np.float64)
            blocks = found.reshape(window.height, scale, window.width, scale, 3)
            yield window, blocks.mean(axis=(1, 3))


def tiles(camera: Camera, scale: int) -> Iterator[Window]:
    """Yield the tiles of an image to draw `scale` times as large, one after another."""
    columns, rows = camera.resolution
    side = TILE // scale
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            yield Window(left, top, min(side, columns - left), min(side, rows - top))
