"""Layers of any content as small display images; figures without a display and without pyplot; bars of color maps."""

from __future__ import annotations

import io
import itertools
import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base import atomic_files
from ..base.arrays import Array, Bytes
from .colors import Rgb, map_colors
from .decode import srgb_to_linear
from .image_file import Group, group_channels
from .tonemap import tonemap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OURS, OTHER, MUTED = "#1f5fa8", "#c0504d", "gray"
FORMATS = ("png", "pdf", "svg")  # that figures are saved as
VECTOR_DPI = 200  # of pictures within PDF and SVG
# Fonts are embedded as TrueType in PDF, and drawn as outlines in SVG, which holds no fonts; names within an SVG are the same
# on every run.
_VECTOR: dict[Any, Any] = {"pdf.fonttype": 42, "svg.fonttype": "path", "svg.hashsalt": "clshade"}
_NO_DATE = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}

MAX_LAYERS = 60  # in a figure
_PANEL, _TITLE = 3.0, 0.45  # inches: longer side of a panel, and the space above it
_COLUMNS = 4
_LETTERS = 18  # per inch of a panel's title

SIDE = 320  # pixels, at most, along the longer side of a thumbnail; others are skipped, so that none is averaged away
UNIT_OFF = 1e-2  # tolerance for the length of a direction: half floats are off by 1e-3
COLORS = ("red", "green", "blue")
NOTHING = (96, 96, 96)  # gray for NaN and infinity where colors stand for numbers
_RANGE = (1.0, 99.0)  # percentiles that colors span: a single outlier would take them all

_BAR_DPI = 100
_BAR_LETTERS = 9.0  # width of the bar, its values and its title, in heights of letters


class Thumbnail(NamedTuple):
    """A small display image. pixels: (h, w, 3) uint8, row 0 at the top. note: what its colors mean, a few words."""

    pixels: Array
    note: str


def blank(width: float, height: float, dpi: int = 110) -> Figure:
    """Create an empty figure; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: str | Path, colors: int | None = None) -> None:
    """Save as PNG, optionally with a palette of `colors` colors: a third of the size; or as PDF or SVG, by the suffix.
    Raises OutputError."""
    kind = Path(path).suffix[1:].lower()
    atomic_files.write_bytes(path, as_vectors(figure, kind) if kind in _NO_DATE else _as_png(figure, colors))


def as_vectors(figure: Figure, kind: str) -> bytes:
    """Return the figure as a file of this kind, pdf or svg: the same bytes for the same figure."""
    from matplotlib import rc_context

    file = io.BytesIO()
    with rc_context(_VECTOR):
        figure.savefig(file, format=kind, dpi=VECTOR_DPI, metadata=_NO_DATE[kind])
    return file.getvalue()


def _as_png(figure: Figure, colors: int | None = None) -> bytes:
    from PIL import Image

    figure.canvas.draw()
    picture = Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])  # type: ignore[attr-defined]
    if colors is not None:
        picture = picture.quantize(colors, dither=Image.Dither.NONE)
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True)
    return file.getvalue()


def panel_size(shape: tuple[int, ...], longer: float = _PANEL) -> tuple[float, float]:
    """Return width and height in inches of a panel for an image of (M, N, ...); strips are widened to be visible."""
    aspect = min(max(shape[0] / shape[1], 0.25), 4.0)
    return (longer, longer * aspect) if aspect < 1.0 else (longer / aspect, longer)


def show_pixels(axes: Any, pixels: Array, title: str) -> None:
    """Show an image with a title, without axes or interpolation; strips are stretched."""
    strip = not 0.25 <= pixels.shape[0] / pixels.shape[1] <= 4.0
    axes.imshow(pixels, aspect="auto" if strip else "equal", interpolation="nearest")
    axes.set_title(title, fontsize=8)
    axes.set_xticks([])
    axes.set_yticks([])


def thin(plane: Array, side: int = SIDE) -> Array:
    """Return every k-th pixel of (M, N, ...) from the first on, a view, at most `side` along the longer side.

    Strips are thinned less along the shorter side, so that some of it remains.
    """
    longer = -(-max(plane.shape[:2]) // side)
    down, across = (min(longer, -(-4 * length // side)) for length in plane.shape[:2])
    return plane[::down, ::across]


def block_maxima(errors: Array, side: int = SIDE) -> Array:
    """Return the largest error of each block of pixels of which `thin` shows the first."""
    rows, columns = thin(errors, side).shape
    down, across = -(-errors.shape[0] // rows), -(-errors.shape[1] // columns)
    padded = np.pad(errors, ((0, rows * down - errors.shape[0]), (0, columns * across - errors.shape[1])))
    maxima: Array = padded.reshape(rows, down, columns, across).max(axis=(1, 3))
    return maxima


def thumbnails(channels: Mapping[str, Array], *, encoded: bool = False, side: int = SIDE) -> dict[str, Thumbnail]:
    """Return a thumbnail of each layer of an image. channels: name -> (M, N); encoded: whether colors are sRGB-encoded.

    Integers are taken as identifiers, each with a color of its own, 0 black; X, Y, Z as a direction if they have length
    1, shown as (n + 1)/2, else as a position; R, G, B as a color; single floats as a quantity.
    """
    return {name: _thumbnail(group, side, encoded) for name, group in group_channels(channels).items()}


def _thumbnail(group: Group, side: int, encoded: bool) -> Thumbnail:
    family, planes = group.family, [thin(plane, side) for plane in group.planes]
    if any(plane.dtype.kind in "iub" for plane in planes):
        return Thumbnail(_categories(planes), "each number a color")
    if len(planes) == 1:
        spread, low, high = _spread(planes[0])
        pixels = apply_color_map(np.nan_to_num(spread), "viridis")
        pixels[np.isnan(spread)] = NOTHING
        gray = ", gray infinite or NaN" if np.isnan(spread).any() else ""
        return Thumbnail(pixels, "none is finite" if np.isnan(low) else f"dark {low:.4g} to light {high:.4g}{gray}")
    stacked = np.stack(planes, axis=-1).astype(np.float64)
    if family == "RGB" and len(planes) == 3:
        return Thumbnail(tonemap(srgb_to_linear(stacked) if encoded else stacked, "srgb"), "as it is, sRGB")
    if family == "UVW":
        colors = ", ".join(f"{color} {name[-1].lower()}" for color, name in zip(COLORS, group.names, strict=False))
        with np.errstate(invalid="ignore"):
            return Thumbnail(_codes(stacked % 1.0), f"{colors}, from 0 to 1, repeated")
    if family == "XYZ" and len(planes) == 3:
        with np.errstate(over="ignore", invalid="ignore"):
            lengths = np.sqrt(np.square(stacked).sum(axis=-1, keepdims=True))
        nonzero = lengths[lengths != 0.0]
        if nonzero.size and (np.abs(nonzero - 1.0) <= UNIT_OFF).all():
            shades = np.where(stacked.any(axis=-1, keepdims=True), (stacked + 1.0) / 2.0, 0.0)
            return Thumbnail(_codes(shades), "(n + 1)/2")
    return Thumbnail(_codes(np.stack([_spread(plane)[0] for plane in planes], axis=-1)), "each component's range")


def apply_color_map(values: Array, name: str) -> Array:
    """Return the colors of one of Matplotlib's maps for (M, N) values from 0 to 1, uint8 (M, N, 3)."""
    from matplotlib import colormaps

    pixels: Array = np.rint(255.0 * colormaps[name](values)[..., :3]).astype(np.uint8)
    return pixels


