"""Comparison of an image with a reference, layer by layer, and the regions of pixels with a large error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array, connected_components
from ..base.input_files import file_error, quoted
from ..base.json_values import in_line, named_values, plain
from ..base.spelling import hint
from ..base.text_tables import as_lines, digits, wrapped
from .image_file import Group, Picture, group_channels
from .layers import LAYER_WORDS
from .metrics import decibels, flip_of_seen, has_flip, has_ssim, relmse, seen, ssim_of_seen

_STRIP = 1 << 20  # pixels compared at a time
_LISTED = 3  # regions of large error per layer that the text names
UNEQUAL = math.inf  # error of a value that is NaN or infinite and differs from the other

MAX_CLUSTERS = 8  # that are listed
CELLS = 512  # along the longer side of the grid in which regions are found
_MIN_CELL = 4  # pixels: large errors that are nearer than that are of one region
_DEVIATIONS = 10.0  # above the median, in standard deviations as estimated from the median absolute deviation
_NORMAL = 1.4826  # standard deviation / median absolute deviation of a normal distribution: 1/Phi^-1(3/4)
_SAMPLE = 1 << 20  # errors of which medians are taken


class Cluster(NamedTuple):
    """A region of pixels with a large error: its bounding box, column x and row y of the top left pixel."""

    x: int
    y: int
    width: int
    height: int
    pixels: int  # that have a large error
    maximum: float  # the largest error, infinite for NaN or infinity in one image alone
    worst: tuple[int, int]  # column and row of the largest error

    def __str__(self) -> str:
        count = f"{self.pixels:,} pixel" + "s" * (self.pixels != 1)
        return f"{self.width} x {self.height} at {self.x},{self.y} ({count}, up to {self.maximum:.3g})"


class Worst(NamedTuple):
    """The pixel with the largest error: column x, row y from the top, and the values of its channels in both images."""

    x: int
    y: int
    values: dict[str, Any]
    reference: dict[str, Any]


@dataclass(frozen=True)
class Difference:
    """The differences of one layer. A pixel's error is the largest |value - reference| of its channels; NaN equals NaN,
    infinity equals infinity of the same sign."""

    exact: bool  # the layer holds integers, for which only equality counts
    pixels: int
    different: int  # pixels that are not equal
    over: int  # pixels with an error above the threshold (without one: above 0)
    nonfinite: int  # pixels with a value that is NaN or infinite in one image; they are over any threshold
    maximum: float | None = None  # to relmse: of values finite in both, see `metrics.ImageError`; None if exact
    mean: float | None = None
    rmse: float | None = None
    relmse: float | None = None
    psnr: float | None = None  # to flip: of display colors; None for other layers, and without the packages needed
    ssim: float | None = None
    flip: float | None = None
    worst: Worst | None = None
    clusters: tuple[Cluster, ...] = ()  # the regions of large error, largest first, see `find_clusters`

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON: null for the infinite PSNR of equal images, the text inf for an infinite error."""
        worst = None if self.worst is None else self.worst._asdict()
        clusters = [cluster._asdict() for cluster in self.clusters]
        return {**plain(vars(self)), **plain({"worst": worst, "clusters": clusters}, words=True)}


