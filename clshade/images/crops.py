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
MOST_FACTOR, MOST_PIXELS = 64, 1 << 26  # of a crop, magnified
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
        return self.factor or min(max(SIDE // max(self.width, self.height), 1), MOST_FACTOR)

    def check(self, who: str, columns: int, rows: int) -> None:
        """Raise InputError unless the rectangle lies in an image of this size and its magnification is not too large."""
        inside = self.x >= 0 and self.y >= 0 and self.x + self.width <= columns and self.y + self.height <= rows
        given = ",".join(map(str, self if self.factor else self[:4]))
        if not inside or min(self.width, self.height) < 1:
            raise value_error("crop", who, f"X,Y,W,H within {columns} x {rows} pixels", given)
        if not 0 <= self.factor <= MOST_FACTOR or self.width * self.height * self.scale**2 > MOST_PIXELS:
            limit = f"a factor from 1 to {MOST_FACTOR} and at most {MOST_PIXELS} pixels magnified"
            raise value_error("crop", who, limit, given)


def magnified(picture: Array, crop: Crop) -> Bytes:
    """Return the crop of an image (M, N, 3) with every pixel as a square of `crop.scale` pixels."""
    part = picture[crop.y : crop.y + crop.height, crop.x : crop.x + crop.width]
    large: Bytes = part.repeat(crop.scale, axis=0).repeat(crop.scale, axis=1)
    return large


def marked(picture: Array, crops: Sequence[Crop]) -> Bytes:
    """Return the image (M, N, 3) uint8 with a numbered frame around each crop, just outside of it."""
    found: Bytes = np.array(picture)
    for number, crop in enumerate(crops, 1):
        color = COLORS[(number - 1) % len(COLORS)]
        _frame(found, crop, 2, (0, 0, 0))
        _frame(found, crop, 1, color)
    if len(crops) > 1:
        for number, crop in enumerate(crops, 1):
            _number(found, crop, str(number), COLORS[(number - 1) % len(COLORS)])
    return found


def _frame(picture: Array, crop: Crop, distance: int, color: Color) -> None:
    """Draw a frame one pixel wide, so many pixels outside of the crop; clipped at the image."""
    top, left = crop.y - distance, crop.x - distance
    bottom, right = crop.y + crop.height - 1 + distance, crop.x + crop.width - 1 + distance
    rows, columns = slice(max(top, 0), bottom + 1), slice(max(left, 0), right + 1)
    for row in (top, bottom):
        if 0 <= row < len(picture):
            picture[row, columns] = color
    for column in (left, right):
        if 0 <= column < picture.shape[1]:
            picture[rows, column] = color


def _number(picture: Array, crop: Crop, text: str, color: Color) -> None:
    """Draw a number on a plate above the crop, where there is no room below it."""
    size, height = 8.0, 15
    width = lettering.width_of(text, size) + 6
    top = crop.y - 2 - height if crop.y >= 2 + height else crop.y + crop.height + 2
    left = min(max(crop.x - 2, 0), max(picture.shape[1] - width, 0))
    picture[top : top + height, left : left + width] = color
    lettering.put(picture, left + 3, top + height - 3, size, text)
