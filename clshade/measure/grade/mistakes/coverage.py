"""Mistakes in which pixels triangles cover, and which triangle is shown."""

from __future__ import annotations

from functools import partial

import numpy as np

from ....base.arrays import Floats, Integers
from ....oracle.transform import SUBPIXELS
from ..drawing import Drawing, Edit, Reach, instead, then
from .mistake import Mistake, wrong_setting

_HALF = SUBPIXELS // 2
_COMPASS = (
    *(("to the right", 1, 0), ("to the left", -1, 0), ("up", 0, 1), ("down", 0, -1)),
    *(("right and up", 1, 1), ("right and down", 1, -1), ("left and up", -1, 1), ("left and down", -1, -1)),
)


def _shift(xy: Integers, by: tuple[int, int]) -> Integers:
    moved: Integers = xy + np.array(by)
    return moved


def _shifts(size: int) -> dict[str, Edit]:
    """Return shifts to all sides by so many steps of snapped positions."""
    return {words: then(snap=partial(_shift, by=(size * x, size * y))) for words, x, y in _COMPASS}


SUBPIXEL_SHIFTS = _shifts(SUBPIXELS // 256)


def _corner(xy: Integers) -> Integers:
    """Return the corners of pixels at the lower left."""
    return xy // SUBPIXELS * SUBPIXELS


def _painted(drawing: Drawing) -> bool:
    return drawing.settings.visibility == "painter"


def _thrice(z: Floats) -> Floats:
    """Return depths (F,) at all three corners."""
    return np.repeat(z[:, None], 3, axis=1)


MISTAKES = (
    Mistake("nothing is drawn", "The image shows the background alone.", {"": instead(reach=Reach(True, ()))}),
    Mistake("whole pixels off", "Pixel (column, row) counts from 0.", _shifts(SUBPIXELS)),
    Mistake("half a pixel off", "Pixel centers lie at column + 0.5 and row + 0.5.", _shifts(_HALF)),
    Mistake(
        "corners rounded to pixels",
        "Keep the fractions of projected corners.",
        {
            "to the nearest corner of pixels": then(snap=lambda xy: _corner(xy + _HALF)),
            "down, to a corner of pixels": then(snap=_corner),
            "to the nearest corner, taken for centers": then(snap=lambda xy: _corner(xy + _HALF) + _HALF),
            "down, taken for centers": then(snap=lambda xy: _corner(xy) + _HALF),
        },
    ),
    Mistake(
        "one pixel too many",
        "A triangle's span ends before the edge that it meets.",
        {
            "to the right": instead(reach=Reach(True, ((0, 0), (-1, 0)))),
            "to the left": instead(reach=Reach(True, ((0, 0), (1, 0)))),
            "on both sides": instead(reach=Reach(True, ((0, 0), (-1, 0), (1, 0)))),
            "up": instead(reach=Reach(True, ((0, 0), (0, -1)))),
            "down": instead(reach=Reach(True, ((0, 0), (0, 1)))),
        },
    ),
    Mistake(
        "one pixel too few",
        "Triangles miss their last pixel: range(first, last) leaves out last.",
        {
            "at the right": instead(reach=Reach(False, ((0, 0), (1, 0)))),
            "at the left": instead(reach=Reach(False, ((0, 0), (-1, 0)))),
            "at the top": instead(reach=Reach(False, ((0, 0), (0, 1)))),
            "at the bottom": instead(reach=Reach(False, ((0, 0), (0, -1)))),
        },
    ),
    Mistake(
        "painter's order reversed",
        "Far triangles cover near ones: sort by depth, farthest first.",
        {"": instead(order=lambda z: -z)},
        _painted,
    ),
    Mistake(
        "no sort",
        "Triangles are drawn in the order of the file: sort them by depth, farthest first.",
        {
            "first to last": instead(order=np.zeros_like),
            "last to first": instead(order=lambda z: _thrice(np.arange(len(z), dtype=np.float64))),
        },
        _painted,
    ),
    Mistake(
        "sorted by one corner",
        "Sort triangles by the mean depth of all three corners.",
        {
            "first": instead(order=lambda z: _thrice(z[:, 0])),
            "second": instead(order=lambda z: _thrice(z[:, 1])),
            "third": instead(order=lambda z: _thrice(z[:, 2])),
            "nearest": instead(order=lambda z: _thrice(z.min(axis=1))),
            "farthest": instead(order=lambda z: _thrice(z.max(axis=1))),
        },
        _painted,
    ),
    Mistake(
        "depth buffer",
        "Each pixel shows its nearest triangle: the course draws whole triangles in painter's order.",
        wrong_setting("visibility", {"painter": "depth"}),
    ),
    Mistake(
        "back faces left out", "The course also draws faces seen from behind.", wrong_setting("cull", {False: True})
    ),
)
