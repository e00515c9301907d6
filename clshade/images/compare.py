"""Comparison of an image with a reference, layer by layer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array
from ..base.input_files import file_error, quoted
from ..base.json_values import in_line, named_values, plain
from ..base.spelling import hint
from ..base.text_tables import as_lines, digits, wrapped
from .channels import Group, grouped
from .clusters import Cluster, find_clusters, leading
from .image_file import Picture, named_pixel
from .layers import LAYER_WORDS
from .metrics import decibels, flip_of_seen, has_flip, has_ssim, relmse, seen, ssim_of_seen

_STRIP = 1 << 20  # pixels compared at a time
_LISTED = 3  # regions of large error per layer that the text names
UNEQUAL = math.inf  # error of a value that is NaN or infinite and differs from the other


class Worst(NamedTuple):
    """The pixel with the largest error: column x, row y from the top, and the values of its channels in both images."""

    x: int
    y: int
    values: dict[str, Any]
    reference: dict[str, Any]


@dataclass(frozen=True)
class Difference:
    """The differences of one layer. A pixel's error is the largest |value - reference| of its channels.

    exact: the layer holds integers, for which only equality counts.
    different: pixels that are not equal. over: pixels with an error above the threshold (without one: above 0).
    nonfinite: pixels with a value that is NaN or infinite and differs from the other; they are over any threshold.
        NaN equals NaN, infinity equals infinity of the same sign.
    maximum, mean, rmse, relmse: over the values that are finite in both, see `metrics.ImageError`; None if exact.
    psnr, ssim, flip: of display colors; None for other layers, and without the packages that they need.
    clusters: the regions of large error, largest first, see `clusters.find_clusters`.
    """

    exact: bool
    pixels: int
    different: int
    over: int
    nonfinite: int
    maximum: float | None = None
    mean: float | None = None
    rmse: float | None = None
    relmse: float | None = None
    psnr: float | None = None
    ssim: float | None = None
    flip: float | None = None
    worst: Worst | None = None
    clusters: tuple[Cluster, ...] = ()

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON: null for the infinite PSNR of equal images."""
        found = asdict(self)
        worst = None if self.worst is None else plain(self.worst._asdict(), words=True)
        figures = {name: value for name, value in found.items() if name not in ("worst", "clusters")}
        return {**plain(figures), "worst": worst, "clusters": [each.stats() for each in self.clusters]}


