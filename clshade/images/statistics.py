"""Contents of an image file: statistics per channel, dynamic range, header, single pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path
from ..base.json_values import in_line, named_values, plain
from ..base.text_tables import as_lines
from .image_file import Picture, named_pixel, picture_of

PERCENTILES = (1, 5, 50, 95, 99)
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec.709 R, G, B: ITU-R BT.709, second row of RGB to XYZ

_BLOCK = 1 << 18  # pixels whose temporary float64 arrays are small compared with an image
_TYPES = {"float16": "half", "float32": "float", "uint32": "uint"}  # as EXR calls them


@dataclass(frozen=True)
class ChannelStatistics:
    """Statistics of one channel. minimum, maximum, mean and percentiles: of its finite values, NaN if there are none.

    type: half, float or uint, as EXR calls them; for PNG 8-bit or 16-bit, with values code / largest code.
    percentiles: the values at 1, 5, 50, 95 and 99 percent, each the value of a pixel (nearest rank).
    nan, inf, negative: numbers of pixels; inf counts both signs, negative counts finite values below 0.
    """

    type: str
    minimum: float
    maximum: float
    mean: float
    percentiles: tuple[float, ...]
    nan: int
    inf: int
    negative: int


@dataclass(frozen=True)
class Statistics:
    """Statistics of an image. shape: (M, N). channels: by name, in the file's order with R, G, B, A first.

    color: the layer whose luminance is used: `RGB`, else `Y`, else the first color layer; None if there is none.
    stops: dynamic range, log2(highest / lowest luminance) over the pixels of finite luminance above 0. None without
        color or without such a pixel.
    stops_most: the same between the 0.1 and 99.9 percent of those pixels, which is robust against single pixels.
    """

    shape: tuple[int, int]
    channels: dict[str, ChannelStatistics]
    color: str | None
    stops: float | None
    stops_most: float | None

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON: null for missing ones."""
        rows, columns = self.shape
        channels = {
            name: {**asdict(c), "percentiles": dict(zip(map(str, PERCENTILES), c.percentiles, strict=True))}
            for name, c in self.channels.items()
        }
        ranges = {"layer": self.color, "all": self.stops, "without_0.1_percent": self.stops_most}
        found = {"width": columns, "height": rows, "channels": channels, "dynamic_range_stops": ranges}
        figures: dict[str, Any] = plain(found)
        return figures


def _nearest(values: Array, percents: tuple[float, ...], *, overwrite: bool = False) -> list[float]:
    """Return percentiles by nearest rank. overwrite: whether the values may be reordered, which saves a copy."""
    found = np.percentile(values, percents, method="nearest", overwrite_input=overwrite)
    return [float(value) for value in found]


def _of_channel(plane: Array, kind: str) -> ChannelStatistics:
    nan = inf = 0
    values = plane.reshape(-1)
    if plane.dtype.kind == "f":
        finite = np.isfinite(values)
        nan = int(np.count_nonzero(np.isnan(values)))
        inf = values.size - int(np.count_nonzero(finite)) - nan
        values = values[finite] if nan or inf else values
    if not values.size:
        none = math.nan
        return ChannelStatistics(kind, none, none, none, (none,) * len(PERCENTILES), nan, inf, 0)
    return ChannelStatistics(
        kind,
        float(values.min()),
        float(values.max()),
        float(values.mean(dtype=np.float64)),
        tuple(_nearest(values, PERCENTILES)),
        nan,
        inf,
        int(np.count_nonzero(values < 0)),
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

    source: path of an EXR or PNG file, a Picture, or input of `exr.flatten`: a dict of (M, N) arrays, or an array
        (M, N, 3|4). For EXR the display window counts, with 0 where the data window has no pixels.
    Raises InputError for a file that cannot be read or for arrays of other shapes.
    """
    picture = picture_of(source)
    color = picture.color()
    ranges: tuple[float | None, float | None] = (None, None)
    stops = np.zeros(0) if color is None else stops_of(color[1])
    if stops.size:
        whole = float(stops.max() - stops.min())
        low, high = _nearest(stops, (0.1, 99.9), overwrite=True)
        ranges = whole, high - low
    del stops
    channels = {
        name: _of_channel(
            plane, f"{picture.bits}-bit" if picture.bits else _TYPES.get(plane.dtype.name, plane.dtype.name)
        )
        for name, plane in picture.channels.items()
    }
    return Statistics(picture.shape, channels, None if color is None else color[0], *ranges)


def format_statistics(found: Statistics) -> str:
    """Format the statistics as a table, one line per channel, with the size above and the dynamic range below."""
    head = ["channel", "type", "min", "1 %", "5 %", "median", "mean", "95 %", "99 %", "max", "NaN", "Inf", "negative"]
    rows = []
    for name, c in found.channels.items():
        first, low, middle, high, last = c.percentiles
        form = ".0f" if c.type == "uint" else ".6g"  # identifiers are not rounded
        ranks = [f"{v:{form}}" for v in (c.minimum, first, low, middle, high, last, c.maximum)]
        ranks.insert(4, f"{c.mean:.6g}")
        rows.append([in_line(name), c.type, *ranks, str(c.nan), str(c.inf), str(c.negative)])
    height, width = found.shape
    if found.stops is None or found.stops_most is None:
        closing = "dynamic range: none (no pixel of positive luminance)"
    else:
        of = "" if found.color == "RGB" else f" ({in_line(found.color)})"
        closing = f"dynamic range{of}: {found.stops:.1f} stops, {found.stops_most:.1f} without 0.1 % at either end"
    return "\n".join([f"{width} x {height} pixels", *as_lines(head, rows), closing])


def format_header(header: Mapping[str, Any]) -> str:
    """Format the attributes of a file, one per line."""
    lines = [f"  {in_line(name)}: {in_line(value)}" for name, value in header.items()]
    return "\n".join(["header:" if header else "header: empty", *lines])


def format_pixels(picture: Picture, places: Sequence[tuple[int, int]]) -> str:
    """Format all channels at columns x and rows y, one line per pixel. Raises InputError outside the image."""
    where = "(column, row from the top)"
    return "\n".join(f"pixel {x},{y} {where}: {named_values(named_pixel(picture, x, y))}" for x, y in places)


def pixel_stats(picture: Picture, places: Sequence[tuple[int, int]]) -> list[dict[str, Any]]:
    """Return the same for JSON, with the strings nan, inf and -inf for nonfinite values."""
    return [{"x": x, "y": y, "values": plain(named_pixel(picture, x, y), words=True)} for x, y in places]
