"""Magnified crops of an image, and the image with their places marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..base.arrays import Array, Bytes
from ..base.validation import value_error
from . import lettering
from .lettering import Color

SIDE = 512  # pixels that a crop's longer side is magnified to, if no factor is given
MAX_FACTOR, MAX_PIXELS = 64, 1 << 26  # of a crop, magnified
COLORS: tuple[Color, ...] = ((255, 176, 0), (64, 196, 255), (255, 96, 160), (140, 230, 90), (200, 150, 255))


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


def magnified(picture: Array, crop: Crop) -> Bytes:
    """Return the crop of an image (M, N, 3) with every pixel as a square of `crop.scale` pixels."""
    part = picture[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
    large: Bytes = part.repeat(crop.scale, axis=0).repeat(crop.scale, axis=1)
    return large


def marked(picture: Array, crops: Sequence[Crop]) -> Bytes:
    """Return the image (M, N, 3) uint8 with a numbered frame around each crop, just outside of it."""
    result: Bytes = np.array(picture)
    colors = [COLORS[k % len(COLORS)] for k in range(len(crops))]
    for crop, color in zip(crops, colors, strict=True):
        _frame(result, crop, 2, (0, 0, 0))
        _frame(result, crop, 1, color)
    for number, (crop, color) in enumerate(zip(crops, colors, strict=True), 1):
        if len(crops) > 1:
            _number(result, crop, str(number), color)
    return result


def _frame(picture: Array, crop: Crop, distance: int, color: Color) -> None:
    """Draw a frame one pixel wide, so many pixels outside of the crop; clipped at the image."""
    rows, columns = picture.shape[:2]
    top, left = crop.y - distance, crop.x - distance
    bottom, right = crop.y + crop.height - 1 + distance, crop.x + crop.width - 1 + distance
    for row in (y for y in (top, bottom) if 0 <= y < rows):
        picture[row, max(left, 0) : right + 1] = color
    for column in (x for x in (left, right) if 0 <= x < columns):
        picture[max(top, 0) : bottom + 1, column] = color


def _number(picture: Array, crop: Crop, text: str, color: Color) -> None:
    """Draw a number on a plate above the crop; where there is no room, below it; else in its corner."""
    size, height = 8.0, 15
    width = lettering.width_of(text, size) + 6
    above, below = crop.y - 2 - height, crop.y + crop.height + 2
    top = above if above >= 0 else below if below + height <= len(picture) else crop.y
    left = min(max(crop.x - 2, 0), max(picture.shape[1] - width, 0))
    picture[top : top + height, left : left + width] = color
    lettering.put(picture, left + 3, top + height - 3, size, text)