@dataclass(frozen=True)
class Comparison:
    """The result of `compare_layers`."""

    shape: tuple[int, int]
    threshold: float | None
    layers: dict[str, Difference]
    only_image: tuple[
        str, ...
    ] = ()  # layers, or channels of layers, that the reference lacks and that were not compared
    only_reference: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no pixel is over the threshold and no layer is in one image only; True without a threshold."""
        return self.threshold is None or not (self.lacking() or any(layer.over for layer in self.layers.values()))

    @property
    def identical(self) -> bool:
        return not (self.lacking() or any(layer.different for layer in self.layers.values()))

    def stats(self) -> dict[str, Any]:
        height, width = self.shape
        verdict = {"threshold": self.threshold, "passed": self.passed, "identical": self.identical}
        alone = {"only_image": list(self.only_image), "only_reference": list(self.only_reference)}
        layers = {name: layer.stats() for name, layer in self.layers.items()}
        return {"width": width, "height": height, **verdict, **alone, "layers": layers}

    def lines(self) -> list[str]:
        """Return a table with a line per layer, its worst pixel, where it differs most, and the verdict."""
        limit = f"> {self.threshold or 0.0:g}"
        header = ("layer", "unequal", limit, "max", "mean", "RMSE", "relMSE", "PSNR", "SSIM", "FLIP", "worst at")
        rows, pixels, regions = [], [], []
        for layer, d in self.layers.items():
            name, place = in_line(layer), "-" if d.worst is None else f"{d.worst.x},{d.worst.y}"
            figures = [digits(value) for value in (d.maximum, d.mean, d.rmse, d.relmse, d.psnr)]
            figures += [digits(value, 5) for value in (d.ssim, d.flip)]
            rows.append((name, str(d.different), str(d.over), *figures, place))
            if d.worst is not None:
                values, reference = named_values(d.worst.values), named_values(d.worst.reference)
                pixels.append(f"{name} at {place} (column, row from the top): {values}; expected {reference}")
            if d.different > 1 and d.clusters:
                regions.append(f"{name} differs most in {'; '.join(map(str, leading_clusters(d.clusters, _LISTED)))}")
        height, width = self.shape
        details = [wrapped(line, 2) for line in pixels + regions]
        return [f"{width} x {height} pixels", *as_lines(header, rows), *details, self._verdict()]

    def _verdict(self) -> str:
        if self.identical:
            return "identical"
        if self.threshold is None:
            return "different"
        if self.passed:
            return f"passed: nothing is over {self.threshold:g}"
        over = [f"{layer.over} pixels of {in_line(name)}" for name, layer in self.layers.items() if layer.over]
        reasons = [f"over {self.threshold:g}: {', '.join(over)}"] if over else []
        return f"FAILED: {'; '.join([*reasons, *self.lacking()])}"

    def lacking(self) -> list[str]:
        """Return one text each for the image and the reference that has layers which were not compared."""
        sides = (("the image", self.only_image), ("the reference", self.only_reference))
        return [f"{', '.join(map(in_line, names))} of {side} alone" for side, names in sides if names]


def chosen_layers(picture: Picture, reference: Picture, names: Sequence[str] = ()) -> dict[str, tuple[Group, Group]]:
    """Return the layers that both images have, with the channels that both have; or the named layers or channels.

    Both must have the named ones. Raises InputError, which names the image, if its size or kind differs from the
    reference's, and if nothing is left.
    """
    if picture.shape != reference.shape:
        wanted, found = ("{1} x {0}".format(*image.shape) for image in (reference, picture))
        raise file_error(picture.name, "size", f"{wanted}, the size of {reference.name}", found)
    if bool(picture.bits) != bool(reference.bits):
        wanted, found = ("a PNG" if image.bits else "an EXR" for image in (reference, picture))
        raise file_error(picture.name, "file", f"{wanted} as {reference.name} is", found)
    shared = names or [name for name in reference.channels if name in picture.channels]
    if not shared:
        wanted, found = (_listed(group_channels(image.channels)) for image in (reference, picture))
        raise file_error(picture.name, "layers", f"some of {wanted}, the layers of {reference.name}", found)
    groups, wanted_groups = (
        _selected(image, names) if names else group_channels({name: image.channels[name] for name in shared})
        for image in (picture, reference)
    )
    for name, group in wanted_groups.items():
        if groups[name].names != group.names:
            raise file_error(picture.name, name, "+".join(group.names), "+".join(groups[name].names))
    return {name: (groups[name], group) for name, group in wanted_groups.items()}


def _alone(picture: Picture, other: Picture) -> tuple[str, ...]:
    """Return the layers that the other image lacks, or single channels of those that it has in part."""
    names: list[str] = []
    for name, group in group_channels(picture.channels).items():
        lacking = [channel for channel in group.names if channel not in other.channels]
        names += [name] if lacking == list(group.names) else lacking
    return tuple(names)


def _listed(groups: dict[str, Group]) -> str:
    """Return layers by name, with their channels if the name does not imply them."""
    return ", ".join(
        name if name in ("".join(group.names), *group.names) else f"{name} ({'+'.join(group.names)})"
        for name, group in groups.items()
    )


def _selected(picture: Picture, names: Sequence[str]) -> dict[str, Group]:
    groups = group_channels(picture.channels)
    every = {**{name: Group("", (name,), (plane,)) for name, plane in picture.channels.items()}, **groups}
    for name in names:
        if name not in every:
            near = hint(name, (*groups, *picture.channels), LAYER_WORDS)
            raise file_error(picture.name, "--layer", "one of " + ", ".join(groups), f"{quoted(name)}{near}")
    return {name: every[name] for name in names}


def _strips(group: Group, reference: Group) -> Iterator[tuple[slice, Group, Group]]:
    """Yield rows of a layer of both images, few at a time, so that large images need little additional memory."""
    count, columns = group.planes[0].shape
    step = max(1, _STRIP // columns)
    for start in range(0, count, step):
        rows = slice(start, start + step)
        yield rows, group.part(rows), reference.part(rows)


def errors_of(group: Group, reference: Group) -> Array:
    """Return (M, N) float64: each pixel's error; for integers 1 where they differ."""
    worst = np.zeros(group.planes[0].shape)
    for rows, part, reference_part in _strips(group, reference):
        for plane, expected in zip(part.planes, reference_part.planes, strict=True):
            value, other_value = plane.astype(np.float64), expected.astype(np.float64)
            with np.errstate(invalid="ignore"):
                equal = (value == other_value) | (np.isnan(value) & np.isnan(other_value))
                finite = np.isfinite(value) & np.isfinite(other_value)
                errors = np.where(finite, np.abs(value - other_value), np.where(equal, 0.0, UNEQUAL))
            np.maximum(worst[rows], errors, out=worst[rows])
    if _is_exact(group, reference):
        np.sign(worst, out=worst)
    return worst