def _codes(values: Array) -> Array:
    """Convert (M, N, 2|3) floats from 0 to 1 to (M, N, 3) uint8, a missing component to 0; gray where one is not finite."""
    codes = np.zeros((*values.shape[:2], 3), np.uint8)
    codes[..., : values.shape[2]] = np.rint(255.0 * np.clip(np.nan_to_num(values), 0.0, 1.0))
    codes[~np.isfinite(values).all(axis=-1)] = NOTHING
    return codes


def _spread(plane: Array) -> tuple[Array, float, float]:
    """Return a plane, its finite values mapped from a percentile range to [0, 1], others NaN; and the range."""
    plane = np.where(np.isfinite(plane), plane, np.nan).astype(np.float64)
    if np.isnan(plane).all():
        return plane, np.nan, np.nan
    low, high = map(float, np.nanpercentile(plane, _RANGE, method="nearest"))
    spread = (plane - low) / (high - low) if high > low else plane * 0.0 + 0.5
    return np.clip(spread, 0.0, 1.0), low, high


def _categories(planes: Sequence[Array]) -> Array:
    """Return a color for each number, or tuple of them, that does not depend on the image; 0 is black."""
    state = np.zeros(planes[0].shape, np.uint32)
    nothing = np.ones(planes[0].shape, bool)
    for plane in planes:
        nothing &= plane == 0
        # A multiplicative hash: odd factors, and the high bits folded down, so that neighbors look different.
        state = (state ^ (np.nan_to_num(plane.astype(np.float64)) % 2**32).astype(np.uint32)) * np.uint32(0x9E3779B1)
        state = (state ^ (state >> np.uint32(15))) * np.uint32(0x85EBCA6B)
        state ^= state >> np.uint32(13)
    codes = np.stack([(state >> np.uint32(shift)) & np.uint32(0xFF) for shift in (0, 8, 16)], axis=-1).astype(np.uint8)
    codes = codes // 4 * 3 + 64  # 64 to 253: none as dark as 0
    codes[nothing] = 0
    return codes


