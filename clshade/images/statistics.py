"""Contents of an image file: statistics per channel, dynamic range, header, single pixels, as text and as a figure."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path
from ..base.json_values import in_line, named_values, plain
from ..base.text_tables import as_lines
from . import exr, figures
from .figures import Thumbnail, apply_color_map, thin, thumbnails
from .image_file import Picture, read_picture
from .tonemap import tonemap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PERCENTILES = (1, 5, 50, 95, 99)
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec.709 R, G, B: ITU-R BT.709, second row of RGB to XYZ

_BLOCK = 1 << 18  # pixels whose temporary float64 arrays are small compared with an image
_TYPES = {"float16": "half", "float32": "float", "uint32": "uint"}  # as EXR calls them

# Of the figure.
STOPS = tuple(range(-4, 5))
NAN, INFINITE, BLACK = (255, 0, 255), (255, 255, 255), (0, 0, 0)  # false colors of values without stops

_SIDE = 480  # pixels of the image, at most, along the longer side of a panel
_PANEL = 2.1  # inches along the longer side of an exposure; false color is twice as long
_TITLE = 0.3
_WIDTH = 13.0  # inches of the figure
_BINS = 120  # of the histogram, at most
_MIDDLE = (0.1, 99.9)  # percentiles of the lit pixels that false colors span


@dataclass(frozen=True)
class ChannelStatistics:
    """Statistics of one channel. minimum, maximum, mean and percentiles: of its finite values, NaN if there are none."""

    type: str  # half, float or uint, as EXR calls them; for PNG 8-bit or 16-bit, with values code / largest code
    minimum: float
    maximum: float
    mean: float
    percentiles: tuple[float, ...]  # by PERCENTILES, values of pixels (nearest rank)
    nan: int  # pixels
    inf: int  # pixels, of both signs
    negative: int  # pixels, finite


@dataclass(frozen=True)
class Statistics:
    """Statistics of an image."""

    shape: tuple[int, int]  # (M, N)
    channels: dict[str, ChannelStatistics]  # in the file's order with R, G, B, A first
    color: str | None  # the layer whose luminance is used: `RGB`, else `Y`, else the first color layer, if there is one
    # Dynamic range, log2(highest / lowest luminance) over the pixels of finite luminance above 0, if there are any; and
    # between the 0.1 and 99.9 percent of those pixels, robust against single ones.
    stops: float | None
    robust_stops: float | None

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON: null for missing ones."""
        channels = {
            name: {**vars(c), "percentiles": dict(zip(map(str, PERCENTILES), c.percentiles, strict=True))}
            for name, c in self.channels.items()
        }
        ranges = {"layer": self.color, "all": self.stops, "without_0.1_percent": self.robust_stops}
        height, width = self.shape
        return {"width": width, "height": height, "channels": plain(channels), "dynamic_range_stops": plain(ranges)}


def _channel_statistics(plane: Array, kind: str) -> ChannelStatistics:
    values = plane.reshape(-1)
    finite = np.isfinite(values)
    nan, lost = int(np.count_nonzero(np.isnan(values))), values.size - int(np.count_nonzero(finite))
    values = values[finite] if lost else values
    minimum, maximum, mean, percentiles = math.nan, math.nan, math.nan, (math.nan,) * len(PERCENTILES)
    if values.size:
        minimum, maximum, mean = float(values.min()), float(values.max()), float(values.mean(dtype=np.float64))
        percentiles = tuple(map(float, np.percentile(values, PERCENTILES, method="nearest")))
    return ChannelStatistics(
        kind, minimum, maximum, mean, percentiles, nan, lost - nan, int(np.count_nonzero(values < 0))
    )


