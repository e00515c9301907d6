"""A sample of an image's pixels in small windows, and the RMSE of the whole image estimated from it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Floats, Integers
from ...pipeline.struct_layout import TILE_SIZE
from ...scene.camera import Camera
from ..timing import mean_interval

PIXELS = 1 << 15  # of the windows together, about
WHOLE = 2 * PIXELS  # images of no more pixels are not thinned
WINDOWS = (12, 128)  # fewest and most
FACES = 1 << 22  # set up for all windows together: each costs the scene's geometry once more
EVERYWHERE, CONTRAST, BRIGHTNESS = 0.25, 0.5, 0.25  # shares of the windows that follow each


class Window(NamedTuple):
    """A rectangle of an image's pixels. left, top: its first column, and row from the top."""

    left: int
    top: int
    width: int
    height: int

    @property
    def place(self) -> tuple[slice, slice]:
        """Its index in the array of an image."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)

    def camera(self, camera: Camera, scale: int = 1) -> Camera:
        """Return the camera of this part of the image, drawn `scale` times as large. It sees the pixels of the whole image,
        as far as projecting rounds to the same 1/65536 px."""
        columns, rows = camera.resolution
        (height, width), (right, up) = camera.plane, camera.principal
        below = rows - self.top - self.height
        return replace(
            camera,
            resolution=(scale * self.width, scale * self.height),
            plane=(height * self.height / rows, width * self.width / columns),
            principal=((right * columns - self.left) / self.width, (up * rows - below) / self.height),
        )


class Estimate(NamedTuple):
    """An estimated RMSE, and its 95 % interval."""

    rmse: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Thinned:
    """Some windows of an image of `pixels` pixels.

    windows: no two overlap. times: (W,) how often each was drawn. chances: (W,) of each in one draw.

    Draw k of n takes a window at random from the k-th of n equal shares of the sum of all chances p. So the mean over the
    draws of a window's squared error / p is an unbiased estimate of the sum over the image (Hansen and Hurwitz, On the
    Theory of Sampling from Finite Populations, 1943). The interval of its root is a bootstrap over the draws: rather too
    wide, as they are stratified, but where the error is in few windows it may miss them all.
    """

    pixels: int
    windows: tuple[Window, ...]
    times: Integers
    chances: Floats

    @property
    def count(self) -> int:
        """Pixels of the windows."""
        return sum(window.width * window.height for window in self.windows)

    def of(self, image: Array) -> Array:
        """Return the pixels of an image (M, N, 3) that lie in the windows, (K, 3), window by window."""
        return np.concatenate([image[window.place].reshape(-1, 3) for window in self.windows])

    def estimate(self, pixels: Array, expected: Array) -> Estimate:
        """Return the RMSE between two images, from their pixels as `of` returns them."""
        squared = np.square(np.asarray(pixels, np.float64) - expected).mean(axis=1)
        starts = np.cumsum([0, *(window.width * window.height for window in self.windows)])[:-1]
        draws = np.repeat(np.add.reduceat(squared, starts) / (self.chances * self.pixels), self.times)
        low, high = mean_interval(draws.tolist())
        return Estimate(*(math.sqrt(square) for square in (draws.mean(), low, high)))

    def about(self) -> str:
        if len(self.windows) == 1:
            return "the whole image"
        return f"{self.count:,} of {self.pixels:,} pixels, in {len(self.windows)} windows"


def thinned(image: Array, faces: int) -> Thinned:
    """Choose the windows for images like this one, (M, N, 3), of a scene of so many faces; the same ones every time.

    Their sides are multiples of a tile's; where there are many faces they are fewer and larger. More of them lie where
    neighboring pixels differ, as sampling errs there, and where the image is bright or dark, as approximations of lighting
    err there.
    """
    rows, columns = image.shape[:2]
    if rows * columns <= WHOLE:
        return Thinned(rows * columns, (Window(0, 0, columns, rows),), np.ones(1, np.int64), np.ones(1))
    count = min(max(FACES // max(faces, 1), WINDOWS[0]), WINDOWS[1])
    side = TILE_SIZE * max(1, round(math.sqrt(PIXELS / count) / TILE_SIZE))
    chances = _chances(image, side)
    across = -(-columns // side)
    places = np.arange(len(chances)).reshape(-1, across)
    places[1::2] = places[1::2, ::-1].copy()
    path = places.reshape(-1)  # each window beside the one before
    shares = (np.arange(count) + np.random.default_rng(0).random(count)) / count
    picked, times = np.unique(
        path[np.searchsorted(np.cumsum(chances[path])[:-1], shares, side="right")], return_counts=True
    )
    windows = []
    for place in picked.tolist():
        left, bottom = place % across * side, place // across * side
        height = min(side, rows - bottom)
        windows.append(Window(left, rows - bottom - height, min(side, columns - left), height))
    return Thinned(rows * columns, tuple(windows), times, chances[picked])


def _chances(image: Array, side: int) -> Floats:
    """Return the chance of each window of this side, row by row from the bottom left."""
    rgb = np.asarray(image[::-1], np.float64)
    rgb = rgb / (np.abs(rgb).max() or 1.0)  # no fourth power overflows
    contrast = np.zeros(rgb.shape[:2])
    contrast[1:] += np.square(np.diff(rgb, axis=0)).sum(axis=-1)
    contrast[:, 1:] += np.square(np.diff(rgb, axis=1)).sum(axis=-1)
    brightness = np.square(np.square(rgb - rgb.mean(axis=(0, 1))).sum(axis=-1))
    total: Floats = np.zeros(1)
    for share, measure in ((EVERYWHERE, np.ones(rgb.shape[:2])), (CONTRAST, contrast), (BRIGHTNESS, brightness)):
        rows = np.add.reduceat(measure, range(0, image.shape[0], side), axis=0)
        sums = np.add.reduceat(rows, range(0, image.shape[1], side), axis=1)
        total = total + share * sums.reshape(-1) / (sums.sum() or 1.0)
    chances: Floats = total / total.sum()
    return chances
