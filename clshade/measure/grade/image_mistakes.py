"""Mistakes in the finished image: where its pixels are, and how they are written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from itertools import permutations

import numpy as np

from ...base.arrays import Floats, Integers
from ...images.decode import srgb_to_linear
from ...images.tonemap import srgb_curve
from .drawing import Drawing, Place, Variant

Shape = tuple[int, int]
_DISPLAY_GAMMA = 2.2  # of monitors


def _mapped(drawing: Drawing, place: Place) -> Drawing:
    """Return the drawing whose pixels are those at other places of it."""
    return replace(drawing, place=_one_after_another(drawing.place, place))


@cache  # so that pixels of the same places are found once
def _one_after_another(before: Place, place: Place) -> Place:
    return lambda rows, columns, shape: before(*place(rows, columns, shape), shape)


def _up(rows: Integers, columns: Integers, shape: Shape) -> tuple[Integers, Integers]:
    return shape[0] - 1 - rows, columns


def _left(rows: Integers, columns: Integers, shape: Shape) -> tuple[Integers, Integers]:
    return rows, shape[1] - 1 - columns


def _around(rows: Integers, columns: Integers, shape: Shape) -> tuple[Integers, Integers]:
    return shape[0] - 1 - rows, shape[1] - 1 - columns


def _across(rows: Integers, columns: Integers, shape: Shape) -> tuple[Integers, Integers]:
    return columns, rows


def _across_up(rows: Integers, columns: Integers, shape: Shape) -> tuple[Integers, Integers]:
    """The transpose of an image whose row 0 is the bottom."""
    return shape[0] - 1 - columns, shape[1] - 1 - rows


def rows_reversed(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_mapped, place=_up)


def mirrored(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_mapped, place=_left)


def turned(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_mapped, place=_around)


def transposed(drawing: Drawing) -> Iterator[Variant]:
    columns, rows = drawing.scene.camera.resolution
    if rows == columns:
        yield "about the diagonal from the top left", partial(_mapped, place=_across)
        yield "about the diagonal from the bottom left", partial(_mapped, place=_across_up)


def wrong_background(drawing: Drawing) -> Iterator[Variant]:
    yield "as it is", lambda given: replace(given, covers=True)


def _written(drawing: Drawing, change: Callable[[Floats], Floats]) -> Drawing:
    """Return the drawing whose values, as far as they are shown, are changed."""
    before = drawing.shown

    def both(values: Floats) -> Floats:
        return change(before(values))

    return replace(drawing, shown=both)


def _power(values: Floats, exponent: float) -> Floats:
    found: Floats = np.clip(values, 0.0, 1.0) ** exponent
    return found


def _srgb(values: Floats) -> Floats:
    return np.asarray(srgb_curve(np.clip(values, 0.0, 1.0)), np.float64)


def _from_srgb(values: Floats) -> Floats:
    return np.asarray(srgb_to_linear(np.clip(values, 0.0, 1.0)), np.float64)


def gamma(drawing: Drawing) -> Iterator[Variant]:
    yield "sRGB", partial(_written, change=_srgb)
    yield "1/2.2", partial(_written, change=partial(_power, exponent=1.0 / _DISPLAY_GAMMA))
    yield "square root", partial(_written, change=partial(_power, exponent=0.5))


def gamma_twice(drawing: Drawing) -> Iterator[Variant]:
    yield "sRGB", partial(_written, change=lambda values: _srgb(_srgb(values)))
    yield "1/2.2", partial(_written, change=partial(_power, exponent=_DISPLAY_GAMMA**-2))


def decoded(drawing: Drawing) -> Iterator[Variant]:
    yield "sRGB", partial(_written, change=_from_srgb)
    yield "2.2", partial(_written, change=partial(_power, exponent=_DISPLAY_GAMMA))


def _wrapped(values: Floats) -> Floats:
    return np.mod(np.floor(values * 255.0), 256.0) / 255.0


def wrapped(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_written, change=_wrapped)


def _normalized(values: Floats) -> Floats:
    return values / max(float(values.max(initial=0.0)), 1e-9)


def normalized(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_written, change=_normalized)


def _in_order(values: Floats, order: tuple[int, ...]) -> Floats:
    return values[..., order]


def channels(drawing: Drawing) -> Iterator[Variant]:
    for order in list(permutations(range(3)))[::-1][:5]:
        words = "".join("RGB"[k] for k in order)
        yield words, partial(_written, change=partial(_in_order, order=order))


def _means(values: Floats, weights: tuple[float, float, float]) -> Floats:
    return np.repeat((values @ np.array(weights))[..., None], 3, axis=-1)


def gray(drawing: Drawing) -> Iterator[Variant]:
    yield "mean of the channels", partial(_written, change=partial(_means, weights=(1 / 3, 1 / 3, 1 / 3)))
    yield "luma", partial(_written, change=partial(_means, weights=(0.299, 0.587, 0.114)))
    yield "red alone", partial(_written, change=partial(_means, weights=(1.0, 0.0, 0.0)))


def negative(drawing: Drawing) -> Iterator[Variant]:
    yield "", partial(_written, change=lambda values: 1.0 - np.clip(values, 0.0, 1.0))
