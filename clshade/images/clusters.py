"""Where two images differ most: regions of pixels with a large error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array, connected_components
from ..base.json_values import plain

MOST = 8  # regions that are listed
CELLS = 512  # along the longer side of the grid in which regions are found
_LEAST_CELL = 4  # pixels: large errors that are nearer than that are of one region
_DEVIATIONS = 10.0  # above the median, in standard deviations as estimated from the median absolute deviation
_NORMAL = 1.4826  # standard deviation / median absolute deviation of a normal distribution: 1/Phi^-1(3/4)
_SAMPLE = 1 << 20  # errors of which medians are taken


class Cluster(NamedTuple):
    """A region of pixels with a large error: its bounding box, column x and row y of the top left pixel.

    pixels: how many have a large error. maximum: the largest of them, infinite for NaN or infinity in one image alone.
    worst: its column and row.
    """

    x: int
    y: int
    width: int
    height: int
    pixels: int
    maximum: float
    worst: tuple[int, int]

    def __str__(self) -> str:
        count = f"{self.pixels:,} pixel" + "s" * (self.pixels != 1)
        return f"{self.width} x {self.height} at {self.x},{self.y} ({count}, up to {self.maximum:.3g})"

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON, with the text inf for an infinite error."""
        found: dict[str, Any] = plain(self._asdict(), words=True)
        return found


def leading(clusters: Sequence[Cluster], count: int) -> list[Cluster]:
    """Return the `count` largest clusters, the one with the largest error always among them."""
    found = list(clusters[:count])
    if found and (worst := max(clusters, key=lambda each: each.maximum)) not in found:
        found[-1] = worst
    return found


def large_error(errors: Array, threshold: float | None = None) -> float:
    """Return the error above which a pixel belongs to a cluster.

    It is the median of all pixels plus 10 robust standard deviations, so that noise all over the image does not count,
    but not more than half of the largest finite error, which always counts. threshold: at least this, if any error is
    above it.
    """
    every = errors.reshape(-1)[:: max(1, errors.size // _SAMPLE)]
    every = every[np.isfinite(every)]
    middle = float(np.median(every)) if every.size else 0.0
    spread = _NORMAL * float(np.median(np.abs(every - middle))) if every.size else 0.0
    finite = float(np.max(errors, initial=0.0, where=np.isfinite(errors)))
    found = min(middle + _DEVIATIONS * spread, finite / 2.0)
    if threshold is not None and threshold > found and (errors > threshold).any():
        return threshold
    return found


def find_clusters(errors: Array, threshold: float | None = None) -> tuple[Cluster, ...]:
    """Return the largest regions of large errors (`large_error`), most pixels first, and the one with the largest error.

    errors: (M, N) of at least 0, infinite where a value is NaN or infinite in one image alone. Pixels belong to one
    region if they lie in the same or in neighboring cells of a grid: at least 4 x 4 pixels, more in images above 2048.
    At most MOST regions.
    """
    limit = large_error(errors, threshold)
    rows, columns = errors.shape
    cell = max(_LEAST_CELL, -(-max(errors.shape) // CELLS))
    grid = np.zeros((-(-rows // cell), -(-columns // cell)), bool)
    for y, x, _ in _over(errors, limit, cell):
        grid[y // cell, x // cell] = True
    cells = _labels(grid)
    count = int(cells.max(initial=-1)) + 1
    if not count:
        return ()
    low, high = np.full((2, count), max(errors.shape)), np.full((2, count), -1)
    pixels, most, where = np.zeros(count, np.int64), np.full(count, -1.0), np.zeros((2, count), np.int64)
    for y, x, error in _over(errors, limit, cell):
        owner = cells[y // cell, x // cell]
        for axis, places in enumerate((y, x)):
            np.minimum.at(low[axis], owner, places)
            np.maximum.at(high[axis], owner, places)
        pixels += np.bincount(owner, minlength=count)
        before = most.copy()
        np.maximum.at(most, owner, error)
        first = np.flatnonzero((error == most[owner]) & (most[owner] > before[owner]))[::-1]
        where[:, owner[first]] = y[first], x[first]
    order = np.lexsort((-most, -pixels))
    worst = int(np.argmax(most))
    chosen = [int(each) for each in order[:MOST]]
    if worst not in chosen:
        chosen[-1] = worst
    sizes = high - low + 1

    def cluster(k: int) -> Cluster:
        x, y, width, height = (int(each[k]) for each in (low[1], low[0], sizes[1], sizes[0]))
        worst_at = int(where[1, k]), int(where[0, k])
        return Cluster(x, y, width, height, int(pixels[k]), float(most[k]), worst_at)

    return tuple(map(cluster, chosen))


def _over(errors: Array, limit: float, cell: int) -> Iterator[tuple[Array, Array, Array]]:
    """Yield rows, columns and values of the errors above the limit, some rows of cells at a time."""
    step = cell * max(1, (1 << 20) // (errors.shape[1] * cell))
    for start in range(0, len(errors), step):
        part = errors[start : start + step]
        y, x = np.nonzero(part > limit)
        yield y + start, x, part[y, x]


def _labels(grid: Array) -> Array:
    """Return (M, N) the number of the region of each set cell, from 0, or -1; of eight neighbors all are connected."""
    numbers = np.arange(grid.size).reshape(grid.shape)
    first, second = [], []
    for near, far in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1], np.s_[1:]),
        (np.s_[:-1, :-1], np.s_[1:, 1:]),
        (np.s_[:-1, 1:], np.s_[1:, :-1]),
    ):
        both = grid[near] & grid[far]
        first.append(numbers[near][both])
        second.append(numbers[far][both])
    roots = connected_components(grid.size, np.concatenate(first), np.concatenate(second)).reshape(grid.shape)
    found = np.full(grid.shape, -1)
    found[grid] = np.unique(roots[grid], return_inverse=True)[1].reshape(-1)
    return found