def luminance(color: Array) -> Array:
    """Return (M, N) float64 luminance of linear Rec.709 (M, N, 3)."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = np.multiply(color[..., 0], LUMINANCE[0], dtype=np.float64)
        for k in (1, 2):
            total += np.multiply(color[..., k], LUMINANCE[k], dtype=np.float64)
        return total


def stops_of(color: Array) -> Array:
    """Return log2 of the luminance of linear Rec.709 (M, N, 3), flattened, where it is finite and above 0."""
    rows, columns = color.shape[:2]
    step, count = max(1, _BLOCK // columns), 0
    stops = np.empty(rows * columns)
    for start in range(0, rows, step):
        values = luminance(color[start : start + step])
        lit = np.log2(values[np.isfinite(values) & (values > 0.0)])
        stops[count : count + lit.size] = lit
        count += lit.size
    return stops[:count]


def image_statistics(source: Path | Mapping[str, Array] | Array | Picture) -> Statistics:
    """Return statistics of every channel of an image.

    source: path of an EXR or PNG file, a Picture, or linear input of `exr.flatten`: a dict of (M, N) arrays, or an array
        (M, N, 3|4). For EXR the display window counts, with 0 where the data window has no pixels.
    Raises InputError for a file that cannot be read or for arrays of other shapes.
    """
    if isinstance(source, (str, os.PathLike)):
        source = read_picture(source)
    picture = source if isinstance(source, Picture) else Picture(exr.flatten(source))
    color = picture.color()
    stops = np.zeros(0) if color is None else stops_of(color[1])
    ranges: tuple[float | None, float | None] = (None, None)
    if stops.size:
        dynamic_range = float(np.ptp(stops))
        low, high = np.percentile(stops, (0.1, 99.9), method="nearest", overwrite_input=True)  # saves a copy
        ranges = dynamic_range, float(high - low)
    del stops
    coded = f"{picture.bits}-bit" if picture.bits else ""
    channels = {
        name: _channel_statistics(plane, coded or _TYPES.get(str(plane.dtype), str(plane.dtype)))
        for name, plane in picture.channels.items()
    }
    return Statistics(picture.shape, channels, None if color is None else color[0], *ranges)


def format_statistics(statistics: Statistics) -> str:
    """Format the statistics as a table, one line per channel, with the size above and the dynamic range below."""
    head = ["channel", "type", "min", "1 %", "5 %", "median", "mean", "95 %", "99 %", "max", "NaN", "Inf", "negative"]
    rows = []
    for name, c in statistics.channels.items():
        form = ".0f" if c.type == "uint" else ".6g"  # identifiers are not rounded
        values = [f"{value:{form}}" for value in (c.minimum, *c.percentiles, c.maximum)]
        values.insert(4, f"{c.mean:.6g}")
        rows.append([in_line(name), c.type, *values, str(c.nan), str(c.inf), str(c.negative)])
    height, width = statistics.shape
    stops, robust, color = statistics.stops, statistics.robust_stops, statistics.color
    closing = "dynamic range: none (no pixel of positive luminance)"
    if stops is not None:
        layer = "" if color == "RGB" else f" ({in_line(color)})"
        closing = f"dynamic range{layer}: {stops:.1f} stops, {robust:.1f} without 0.1 % at either end"
    return "\n".join([f"{width} x {height} pixels", *as_lines(head, rows), closing])


def format_header(header: Mapping[str, Any]) -> str:
    """Format the attributes of a file, one per line."""
    lines = [f"  {in_line(name)}: {in_line(value)}" for name, value in header.items()]
    return "\n".join(["header:" if header else "header: empty", *lines])


def format_pixels(picture: Picture, places: Sequence[tuple[int, int]]) -> str:
    """Format all channels at columns x and rows y, one line per pixel. Raises InputError outside the image."""
    where = "(column, row from the top)"
    return "\n".join(f"pixel {x},{y} {where}: {named_values(picture.pixel(x, y))}" for x, y in places)


def pixel_stats(picture: Picture, places: Sequence[tuple[int, int]]) -> list[dict[str, Any]]:
    """Return the values of all channels at columns x and rows y for JSON, nonfinite ones as nan, inf and -inf."""
    return [{"x": x, "y": y, "values": plain(picture.pixel(x, y), words=True)} for x, y in places]


def draw(picture: Picture, title: str) -> Figure:
    """Draw exposures from -4 to +4 stops, false colors, a luminance histogram, and all layers; without a color layer, the
    layers alone.

    Of a large image every k-th pixel is shown, so that none is averaged away; the histogram counts all of them.
    """
    pictures = figures.first_few(thumbnails(picture.channels, encoded=bool(picture.bits)))
    columns = min(len(pictures), 6)
    panel = figures.panel_size(picture.shape, _WIDTH / max(columns, 4))
    lower = math.ceil(len(pictures) / columns) * (panel[1] + 2 * _TITLE)
    color = picture.color()
    upper = 3 * (figures.panel_size(picture.shape, _PANEL)[1] + _TITLE) if color is not None else 0.0
    figure = figures.blank(_WIDTH, upper + lower + _TITLE, dpi=100)
    figure.suptitle(figures.plain_text(title), fontsize=10)
    bottom: Any = figure
    if color is not None:
        top, bottom = bottom.subfigures(2, 1, height_ratios=[upper, lower])
        left, right = top.subfigures(1, 2, width_ratios=[3, 2.6])
        small = thin(color[1], _SIDE)
        for axes, stops in zip(left.subplots(3, 3).reshape(-1), STOPS, strict=True):
            caption = f"{stops:+d} stop{'' if abs(stops) == 1 else 's'}" if stops else "as it is"
            figures.show_pixels(axes, tonemap(small, "srgb", stops), caption)
        _draw_luminance(right, color[1])
    figures.draw_thumbnails(bottom, pictures, columns)
    return figure


def _draw_luminance(figure: Any, color: Array) -> None:
    """Draw false colors and a histogram of linear (M, N, 3), on one scale of stops.

    The bins have a width of a power of two of a stop, the smallest that gives at most _BINS.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    above, below = figure.subplots(2, 1, height_ratios=[2, 1])
    stops, pixels = stops_of(color), color.shape[0] * color.shape[1]
    low, high = -1.0, 1.0  # in whole stops
    if stops.size:
        percentiles = np.percentile(stops, _MIDDLE)
        low = math.floor(percentiles[0])
        high = max(math.ceil(percentiles[1]), low + 1.0)
    colored = false_colors(luminance(thin(color, _SIDE)), low, high)
    figures.show_pixels(above, colored.pixels, f"luminance, {colored.note}")
    figure.colorbar(ScalarMappable(Normalize(low, high), "turbo"), ax=above, label="stops, 0 is 1.0")
    below.set_xlabel("luminance in stops, 0 is 1.0", fontsize=8)
    below.set_ylabel("% of pixels", fontsize=8)
    below.tick_params(labelsize=8)
    below.set_title(f"{len(stops) / pixels:.1%} of the pixels are above 0 and finite", fontsize=8)
    if not stops.size:
        return
    width = 0.125
    while np.ptp(stops) / width > _BINS:
        width *= 2.0
    first = math.floor(stops.min() / width)
    counts = np.bincount((np.floor(stops / width) - first).astype(np.int64))
    below.bar((first + np.arange(len(counts))) * width, 100.0 * counts / pixels, width, align="edge", color="#1f5fa8")
    below.set_yscale("log")


def false_colors(values: Array, low: float, high: float) -> Thumbnail:
    """Map luminances (M, N) by stops from blue at `low` to red at `high`; those without stops get their own colors."""
    lit = np.isfinite(values) & (values > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.where(lit, (np.log2(np.where(lit, values, 1.0)) - low) / (high - low), 0.0)
    pixels = apply_color_map(np.clip(place, 0.0, 1.0), "turbo")
    pixels[values <= 0.0] = BLACK
    pixels[np.isinf(values)] = INFINITE
    pixels[np.isnan(values)] = NAN
    return Thumbnail(pixels, "black: 0 or less, magenta: NaN, white: infinite")