@dataclass(frozen=True)
class Comparison:
    """The result of `compared`. layers: by name. threshold: None if none was given.

    only_image, only_reference: layers, or channels of layers, that only one image has and that were not compared.
    """

    shape: tuple[int, int]
    threshold: float | None
    layers: dict[str, Difference]
    only_image: tuple[str, ...] = ()
    only_reference: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no pixel is over the threshold and no layer is in one image only; True without a threshold."""
        return self.threshold is None or not (self._partial or any(each.over for each in self.layers.values()))

    @property
    def identical(self) -> bool:
        return not self._partial and not any(each.different for each in self.layers.values())

    @property
    def _partial(self) -> bool:
        return bool(self.only_image or self.only_reference)

    def stats(self) -> dict[str, Any]:
        rows, columns = self.shape
        layers = {name: each.stats() for name, each in self.layers.items()}
        head = {"width": columns, "height": rows, "threshold": self.threshold}
        lacking = {"only_image": list(self.only_image), "only_reference": list(self.only_reference)}
        return {**head, "passed": self.passed, "identical": self.identical, **lacking, "layers": layers}

    def lines(self) -> list[str]:
        """Return a table, one line per layer, and the verdict."""
        limit = f"> {self.threshold or 0.0:g}"
        header = ("layer", "unequal", limit, "max", "mean", "RMSE", "relMSE", "PSNR", "SSIM", "FLIP", "worst at")
        rows = [
            (
                in_line(name),
                str(each.different),
                str(each.over),
                *(digits(v) for v in (each.maximum, each.mean, each.rmse, each.relmse, each.psnr)),
                *(digits(v, 5) for v in (each.ssim, each.flip)),
                "-" if each.worst is None else f"{each.worst.x},{each.worst.y}",
            )
            for name, each in self.layers.items()
        ]
        height, width = self.shape
        table = as_lines(header, rows)
        return [f"{width} x {height} pixels", *table, *self._worst_lines(), *self._cluster_lines(), self._verdict()]

    def _worst_lines(self) -> list[str]:
        return [
            wrapped(
                f"{in_line(name)} at {each.worst.x},{each.worst.y} (column, row from the top): "
                f"{named_values(each.worst.values)}; expected {named_values(each.worst.reference)}",
                2,
            )
            for name, each in self.layers.items()
            if each.worst is not None
        ]

    def _cluster_lines(self) -> list[str]:
        """Return a line on where the large errors are, for each layer with more than one different pixel."""
        return [
            wrapped(f"{in_line(name)} differs most in {'; '.join(map(str, leading(each.clusters, _LISTED)))}", 2)
            for name, each in self.layers.items()
            if each.different > 1 and each.clusters
        ]

    def _verdict(self) -> str:
        if self.identical:
            return "identical"
        if self.threshold is None:
            return "different"
        if self.passed:
            return f"passed: nothing is over {self.threshold:g}"
        over = {name: each.over for name, each in self.layers.items() if each.over}
        counts = ", ".join(f"{count} pixels of {in_line(name)}" for name, count in over.items())
        found = [f"over {self.threshold:g}: {counts}"] if over else []
        return f"FAILED: {'; '.join([*found, *self.lacking()])}"

    def lacking(self) -> list[str]:
        """Return one text each for the image and the reference that has layers which were not compared."""
        each = (("the image", self.only_image), ("the reference", self.only_reference))
        return [f"{', '.join(map(in_line, names))} of {where} alone" for where, names in each if names]


def chosen_layers(picture: Picture, reference: Picture, names: Sequence[str] = ()) -> dict[str, tuple[Group, Group]]:
    """Return the layers that both images have, with the channels that both have; or the named layers or channels.

    Both must have the named ones. Raises InputError, which names the image, if its size or kind differs from the
    reference's, and if nothing is left.
    """
    if picture.shape != reference.shape:
        (rows, columns), (height, width) = picture.shape, reference.shape
        raise file_error(picture.name, "size", f"{width} x {height} as of {reference.name}", f"{columns} x {rows}")
    if bool(picture.bits) != bool(reference.bits):
        wanted, given = ("a PNG" if each.bits else "an EXR" for each in (reference, picture))
        raise file_error(picture.name, "file", f"{wanted} as {reference.name} is", given)
    if names:
        groups, expected = _selected(picture, names), _selected(reference, names)
    else:
        groups, expected = (
            grouped({name: each.channels[name] for name in _shared(picture, reference)})
            for each in (picture, reference)
        )
        if not expected:
            listed = (_listed(grouped(each.channels)) for each in (reference, picture))
            raise file_error(picture.name, "layers", f"some of {next(listed)} as of {reference.name}", next(listed))
    for name, group in expected.items():
        if groups[name].names != group.names:
            raise file_error(picture.name, name, "+".join(group.names), "+".join(groups[name].names))
    return {name: (groups[name], group) for name, group in expected.items()}


def _shared(picture: Picture, reference: Picture) -> list[str]:
    """Return the channels of both images, in the reference's order."""
    return [name for name in reference.channels if name in picture.channels]


def alone(picture: Picture, other: Picture) -> tuple[str, ...]:
    """Return the layers that the other image lacks, or single channels of those that it has in part."""
    found: list[str] = []
    for name, group in grouped(picture.channels).items():
        lacking = [channel for channel in group.names if channel not in other.channels]
        found += [name] if lacking == list(group.names) else lacking
    return tuple(found)


def _listed(groups: dict[str, Group]) -> str:
    """Return layers by name, with their channels if the name does not imply them."""
    return ", ".join(
        name if name in ("".join(group.names), *group.names) else f"{name} ({'+'.join(group.names)})"
        for name, group in groups.items()
    )


def _selected(picture: Picture, names: Sequence[str]) -> dict[str, Group]:
    groups = grouped(picture.channels)
    single = {name: Group("", (name,), (plane,)) for name, plane in picture.channels.items()}
    for name in names:
        if name not in groups and name not in single:
            near = hint(name, (*groups, *single), LAYER_WORDS)
            raise file_error(picture.name, "--layer", "one of " + ", ".join(groups), f"{quoted(name)}{near}")
    return {name: groups.get(name) or single[name] for name in names}


