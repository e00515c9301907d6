"""What is in an HDR image: statistics per channel, its dynamic range, and a picture of it at several exposures."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from . import atomic, exr
from .atomic import Path
from .errors import InputError
from .tonemap import tonemap

Array = np.ndarray

PERCENTILES = (1, 50, 99)
STOPS = tuple(range(-4, 5))
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec.709 R, G, B: ITU-R BT.709, second row of RGB to XYZ

_PANEL = 480  # pixels of the image along a panel's longer side, at most; more are skipped over
_INCHES, _GAP, _LABEL = 3.2, 0.1, 0.3  # longer side of a panel, space beside it, space above it for its label


@dataclass(frozen=True)
class ChannelStatistics:
    """One channel. minimum, maximum, mean and percentiles are over its finite values, NaN where there are none.

    percentiles: the values at 1, 50 and 99 percent, each of them a value of some pixel (nearest rank).
    nan, inf, negative: numbers of pixels; inf counts both signs, negative counts finite values below 0.
    """

    minimum: float
    maximum: float
    mean: float
    percentiles: tuple[float, float, float]
    nan: int
    inf: int
    negative: int


@dataclass(frozen=True)
class Statistics:
    """An image. shape: (M, N). channels: by name, in the file's order with R, G, B, A first.

    stops: dynamic range, log2(highest / lowest luminance) over the pixels of finite luminance above 0. None without
        channels R, G, B (or Y) or without such a pixel.
    stops_most: the same between the 0.1 and 99.9 percent of those pixels, which single pixels do not change.
    """

    shape: tuple[int, int]
    channels: dict[str, ChannelStatistics]
    stops: float | None
    stops_most: float | None


def _channels(source: Path | Mapping[str, Array] | Array) -> dict[str, Array]:
    if isinstance(source, (str, os.PathLike)):
        return exr.read(source)[0]
    return exr.flatten(source)


def _nearest(values: Array, percents: tuple[float, ...]) -> list[float]:
    return [float(v) for v in np.percentile(values, percents, method="nearest")]


def _of_channel(plane: Array) -> ChannelStatistics:
    nan = inf = 0
    values = plane.reshape(-1)
    if plane.dtype.kind == "f":
        finite = np.isfinite(values)
        nan = int(np.count_nonzero(np.isnan(values)))
        inf = values.size - int(np.count_nonzero(finite)) - nan
        values = values[finite] if nan or inf else values
    if not values.size:
        return ChannelStatistics(math.nan, math.nan, math.nan, (math.nan,) * 3, nan, inf, 0)
    low, middle, high = _nearest(values, PERCENTILES)
    return ChannelStatistics(
        float(values.min()),
        float(values.max()),
        float(values.mean(dtype=np.float64)),
        (low, middle, high),
        nan,
        inf,
        int(np.count_nonzero(values < 0)),
    )


def _color(channels: dict[str, Array]) -> list[Array] | None:
    """The planes R, G, B; Y three times of a luminance image; None where there is neither."""
    for names in ("RGB", "YYY"):
        if all(name in channels for name in names):
            return [channels[name] for name in names]
    return None


def _ranges(channels: dict[str, Array]) -> tuple[float | None, float | None]:
    color = _color(channels)
    if color is None:
        return None, None
    with np.errstate(invalid="ignore", over="ignore"):
        weighted = [weight * plane.astype(np.float64) for weight, plane in zip(LUMINANCE, color, strict=True)]
        luminance = weighted[0] + weighted[1] + weighted[2]
        lit = luminance[np.isfinite(luminance) & (luminance > 0)]
    if not lit.size:
        return None, None
    low, high = _nearest(lit, (0.1, 99.9))
    return math.log2(lit.max()) - math.log2(lit.min()), math.log2(high) - math.log2(low)


def statistics(source: Path | Mapping[str, Array] | Array) -> Statistics:
    """Statistics of every channel of an image.

    source: path of an EXR file, or what `exr.flatten` takes: a dict of (M, N) arrays, or an array (M, N, 3|4).
    Raises InputError for a file that cannot be read or for arrays of other shapes.
    """
    channels = _channels(source)
    shape = next(iter(channels.values())).shape
    stops, stops_most = _ranges(channels)
    return Statistics((shape[0], shape[1]), {n: _of_channel(p) for n, p in channels.items()}, stops, stops_most)


def format_statistics(statistics: Statistics) -> str:
    """The statistics as a table of text, one line per channel, with the size above and the dynamic range below."""
    head = ["channel", "min", "1 %", "median", "mean", "99 %", "max", "NaN", "Inf", "negative"]
    rows = [head]
    for name, c in statistics.channels.items():
        low, middle, high = c.percentiles
        values = [f"{v:.6g}" for v in (c.minimum, low, middle, c.mean, high, c.maximum)]
        rows.append([name, *values, str(c.nan), str(c.inf), str(c.negative)])
    widths = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]) for row in rows]
    height, width = statistics.shape
    if statistics.stops is None or statistics.stops_most is None:
        last = "dynamic range: none (no pixel of positive luminance)"
    else:
        last = f"dynamic range: {statistics.stops:.1f} stops, {statistics.stops_most:.1f} without 0.1 % at either end"
    return "\n".join([f"{width} x {height} pixels", *lines, last])


def exposure_ladder(source: Path | Mapping[str, Array] | Array, out_png: Path) -> None:
    """Write a PNG that shows an image at -4 to +4 stops, nine labeled panels, tone map `srgb`.

    source: as for `statistics`, with channels R, G, B (or Y). out_png: the picture, written whole or not at all.
    A large image is thinned out to about 480 pixels a side: every k-th pixel is shown, so none is averaged away.
    Raises InputError for a source without these channels, OutputError when it cannot be written.
    """
    channels = _channels(source)
    color = _color(channels)
    if color is None:
        raise InputError(f"exposure_ladder: expected channels R, G, B (or Y), found {', '.join(channels)}")
    rows, columns = color[0].shape
    rgb = np.stack([p[:: -(-rows // _PANEL), :: -(-columns // _PANEL)] for p in color], axis=-1)
    with np.errstate(over="ignore"):
        rgb = rgb.astype(np.float32)

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shape = min(max(rows / columns, 0.25), 4.0)  # a strip of pixels is stretched until it can be seen
    width, height = (_INCHES, _INCHES * shape) if shape < 1 else (_INCHES / shape, _INCHES)
    step_x, step_y = width + _GAP, height + _LABEL
    total_x, total_y = 3 * step_x + _GAP, 3 * step_y + _GAP
    figure = Figure(figsize=(total_x, total_y), dpi=100, facecolor="0.7")
    FigureCanvasAgg(figure)
    for k, stops in enumerate(STOPS):
        left, bottom = _GAP + (k % 3) * step_x, _GAP + (2 - k // 3) * step_y
        axes = figure.add_axes((left / total_x, bottom / total_y, width / total_x, height / total_y))
        axes.imshow(tonemap(rgb, "srgb", stops), aspect="auto", interpolation="nearest")
        axes.set_title(f"{stops:+d} stops".replace("1 stops", "1 stop"), fontsize=9)
        axes.set_axis_off()
    with atomic.replacing(out_png) as file:
        figure.savefig(file, format="png")
