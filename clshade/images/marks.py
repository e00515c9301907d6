"""What is drawn on pictures: text in matplotlib's default font, an axes triad, scale bars, frames of magnified crops; and
contact sheets: images with titles and captions in a grid."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base.arrays import Array, Bytes
from ..base.validation import value_error

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

DPI = 100
LINE = 1.8  # line spacing in pixels per point of text size

Color = tuple[int, int, int]

AXES: dict[str, Color] = {"x": (200, 40, 40), "y": (30, 135, 50), "z": (40, 85, 215)}
INK: Color = (40, 40, 40)
_FADED = 0.5  # how far colors of axes that point away are from full color to white
_FINE = 4  # subpixels per pixel and side
_LENGTH, _HEAD, _STROKE, _DOT, _LETTER = 0.36, 0.095, 0.03, 0.06, 0.12  # of the triad's side
_LABEL = 1.32  # of an axis's length: how far its label is from the origin
_SEEN_END_ON = 0.12  # axes that are shorter in the image, of 1, are drawn as a dot or a ring

PANEL = 272  # pixels, the width of a panel
FRAME = 160  # gray

SIDE = 512  # pixels that a crop's longer side is magnified to, if no factor is given
MAX_FACTOR, MAX_PIXELS = 64, 1 << 26  # of a crop, magnified
COLORS: tuple[Color, ...] = ((255, 176, 0), (64, 196, 255), (255, 96, 160), (140, 230, 90), (200, 150, 255))


@cache
def _font() -> Any:
    """Return matplotlib's default font without importing the rest of it, which takes as long as the figures."""
    from matplotlib import get_data_path
    from matplotlib.ft2font import FT2Font

    return FT2Font(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"))


@lru_cache(maxsize=256)
def text_line(text: str, size: float) -> tuple[Bytes, int]:
    """Render a line of text, of `size` points, as (height, width) uint8, 255 for ink; and return its rows below the
    baseline."""
    from matplotlib import ft2font

    font, module = _font(), vars(ft2font)
    font.set_size(size, DPI)
    unhinted = module["LoadFlags"].NO_HINTING if "LoadFlags" in module else module["LOAD_NO_HINTING"]  # by version
    font.set_text(text, 0.0, flags=unhinted)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.array(font.get_image()), font.get_descent() // 64  # from 1/64 pixel


def text_width(text: str, size: float) -> int:
    """Return the width of a line of text in pixels."""
    return int(text_line(text, size)[0].shape[1])


def drawable(text: str) -> str:
    """Return the text with `?` for characters that the font lacks or that are not printable."""
    glyph = _font().get_char_index
    return "".join(letter if letter.isprintable() and glyph(ord(letter)) else "?" for letter in text)


def fit_text(text: str, size: float, width: float) -> str:
    """Return the text, drawable, its end replaced by dots if it is wider than `width` pixels; "" if nothing fits."""
    text = drawable(text)
    if not text or text_width(text, size) <= width:
        return text
    shortened = [text[:length].rstrip() + "..." for length in range(len(text))]
    count = bisect_right(shortened, width, key=lambda short: text_width(short, size))  # how many fit
    return shortened[count - 1] if count else ""


def draw_text(picture: Array, x: float, y: float, size: float, text: str, color: Color = (0, 0, 0)) -> None:
    """Draw a line of text on a picture (height, width, 3) uint8, its left end at column x, its baseline at row y.

    What lies outside the picture is clipped.
    """
    ink, descent = text_line(text, size)
    left, top = round(x), round(y) + descent - len(ink)
    ink = ink[max(-top, 0) : max(len(picture) - top, 0), max(-left, 0) : max(picture.shape[1] - left, 0)]
    place = picture[max(top, 0) :, max(left, 0) :][: len(ink), : ink.shape[1]]
    share = ink[:, :, None] / 255.0
    place[:] = np.rint(place * (1.0 - share) + np.array(color) * share)


def fade(color: Color) -> Color:
    """Return the color of an axis that points away from the eye."""
    r, g, b = (round(value + (255 - value) * _FADED) for value in color)
    return r, g, b


def triad(axes: Array, side: int) -> Bytes:
    """Draw the axes of world space as a camera sees them, (side, side, 3) uint8 on white.

    axes: (3, 3), the camera's right, up and forward in rows, as `geometry.camera_axes` returns them. An axis that points
    away from the eye is lighter; one along the line of sight is a dot (towards the eye) or a ring (away).
    """
    from PIL import Image, ImageDraw

    picture = Image.new("RGB", (side * _FINE, side * _FINE), "white")
    draw = ImageDraw.Draw(picture)
    flat = axes[:2].T * (1.0, -1.0)
    labels = _label_places(flat)
    places = np.concatenate([flat, labels, np.zeros((1, 2))])
    low, high = places.min(axis=0), places.max(axis=0)
    length = min(_LENGTH, (1.0 - 1.7 * _LETTER) / max(*(high - low), 1e-9)) * side
    origin = 0.5 * side - (low + high) / 2.0 * length
    colors = [fade(color) if axes[2, axis] > 1e-9 else color for axis, color in enumerate(AXES.values())]
    for axis in sorted(range(3), key=lambda axis: -axes[2, axis]):  # the farthest first
        arrow = flat[axis] * length * _FINE
        _draw_axis(draw, origin * _FINE, arrow, axes[2, axis] > 0.0, colors[axis], side * _FINE)
    pixels = np.array(picture.resize((side, side), Image.Resampling.BOX))
    size = side * _LETTER
    for axis, name in enumerate(AXES):
        x, y = origin + labels[axis] * length
        width = text_width(name, size)
        # The height of letters without ascenders is about 3/4 of the size in points at 100 dots per inch.
        draw_text(pixels, x - width / 2, y + 0.375 * size, size, name, colors[axis])
    return pixels


def _label_places(flat: Array) -> Array:
    """Return (3, 2): where the labels stand, in lengths of an axis from the origin.

    flat: (3, 2) directions of the axes in the image, y down. The label of an axis seen end-on is opposite to the others.
    """
    lengths = np.hypot(*flat.T)
    places, end_on = np.empty((3, 2)), lengths < _SEEN_END_ON
    places[~end_on] = flat[~end_on] * (1.0 + (_LABEL - 1.0) / lengths[~end_on, None])
    others = flat[~end_on].sum(axis=0)
    places[end_on] = -0.55 * others / np.hypot(*others)
    return places


def _draw_axis(draw: ImageDraw, origin: Array, arrow: Array, away: bool, color: Color, side: float) -> None:
    """Draw one axis into a square of `side` subpixels. origin: where it begins; arrow: from there to its tip, y down."""
    length = float(np.hypot(*arrow))
    stroke, head, radius = round(_STROKE * side), _HEAD * side, _DOT * side
    if length < _SEEN_END_ON * _LENGTH * side:
        box = [*(origin - radius), *(origin + radius)]
        draw.ellipse(box, outline=color, width=stroke, fill="white" if away else color)
        return
    along = arrow / length
    tip, back = origin + arrow, origin + along * max(length - head, 0.0)
    wide = np.array([-along[1], along[0]]) * head * 0.42
    draw.line([*origin, *back], fill=color, width=stroke)
    draw.polygon([tuple(tip), tuple(back + wide), tuple(back - wide)], fill=color)


def round_length(limit: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `limit`, which is above 0 and finite."""
    power = 10.0 ** math.floor(math.log10(limit))
    factor = max(f for f in (1.0, 2.0, 5.0, 10.0) if f * power <= limit * (1.0 + 1e-12) or f == 1.0)
    # 3 * 0.1 is not 0.3: the nearest float to the decimal number.
    return float(f"{factor * power:.0e}")


def scale_bar(picture: Array, x: float, y: int, pixels: float, color: Color = INK) -> None:
    """Draw a bar with end ticks into a picture, from column x on, `pixels` long, its line at row y.

    The ticks' inner edges are where the length begins and ends, to half a pixel.
    """
    left, right = round(x), round(x + pixels)
    picture[y - 1 : y + 1, left:right] = color
    for start in (left, right - 2):
        picture[max(y - 5, 0) : y + 5, max(start, 0) : start + 2] = color


class Crop(NamedTuple):
    """A rectangle of an image: column x and row y of its top left pixel, width and height in pixels; magnified by
    `factor`, 0 for the largest whole number with which its longer side stays within SIDE pixels."""

    x: int
    y: int
    width: int
    height: int
    factor: int = 0

    @property
    def scale(self) -> int:
        return self.factor or min(max(SIDE // max(self.width, self.height), 1), MAX_FACTOR)

    def check(self, who: str, columns: int, rows: int) -> None:
        """Raise InputError unless the rectangle lies in an image of this size and its magnification is not too large."""
        inside = self.x >= 0 and self.y >= 0 and self.x + self.width <= columns and self.y + self.height <= rows
        text = ",".join(map(str, self if self.factor else self[:4]))
        if not inside or min(self.width, self.height) < 1:
            raise value_error("crop", who, f"X,Y,W,H within {columns} x {rows} pixels", text)
        if not 0 <= self.factor <= MAX_FACTOR or self.width * self.height * self.scale**2 > MAX_PIXELS:
            limit = f"a factor from 1 to {MAX_FACTOR} and at most {MAX_PIXELS} pixels magnified"
            raise value_error("crop", who, limit, text)


def magnify(picture: Array, crop: Crop) -> Bytes:
    """Return the crop of an image (M, N, 3) with every pixel as a square of `crop.scale` pixels."""
    part = picture[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
    large: Bytes = part.repeat(crop.scale, axis=0).repeat(crop.scale, axis=1)
    return large


def mark_crops(picture: Array, crops: Sequence[Crop]) -> Bytes:
    """Return the image (M, N, 3) uint8 with a frame around each crop, just outside of it; several are numbered."""
    from PIL import Image, ImageDraw

    canvas = Image.fromarray(np.array(picture))
    for crop, color in zip(crops, cycle(COLORS)):
        left, top, right, bottom = crop.x - 1, crop.y - 1, crop.x + crop.width, crop.y + crop.height
        ImageDraw.Draw(canvas).rectangle((left - 1, top - 1, right + 1, bottom + 1), outline=(0, 0, 0))
        ImageDraw.Draw(canvas).rectangle((left, top, right, bottom), outline=color)
    result: Bytes = np.array(canvas)
    size, height = 8.0, 15  # of a number in points, of its plate in pixels
    for number, (crop, color) in enumerate(zip(crops, cycle(COLORS)), 1) if len(crops) > 1 else ():
        width = text_width(str(number), size) + 6
        above, below = crop.y - 2 - height, crop.y + crop.height + 2
        top = above if above >= 0 else below if below + height <= len(result) else crop.y
        left = min(max(crop.x - 2, 0), max(result.shape[1] - width, 0))
        result[top : top + height, left : left + width] = color
        draw_text(result, left + 3, top + height - 3, size, str(number))
    return result


@dataclass(frozen=True)
class Layout:
    """Sizes of a sheet, in pixels but for texts."""

    across: int = 4  # panels per row
    panel: int = PANEL  # width of a panel
    gap: int = 12  # with title, caption and head the space around panels
    title: int = 22
    caption: int = 54
    head: int = 26
    title_size: float = 8  # of titles, in points
    text_size: float = 6.5  # of captions

    def corner(self, number: int, height: int) -> tuple[int, int]:
        """Return column and row of the top left pixel of the panel of this number, from 0; `height`: of all panels."""
        row, column = divmod(number, self.across)
        step = height + self.title + self.caption
        return column * (self.panel + self.gap) + self.gap // 2, self.head + row * step + self.title


@dataclass
class Panel:
    """An image, (height, width, 3) uint8 or, shown in false colors, (height, width), with a title above and text below."""

    picture: Array
    title: str
    text: str


def reduced(picture: Array) -> Array:
    """Resize an image (M, N, 3) or (M, N), uint8, to a panel."""
    from PIL import Image

    rows, columns = picture.shape[:2]
    height = min(max(PANEL * rows // columns, 16), 4 * PANEL)
    return np.array(Image.fromarray(picture).resize((PANEL, height), Image.Resampling.BOX))


def _center(sheet: Array, x: float, y: float, size: float, text: str) -> None:
    """Draw centered lines of text on a sheet (height, width, 3), the first baseline y pixels from the top."""
    for k, line in enumerate(text.split("\n")):
        width = text_width(line, size)
        draw_text(sheet, x - width / 2, y + k * LINE * size, size, line)


def compose_sheet(panels: Sequence[Panel], heading: str, layout: Layout | None = None) -> Array:
    """Return the sheet, (height, width, 3) uint8: the panels, all of one size, in rows of `layout.across`."""
    layout = layout or Layout()
    height, width = len(panels[0].picture), layout.panel
    rows = -(-len(panels) // layout.across)
    size = layout.corner(rows * layout.across, height)[1] - layout.title, (width + layout.gap) * layout.across
    sheet = np.full((*size, 3), 255, np.uint8)
    _center(sheet, sheet.shape[1] / 2, 2 * layout.title_size, layout.title_size, heading)
    for k, panel in enumerate(panels):
        x, y = layout.corner(k, height)
        picture = panel.picture
        if picture.ndim == 2:
            from matplotlib import colormaps

            picture = (colormaps["magma"](picture)[:, :, :3] * 255.0).astype(np.uint8)
        sheet[y - 1 : y + height + 1, x - 1 : x + width + 1] = FRAME
        sheet[y : y + height, x : x + width] = picture
        _center(sheet, x + width / 2, y - 0.75 * layout.title_size, layout.title_size, panel.title)
        _center(sheet, x + width / 2, y + height + 12, layout.text_size, panel.text)
    return sheet