def _is_exact(group: Group, reference: Group) -> bool:
    """Return whether the values are integers, in either image."""
    return any(plane.dtype.kind in "iub" for plane in (*group.planes, *reference.planes))


def compare_layers(
    picture: Picture, reference: Picture, names: Sequence[str] = (), threshold: float | None = None
) -> Comparison:
    """Compare layers of an image with those of a reference: all that both have, or the named ones.

    See `chosen_layers` for the errors raised.
    """
    layers = {}
    for name, pair in chosen_layers(picture, reference, names).items():
        errors, exact = errors_of(*pair), _is_exact(*pair)
        limit = 0.0 if exact or threshold is None else threshold
        different, over, nonfinite = (int(np.count_nonzero(p)) for p in (errors, errors > limit, np.isinf(errors)))
        measures: dict[str, Any] = {} if exact else {**_measures(*pair), **_display_measures(picture, *pair)}
        if different:
            measures["clusters"] = find_clusters(errors, threshold)
            y, x = map(int, np.unravel_index(np.argmax(errors), errors.shape))
            values = ({name: plane[y, x] for name, plane in zip(*layer[1:], strict=True)} for layer in pair)
            measures["worst"] = Worst(x, y, *values)
        layers[name] = Difference(exact, errors.size, different, over, nonfinite, **measures)
    lacking = () if names else (_alone(picture, reference), _alone(reference, picture))
    return Comparison(picture.shape, threshold, layers, *lacking)


def _measures(group: Group, reference: Group) -> dict[str, float | None]:
    """Return measures over the values that are finite in both images; 0 if there are none."""
    count, maximum, total, squared, relative = 0, 0.0, 0.0, 0.0, 0.0
    for _, part, reference_part in _strips(group, reference):
        for plane, wanted in zip(part.planes, reference_part.planes, strict=True):
            finite = np.isfinite(plane) & np.isfinite(wanted)
            value, expected = plane[finite].astype(np.float64), wanted[finite].astype(np.float64)
            error = np.abs(value - expected)
            count += value.size
            maximum = max(maximum, float(error.max(initial=0.0)))
            total += float(error.sum())
            squared += float(np.square(error).sum())
            relative += relmse(value, expected) * value.size if value.size else 0.0
    count = max(count, 1)
    return {"maximum": maximum, "mean": total / count, "rmse": math.sqrt(squared / count), "relmse": relative / count}


