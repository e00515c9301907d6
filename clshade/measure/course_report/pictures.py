"""Pictures for a page: differences in colors, the part of the images that holds the object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.arrays import Array, Bools, Bytes, Floats

MOST = 1024  # columns and rows of a picture; larger images are reduced
MARGIN = 0.04  # around the object, of its longer side
SLIMMEST = 0.62  # ratio of a part's shorter side to its longer one
WHOLE = 0.6  # a part that is more of the image's area than this is no help: the whole is shown
ENLARGED = 384  # pixels of the longer side of a detail, at least
COLORS = "magma_r"  # of differences: light to dark, because pages are white
OBJECT = 236  # gray level of the object where nothing differs


class Part(NamedTuple):
    """A rectangle of an image, in pixels from the upper left corner."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: Array) -> Array:
        """Return this part of an image (M, N, ...)."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


def reduced_size(resolution: tuple[int, int]) -> tuple[int, int]:
    """Return columns and rows of at most MOST pixels a side, in the same proportion."""
    scale = min(1.0, MOST / max(resolution))
    columns, rows = (max(1, round(length * scale)) for length in resolution)
    return columns, rows


def reduced(picture: Bytes) -> Bytes:
    """Return a picture, (M, N, 3) uint8, of at most MOST pixels a side: itself, or means of its pixels."""
    from PIL import Image

    size = reduced_size((picture.shape[1], picture.shape[0]))
    if size == (picture.shape[1], picture.shape[0]):
        return picture
    return np.array(Image.fromarray(picture).resize(size, Image.Resampling.BOX))


def enlarged(picture: Bytes) -> Bytes:
    """Return a small picture with each pixel as a square of at least one, ENLARGED pixels along the longer side or more."""
    times = max(1, -(-ENLARGED // max(picture.shape[:2])))
    return picture.repeat(times, axis=0).repeat(times, axis=1)


def part_with(covered: Bools) -> Part:
    """Return the part of an image that holds the object, with a margin; the whole image where that is nearly as large.

    covered: (M, N), where the object is.
    """
    rows, columns = covered.shape
    whole = Part(0, 0, columns, rows)
    if not covered.any():
        return whole
    spans = [np.flatnonzero(covered.any(axis=axis))[[0, -1]] for axis in (0, 1)]
    sides = [int(last) - int(first) + 1 for first, last in spans]
    sides = [side + 2 * max(1, round(MARGIN * max(sides))) for side in sides]
    sides = [
        min(max(side, round(SLIMMEST * max(sides))), most) for side, most in zip(sides, (columns, rows), strict=True)
    ]
    if sides[0] * sides[1] > WHOLE * columns * rows:
        return whole
    left, top = (
        centered((int(first) + int(last) + 1) / 2.0, side, most)
        for (first, last), side, most in zip(spans, sides, (columns, rows), strict=True)
    )
    return Part(left, top, *sides)


def centered(center: float, side: int, most: int) -> int:
    """Return the start of an interval of length `side` about a center, within 0 to `most`."""
    return max(0, min(round(center - side / 2.0), most - side))


def painted(difference: Floats, covered: Bools, dark: float) -> Bytes:
    """Return a difference (M, N), 0 or more, in colors, (M, N, 3) uint8: light is little, the darkest color `dark` or more.

    White where nothing differs; light gray on the object. covered: (M, N), where the object is.
    """
    from matplotlib import colormaps

    level = np.clip(difference / dark if dark > 0.0 else difference, 0.0, 1.0)
    colors = (colormaps[COLORS](level)[..., :3] * 255.0 + 0.5).astype(np.uint8)
    nothing = difference == 0.0
    colors[nothing] = 255
    colors[nothing & covered] = OBJECT
    return np.asarray(colors)


def scale() -> Bytes:
    """Return the colors of `painted` from 0 to the darkest, as a strip."""
    return painted(np.tile(np.linspace(1e-3, 1.0, 256), (8, 1)), np.ones((8, 256), bool), 1.0)


def worst_parts(error: Floats, side: int, count: int) -> list[Part]:
    """Return up to `count` squares of `side` pixels, none over another, that hold the largest sums of squared error.

    Worst first; each is centered on the error in it where it fits. None holds no error.
    """
    rows, columns = error.shape
    high, wide = min(side, rows), min(side, columns)
    squared = np.square(error, dtype=np.float64)
    sums = np.pad(squared.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    windows = np.maximum(sums[high:, wide:] - sums[:-high, wide:] - sums[high:, :-wide] + sums[:-high, :-wide], 0.0)
    found: list[Part] = []
    while len(found) < count:
        top, left = (int(index) for index in np.unravel_index(int(windows.argmax()), windows.shape))
        within = Part(left, top, wide, high).of(squared)
        total = float(within.sum())
        if total == 0.0 or windows[top, left] < 0.0:
            break
        down = centered(top + float(within.sum(axis=1) @ (np.arange(high) + 0.5)) / total, high, rows)
        across = centered(left + float(within.sum(axis=0) @ (np.arange(wide) + 0.5)) / total, wide, columns)
        if windows[down, across] >= 0.0:  # over none of those before
            top, left = down, across
        found.append(Part(left, top, wide, high))
        windows[max(top - high + 1, 0) : top + high, max(left - wide + 1, 0) : left + wide] = -1.0
    return found