def _strips(group: Group, reference: Group) -> Iterator[tuple[slice, Group, Group]]:
    """Yield rows of a layer of both images, few at a time, so that large images need little additional memory."""
    count, columns = group.planes[0].shape
    step = max(1, _STRIP // columns)
    for start in range(0, count, step):
        rows = slice(start, start + step)
        part, other = (each._replace(planes=tuple(plane[rows] for plane in each.planes)) for each in (group, reference))
        yield rows, part, other


def errors_of(group: Group, reference: Group) -> Array:
    """Return (M, N) float64: each pixel's error; for integers 1 where they differ."""
    worst = np.zeros(group.planes[0].shape)
    for rows, part, other in _strips(group, reference):
        for plane, expected in zip(part.planes, other.planes, strict=True):
            np.maximum(worst[rows], _errors(plane.astype(np.float64), expected.astype(np.float64)), out=worst[rows])
    if is_exact(group, reference):
        np.sign(worst, out=worst)
    return worst


def _errors(value: Array, expected: Array) -> Array:
    finite = np.isfinite(value) & np.isfinite(expected)
    with np.errstate(invalid="ignore"):
        same = (value == expected) | (np.isnan(value) & np.isnan(expected))
        return np.where(finite, np.abs(value - expected), np.where(same, 0.0, UNEQUAL))


def is_exact(group: Group, reference: Group) -> bool:
    """Return whether the values are integers, in either image."""
    return any(plane.dtype.kind in "iub" for plane in (*group.planes, *reference.planes))


def compared(
    picture: Picture, reference: Picture, names: Sequence[str] = (), threshold: float | None = None
) -> Comparison:
    """Compare layers of an image with those of a reference: all that both have, or the named ones.

    See `chosen_layers` for the errors raised.
    """
    layers = {
        name: _difference(picture, reference, pair, threshold)
        for name, pair in chosen_layers(picture, reference, names).items()
    }
    lacking = () if names else (alone(picture, reference), alone(reference, picture))
    return Comparison(picture.shape, threshold, layers, *lacking)


def _difference(picture: Picture, reference: Picture, pair: tuple[Group, Group], threshold: float | None) -> Difference:
    errors, exact = errors_of(*pair), is_exact(*pair)
    over = errors > (0.0 if exact or threshold is None else threshold)
    counts: dict[str, Any] = {
        "different": int(np.count_nonzero(errors)),
        "over": int(np.count_nonzero(over)),
        "nonfinite": int(np.count_nonzero(np.isinf(errors))),
    }
    measures: dict[str, Any] = {}
    if not exact:
        measures = {**_measures(*pair), **_seen_measures(picture, *pair)}
    found = find_clusters(errors, threshold) if counts["different"] else ()
    worst = _worst(picture, reference, pair, errors)
    return Difference(exact, errors.size, **counts, **measures, worst=worst, clusters=found)


def _worst(picture: Picture, reference: Picture, pair: tuple[Group, Group], errors: Array) -> Worst | None:
    y, x = (int(index) for index in np.unravel_index(np.argmax(errors), errors.shape))
    if not errors[y, x]:
        return None
    both = (named_pixel(image, x, y) for image in (picture, reference))
    values, expected = ({name: pixel[name] for name in pair[0].names} for pixel in both)
    return Worst(x, y, values, expected)


def _measures(group: Group, reference: Group) -> dict[str, float | None]:
    """Return measures over the values that are finite in both images; 0 if there are none."""
    count, maximum, total, squared, relative = 0, 0.0, 0.0, 0.0, 0.0
    for _, part, other in _strips(group, reference):
        for plane, wanted in zip(part.planes, other.planes, strict=True):
            finite = np.isfinite(plane) & np.isfinite(wanted)
            value, expected = plane[finite].astype(np.float64), wanted[finite].astype(np.float64)
            if not value.size:
                continue
            error = np.abs(value - expected)
            count += value.size
            maximum = max(maximum, float(error.max()))
            total += float(error.sum())
            squared += float(np.square(error).sum())
            relative += relmse(value, expected) * value.size
    count = max(count, 1)
    return {"maximum": maximum, "mean": total / count, "rmse": math.sqrt(squared / count), "relmse": relative / count}


def _seen_measures(picture: Picture, group: Group, reference: Group) -> dict[str, float | None]:
    """Return the measures of display colors, for three channels R, G, B, or the gray of a PNG."""
    if (group.family, len(group.planes)) != ("RGB", 3) and not (picture.bits and group.names == ("Y",)):
        return {}

    def shown(each: Group) -> Array:
        stacked = np.stack(each.planes * (3 // len(each.planes)), axis=-1)
        return stacked if picture.bits else seen(stacked)

    squared = sum(
        float(np.square(shown(part).astype(np.float64) - shown(other)).sum())
        for _, part, other in _strips(group, reference)
    )
    found: dict[str, float | None] = {"psnr": decibels(squared / (3 * group.planes[0].size))}
    if has_ssim() or has_flip():  # these need whole images
        images = (shown(group), shown(reference))
        found = {**found, "ssim": ssim_of_seen(*images), "flip": flip_of_seen(*images)}
    return found
