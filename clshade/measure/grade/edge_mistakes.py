"""Mistakes in which pixels triangles cover, and which triangle is shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial

import numpy as np

from ...base.arrays import Floats, Integers
from ...oracle.transform import SUBPIXELS
from .drawing import Drawing, Reach, Variant

Snap = Callable[[Integers], Integers]
_HALF = SUBPIXELS // 2
_COMPASS = (
    *(("to the right", 1, 0), ("to the left", -1, 0), ("up", 0, 1), ("down", 0, -1)),
    *(("right and up", 1, 1), ("right and down", 1, -1), ("left and up", -1, 1), ("left and down", -1, -1)),
)


# Edges


def _shift(xy: Integers, by: tuple[int, int]) -> Integers:
    moved: Integers = xy + np.array(by)
    return moved


def _rounded(xy: Integers) -> Integers:
    return (xy + _HALF) // SUBPIXELS * SUBPIXELS


def _truncated(xy: Integers) -> Integers:
    return xy // SUBPIXELS * SUBPIXELS


def _centered(xy: Integers) -> Integers:
    return (xy + _HALF) // SUBPIXELS * SUBPIXELS + _HALF


def _truncated_centers(xy: Integers) -> Integers:
    return xy // SUBPIXELS * SUBPIXELS + _HALF


_HALVES = {words: partial(_shift, by=(_HALF * x, _HALF * y)) for words, x, y in _COMPASS}
_WHOLES = {words: partial(_shift, by=(SUBPIXELS * x, SUBPIXELS * y)) for words, x, y in _COMPASS}
STEPS = {words: partial(_shift, by=(x, y)) for words, x, y in _COMPASS}  # of 1/256 px


@cache  # so that pixels of the same positions are found once
def _one_after_another(before: Snap, snap: Snap) -> Snap:
    return lambda xy: snap(before(xy))


def snapped(drawing: Drawing, snap: Snap) -> Drawing:
    """Return the drawing with image coordinates changed."""
    return replace(drawing, snap=_one_after_another(drawing.snap, snap))


def half_pixel(drawing: Drawing) -> Iterator[Variant]:
    for words, snap in _HALVES.items():
        yield words, partial(snapped, snap=snap)


def whole_pixels(drawing: Drawing) -> Iterator[Variant]:
    for words, snap in _WHOLES.items():
        yield words, partial(snapped, snap=snap)


def rounded_corners(drawing: Drawing) -> Iterator[Variant]:
    yield "to the nearest corner of pixels", partial(snapped, snap=_rounded)
    yield "down, to a corner of pixels", partial(snapped, snap=_truncated)
    yield "to the nearest corner, taken for centers", partial(snapped, snap=_centered)
    yield "down, taken for centers", partial(snapped, snap=_truncated_centers)


def _reaching(drawing: Drawing, reach: Reach) -> Drawing:
    return replace(drawing, reach=reach)


def nothing(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_reaching, reach=Reach(True, ()))


def too_many(drawing: Drawing) -> Iterator[Variant]:
    yield "to the right", partial(_reaching, reach=Reach(True, ((0, 0), (-1, 0))))
    yield "to the left", partial(_reaching, reach=Reach(True, ((0, 0), (1, 0))))
    yield "on both sides", partial(_reaching, reach=Reach(True, ((0, 0), (-1, 0), (1, 0))))
    yield "up", partial(_reaching, reach=Reach(True, ((0, 0), (0, -1))))
    yield "down", partial(_reaching, reach=Reach(True, ((0, 0), (0, 1))))


def too_few(drawing: Drawing) -> Iterator[Variant]:
    yield "at the right", partial(_reaching, reach=Reach(False, ((0, 0), (1, 0))))
    yield "at the left", partial(_reaching, reach=Reach(False, ((0, 0), (-1, 0))))
    yield "at the top", partial(_reaching, reach=Reach(False, ((0, 0), (0, 1))))
    yield "at the bottom", partial(_reaching, reach=Reach(False, ((0, 0), (0, -1))))


# Order


def _farthest(z: Floats) -> Floats:
    return -z


def _as_listed(z: Floats) -> Floats:
    return np.zeros_like(z)


def _as_listed_backward(z: Floats) -> Floats:
    return np.repeat(np.arange(len(z), dtype=np.float64)[:, None], 3, axis=1)


def _of_corner(z: Floats, corner: int) -> Floats:
    return np.repeat(z[:, corner : corner + 1], 3, axis=1)


def _least(z: Floats) -> Floats:
    return np.repeat(z.min(axis=1, keepdims=True), 3, axis=1)


def _largest(z: Floats) -> Floats:
    return np.repeat(z.max(axis=1, keepdims=True), 3, axis=1)


_CORNERS = [partial(_of_corner, corner=k) for k in range(3)]


def _ordered(drawing: Drawing, order: Callable[[Floats], Floats]) -> Drawing:
    return replace(drawing, order=order)


def _painted(drawing: Drawing) -> bool:
    return drawing.settings.visibility == "painter"


def reversed_order(drawing: Drawing) -> Iterator[Variant]:
    if _painted(drawing):
        yield "", partial(_ordered, order=_farthest)


def no_sort(drawing: Drawing) -> Iterator[Variant]:
    if _painted(drawing):
        yield "first to last", partial(_ordered, order=_as_listed)
        yield "last to first", partial(_ordered, order=_as_listed_backward)


def one_corner(drawing: Drawing) -> Iterator[Variant]:
    if _painted(drawing):
        for words, order in zip(("first", "second", "third"), _CORNERS, strict=True):
            yield words, partial(_ordered, order=order)
        yield "nearest", partial(_ordered, order=_least)
        yield "farthest", partial(_ordered, order=_largest)
