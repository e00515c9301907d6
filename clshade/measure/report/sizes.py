"""Times and errors of some variants at growing image sizes, and the powers of the number of pixels they follow."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.text_tables import Row, digits
from ...errors import InputError
from ...pipeline.opencl.device import Device
from ...pipeline.renderer import Renderer
from ...scene.model import Scene, Settings
from ..timing import COVERAGE, RESAMPLES, Spread, resampled, spread
from .measure import frame_times
from .power_law import NORMAL, Power
from .reference_image import reference_windows
from .thinned_image import Estimate, thinned
from .variants import BASE, Variant

WIDTHS = (480, 960, 1920)  # columns of the images
MOST_ROWS = 1080  # of the widest by default
LEAST_WIDTH, MOST_WIDTH = 64, 1 << 14
GROWING = (
    *(BASE, "fast", "float64", "samples-4", "shaded-4", "shaded-16"),
    *("gouraud", "gouraud-4", "vertex-texture", "trilinear", "course"),
)
FRAMES, SECONDS = 11, 10.0  # of each variant at each size, in turns


@dataclass(frozen=True, eq=False)
class Point:
    """One variant at one size. times: milliseconds of its frames. error: RMSE against the converged image of this size."""

    resolution: tuple[int, int]
    times: tuple[float, ...]
    error: Estimate

    @property
    def ms(self) -> Spread:
        return spread(self.times)

    @property
    def pixels(self) -> int:
        return self.resolution[0] * self.resolution[1]


@dataclass(frozen=True, eq=False)
class Growth:
    """One variant at all sizes, the smallest first."""

    variant: Variant
    points: tuple[Point, ...]

    def time_power(self) -> Power:
        """Return the power of the number of pixels that times follow; the interval is a bootstrap over the frames."""
        found = [np.median(resampled(point.times, seed), axis=1) for seed, point in enumerate(self.points)]
        medians = np.stack(found, axis=1)
        return self._power(np.array([point.ms.median for point in self.points]), medians)

    def error_power(self) -> Power | None:
        """Return the power that errors at these sizes follow, as far as they are known: windows are a sample, and the
        reference has an error of its own. At sizes in between edges lie otherwise on the pixels. None if there is an
        image without error."""
        errors = np.array([point.error for point in self.points])
        if not (errors > 0.0).all():
            return None
        middle, low, high = np.log(errors).T
        noise = np.random.default_rng(0).normal(size=(RESAMPLES, len(middle)))
        return self._power(errors[:, 0], np.exp(middle + noise * (high - low) / (2.0 * NORMAL)))

    def _power(self, values: Floats, samples: Floats) -> Power:
        """Return the fit of the values, (K,), with the interval of the fits of samples of them, (RESAMPLES, K)."""
        x = np.log([point.pixels for point in self.points])
        weights = (x - x.mean()) / np.square(x - x.mean()).sum()
        low, high = np.percentile(np.log(samples) @ weights, COVERAGE)
        return Power(float(np.log(values) @ weights), float(low), float(high))

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        found = self.error_power()
        return {
            "variant": self.variant.name,
            "points": [
                {"resolution": point.resolution, "frame_ms": point.ms._asdict(), "rmse": point.error._asdict()}
                for point in self.points
            ],
            "time_power": self.time_power()._asdict(),
            "error_power": found and found._asdict(),
        }


def resolutions(scene: Scene, widths: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Return the sizes of the scene's image with these columns; by default WIDTHS, all smaller if the widest would have more
    than MOST_ROWS rows. Raises InputError."""
    columns, rows = scene.camera.resolution
    shape = rows / columns
    if not widths:
        scale = min(1.0, MOST_ROWS / (WIDTHS[-1] * shape))
        widths = [max(round(scale * width), LEAST_WIDTH) for width in WIDTHS]
    if len(set(widths)) < 2 or not all(LEAST_WIDTH <= width <= MOST_WIDTH for width in widths):
        given = ",".join(map(str, widths))
        expected = f"two or more widths from {LEAST_WIDTH} to {MOST_WIDTH} columns"
        raise InputError(f"report: --sizes: expected {expected}, found {given}")
    return [(width, max(1, round(width * shape))) for width in sorted(set(widths))]


def growths(
    scene: Scene, variants: Sequence[Variant], base: Settings, device: Device, sizes: Sequence[tuple[int, int]]
) -> list[Growth]:
    """Measure the variants at these sizes. base: settings that they change."""
    found = [_at(replace(scene, camera=scene.camera.with_resolution(size)), variants, base, device) for size in sizes]
    return [Growth(each, tuple(points)) for each, points in zip(variants, zip(*found, strict=True), strict=True)]


def _at(scene: Scene, variants: Sequence[Variant], base: Settings, device: Device) -> list[Point]:
    """Measure the variants at the scene's own size; errors in windows of large images."""
    with ExitStack() as stack:
        renderers = [
            stack.enter_context(Renderer(scene, settings=each.settings(base), device=device)) for each in variants
        ]
        if not renderers:
            return []
        first = renderers[0].render().rgb
        windows = thinned(first, scene.face_count)
        images: list[Array] = [windows.of(first), *(windows.of(each.render().rgb) for each in renderers[1:])]
        times = frame_times(renderers, FRAMES, SECONDS)
    converged = reference_windows(scene, base, device, windows)
    errors = [windows.estimate(image, converged.rgb).widened(converged.error) for image in images]
    return [Point(scene.camera.resolution, *each) for each in zip(times, errors, strict=True)]


# Tables


def header(found: Sequence[Growth]) -> Row:
    sizes = [f"{columns}x{rows}" for columns, rows in (point.resolution for point in found[0].points)]
    return ("variant", *(f"ms, {size}" for size in sizes), "power", *(f"RMSE, {size}" for size in sizes), "power")


def rows(found: Sequence[Growth]) -> list[Row]:
    return [
        (
            each.variant.title,
            *(digits(point.ms.median) for point in each.points),
            str(each.time_power()),
            *(digits(point.error.rmse) for point in each.points),
            str(each.error_power() or "-"),
        )
        for each in found
    ]


def statements(found: Sequence[Growth]) -> list[str]:
    """Return, for each variant but the first, its time and error relative to the first's, size by size."""
    base, *others = found
    said = []
    for each in others:
        times, errors = (
            ", ".join(f"{of(own) / of(basic):.2f}" for own, basic in zip(each.points, base.points, strict=True))
            for of in (_median, _rmse)
        )
        said.append(f"{each.variant.title}: {times} times the time of {base.variant.title}, {errors} times its error")
    return said


def _median(point: Point) -> float:
    return point.ms.median


def _rmse(point: Point) -> float:
    return point.error.rmse