def _display_measures(picture: Picture, group: Group, reference: Group) -> dict[str, float | None]:
    """Return the measures of display colors, for three channels R, G, B, or the gray of a PNG."""
    if (group.family, len(group.planes)) != ("RGB", 3) and not (picture.bits and group.names == ("Y",)):
        return {}

    def shown(layer: Group) -> Array:
        stacked = np.stack(layer.planes * (3 // len(layer.planes)), axis=-1)
        return stacked if picture.bits else seen(stacked)

    strips = _strips(group, reference)
    squared = sum(float(np.square(shown(part).astype(np.float64) - shown(wanted)).sum()) for _, part, wanted in strips)
    psnr = decibels(squared / (3 * group.planes[0].size))
    if not (has_ssim() or has_flip()):
        return {"psnr": psnr}
    images = shown(group), shown(reference)  # whole
    return {"psnr": psnr, "ssim": ssim_of_seen(*images), "flip": flip_of_seen(*images)}


def leading_clusters(clusters: Sequence[Cluster], count: int) -> list[Cluster]:
    """Return the `count` largest clusters, the one with the largest error always among them."""
    chosen = list(clusters[:count])
    if chosen and (worst := max(clusters, key=lambda cluster: cluster.maximum)) not in chosen:
        chosen[-1] = worst
    return chosen


def large_error(errors: Array, threshold: float | None = None) -> float:
    """Return the error above which a pixel belongs to a cluster.

    It is the median of all pixels plus 10 robust standard deviations, so that noise all over the image does not count,
    but not more than half of the largest finite error, which always counts. threshold: at least this, if any error is
    above it.
    """
    sample = errors.reshape(-1)[:: max(1, errors.size // _SAMPLE)]
    sample = sample[np.isfinite(sample)]
    median = float(np.median(sample)) if sample.size else 0.0
    spread = _NORMAL * float(np.median(np.abs(sample - median))) if sample.size else 0.0
    limit = min(median + _DEVIATIONS * spread, float(np.max(errors, initial=0.0, where=np.isfinite(errors))) / 2.0)
    return threshold if threshold is not None and threshold > limit and (errors > threshold).any() else limit


def find_clusters(errors: Array, threshold: float | None = None) -> tuple[Cluster, ...]:
    """Return the largest regions of large errors (`large_error`), most pixels first, and the one with the largest error.

    errors: (M, N) of at least 0, infinite where a value is NaN or infinite in one image alone. Pixels belong to one
    region if they lie in the same or in neighboring cells of a grid: at least 4 x 4 pixels, more in images above 2048.
    At most MAX_CLUSTERS regions.
    """
    limit = large_error(errors, threshold)
    rows, columns = errors.shape
    cell = max(_MIN_CELL, -(-max(errors.shape) // CELLS))
    grid = np.zeros((-(-rows // cell), -(-columns // cell)), bool)
    for y, x, _ in _over(errors, limit, cell):
        grid[y // cell, x // cell] = True
    cells = _labels(grid)
    count = int(cells.max(initial=-1)) + 1
    if not count:
        return ()
    low, high = np.full((2, count), max(errors.shape)), np.full((2, count), -1)
    pixels, maxima, places = np.zeros(count, np.int64), np.full(count, -1.0), np.zeros((2, count), np.int64)
    for y, x, error in _over(errors, limit, cell):
        owner = cells[y // cell, x // cell]
        for axis, positions in enumerate((x, y)):
            np.minimum.at(low[axis], owner, positions)
            np.maximum.at(high[axis], owner, positions)
        pixels += np.bincount(owner, minlength=count)
        before = maxima.copy()
        np.maximum.at(maxima, owner, error)
        first = np.flatnonzero((error == maxima[owner]) & (maxima[owner] > before[owner]))[::-1]
        places[:, owner[first]] = x[first], y[first]
    chosen = np.lexsort((-maxima, -pixels))[:MAX_CLUSTERS]
    if (worst := np.argmax(maxima)) not in chosen:
        chosen[-1] = worst
    numbers, maxima = np.vstack([low, high - low + 1, pixels, places])[:, chosen].T, maxima[chosen]
    return tuple(
        Cluster(x, y, width, height, count, maximum, (column, row))
        for (x, y, width, height, count, column, row), maximum in zip(numbers.tolist(), maxima.tolist(), strict=True)
    )


def _over(errors: Array, limit: float, cell: int) -> Iterator[tuple[Array, Array, Array]]:
    """Yield rows, columns and values of the errors above the limit, some rows of cells at a time."""
    step = cell * max(1, (1 << 20) // (errors.shape[1] * cell))
    for start in range(0, len(errors), step):
        part = errors[start : start + step]
        y, x = np.nonzero(part > limit)
        yield y + start, x, part[y, x]


def _labels(grid: Array) -> Array:
    """Return (M, N) the number of the region of each set cell, from 0, or -1; of eight neighbors all are connected."""
    numbers = np.where(grid, np.arange(grid.size).reshape(grid.shape), -1)
    right, below = (numbers[:, :-1], numbers[:, 1:]), (numbers[:-1], numbers[1:])
    diagonals = (numbers[:-1, :-1], numbers[1:, 1:]), (numbers[:-1, 1:], numbers[1:, :-1])
    neighbors = np.concatenate([np.reshape(pair, (2, -1)) for pair in (right, below, *diagonals)], axis=1)
    roots = connected_components(grid.size, *neighbors[:, (neighbors >= 0).all(axis=0)]).reshape(grid.shape)
    labels = np.full(grid.shape, -1)
    labels[grid] = np.unique(roots[grid], return_inverse=True)[1].reshape(-1)
    return labels