def draw_thumbnails(figure: Any, pictures: Mapping[str, Thumbnail], columns: int) -> None:
    """Draw the thumbnails, each with name and note, in `columns` columns into a figure or a subfigure."""
    rows = math.ceil(len(pictures) / columns)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    letters = max(12, int(_LETTERS * figure.bbox.width / figure.dpi / columns))
    for axes, (name, picture) in zip(panels, pictures.items(), strict=False):
        show_pixels(axes, picture.pixels, f"{plain_text(name)}\n{textwrap.fill(picture.note, letters)}")
    for axes in panels[len(pictures) :]:
        axes.set_axis_off()


def plot_thumbnails(pictures: Mapping[str, Thumbnail]) -> Figure:
    """Return a figure of the thumbnails, the first 60 of them, at most four in a row.

    Notebooks display it as the value of a cell, whether or not pyplot is imported.
    """
    pictures = first_few(pictures)
    columns = min(len(pictures), _COLUMNS)
    width, height = panel_size(next(iter(pictures.values())).pixels.shape)
    figure = blank(columns * width, math.ceil(len(pictures) / columns) * (height + _TITLE), dpi=100)
    draw_thumbnails(figure, pictures, columns)
    vars(figure)["_repr_png_"] = lambda: _as_png(figure)
    return figure


def first_few(pictures: Mapping[str, Thumbnail]) -> dict[str, Thumbnail]:
    """Return the thumbnails that fit into a figure of at most 2^16 pixels a side; the last note counts the others."""
    chosen = dict(itertools.islice(pictures.items(), MAX_LAYERS))
    if len(pictures) > MAX_LAYERS:
        name, last = chosen.popitem()
        chosen[name] = last._replace(note=f"{last.note}; {len(pictures) - MAX_LAYERS} more layers")
    return chosen


def plain_text(text: str) -> str:
    """Return a name from a file for a figure: short, and without what matplotlib takes for formulas or line breaks."""
    printable = text if text.isprintable() else ascii(text)
    return (printable if len(printable) <= 48 else printable[:45] + "...").replace("$", r"\$")


def _letter(rows: int) -> float:
    """Return the height of letters in pixels."""
    return float(np.clip(rows / 40, 8, 32))


def bar_width(rows: int) -> int:
    """Return by how many pixels the bar widens an image of so many rows."""
    return round(_BAR_LETTERS * _letter(rows))


def with_colorbar(
    image: Bytes, colormap: str | tuple[Rgb, ...], ends: tuple[float, float], title: str, ground: Bytes
) -> Bytes:
    """Return an 8-bit image (M, N, 3 or 4) made wider by a bar on a ground of that color, (3,).

    ends: values of the bar's lower and upper end. The image's own pixels stay as they are.
    """
    rows = len(image)
    letter, width = _letter(rows), bar_width(rows)
    figure = blank(width / _BAR_DPI, rows / _BAR_DPI, _BAR_DPI)
    figure.set_layout_engine("none")
    figure.set_facecolor(tuple(ground / 255.0))
    axes = figure.add_axes((letter / width, 0.06, 1.4 * letter / width, 0.88))
    colors = map_colors(colormap)[1:-1]
    axes.imshow(colors[:, None], aspect="auto", origin="lower", interpolation="nearest", extent=(0, 1, 0, 1))
    ink = "black" if ground @ (0.2126, 0.7152, 0.0722) > 128 else "white"
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.set_yticks(*_ticks(*ends, int(np.clip(rows / (5 * letter), 2, 6))))
    axes.tick_params(colors=ink, labelsize=letter * 72 / _BAR_DPI, length=0.3 * letter)
    for spine in axes.spines.values():
        spine.set_color(ink)
    title = plain_text(title)
    size = letter * 72 / _BAR_DPI * min(1.0, 1.4 * rows / (letter * max(len(title), 1)))
    figure.text(1.0 - letter / width, 0.5, title, color=ink, rotation=90, ha="center", va="center", fontsize=size)
    figure.canvas.draw()
    bar = np.asarray(figure.canvas.buffer_rgba())[:rows, :width, : image.shape[2]]  # type: ignore[attr-defined]
    return np.concatenate([image, bar], axis=1)


def _ticks(low: float, high: float, count: int) -> tuple[list[float], list[str]]:
    """Return places along the bar, 0 to 1, about `count` of them, and the numbers there: round ones where there are."""
    from matplotlib.ticker import MaxNLocator

    half = 0.5 * high - 0.5 * low  # halves cannot overflow
    if not 1e-300 < half < 1e300:
        return ([0.0, 1.0], [f"{low:g}", f"{high:g}"]) if low < high else ([0.5], [f"{low:g}"])
    ticks = map(float, MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    values = [value for value in ticks if low <= value <= high]
    values = values if len(values) > 1 else [low, high]
    digits = math.log10(max(abs(low), abs(high)) / abs(values[1] - values[0])) if values[1] != values[0] else 4.0
    labels = [f"{value:.{min(max(math.ceil(digits) + 1, 6), 12)}g}" for value in values]
    return [(0.5 * value - 0.5 * low) / half for value in values], labels
