"""Marks beside images: an axes triad, a scale bar with a round length."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import Array, Bytes
from . import lettering
from .lettering import Color

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

AXES: dict[str, Color] = {"x": (200, 40, 40), "y": (30, 135, 50), "z": (40, 85, 215)}
INK: Color = (40, 40, 40)
_FADED = 0.5  # how far colors of axes that point away are from full color to white
_FINE = 4  # subpixels per pixel and side
_LENGTH, _HEAD, _STROKE, _DOT, _LETTER = 0.36, 0.095, 0.03, 0.06, 0.12  # of the triad's side
_LABEL = 1.32  # of an axis's length: how far its label is from the origin
_SEEN_END_ON = 0.12  # axes that are shorter in the image, of 1, are drawn as a dot or a ring


def faded(color: Color) -> Color:
    """Return the color of an axis that points away from the eye."""
    r, g, b = (round(value + (255 - value) * _FADED) for value in color)
    return r, g, b


def triad(axes: Array, side: int) -> Bytes:
    """Draw the axes of world space as a camera sees them, (side, side, 3) uint8 on white.

    axes: (3, 3), the camera's right, up and forward in rows, as `geometry.camera_axes` returns them. An axis that points
    away from the eye is lighter; one along the line of sight is a dot (towards the eye) or a ring (away).
    """
    from PIL import Image
    from PIL.ImageDraw import ImageDraw

    picture = Image.new("RGB", (side * _FINE, side * _FINE), "white")
    draw = ImageDraw(picture)
    flat = axes[:2].T * (1.0, -1.0)
    labels = _label_places(flat)
    places = np.concatenate([flat, labels, np.zeros((1, 2))])
    low, high = places.min(axis=0), places.max(axis=0)
    length = min(_LENGTH, (1.0 - 1.7 * _LETTER) / max(*(high - low), 1e-9)) * side
    origin = 0.5 * side - (low + high) / 2.0 * length
    colors = [faded(color) if axes[2, axis] > 1e-9 else color for axis, color in enumerate(AXES.values())]
    for axis in sorted(range(3), key=lambda axis: -axes[2, axis]):  # the farthest first
        arrow = flat[axis] * length * _FINE
        _draw_axis(draw, origin * _FINE, arrow, axes[2, axis] > 0.0, colors[axis], side * _FINE)
    pixels = np.array(picture.resize((side, side), Image.Resampling.BOX))
    size = side * _LETTER
    for axis, name in enumerate(AXES):
        x, y = origin + labels[axis] * length
        width = lettering.width_of(name, size)
        # The height of letters without ascenders is about 3/4 of the size in points at 100 dots per inch.
        lettering.put(pixels, x - width / 2, y + 0.375 * size, size, name, colors[axis])
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
