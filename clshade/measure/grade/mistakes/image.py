"""Mistakes in the finished image: where its pixels are, and how they are written."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import permutations

import numpy as np

from ....base.arrays import Floats
from ....images.decode import srgb_to_linear
from ....images.tonemap import srgb_curve
from ..drawing import Drawing, Edit, instead, then
from .mistake import Mistake

_DISPLAY_GAMMA = 2.2  # of monitors
_Misplaced = partial(Mistake, early=False, moves=True)
_Miswritten = partial(Mistake, early=False)


def _square(drawing: Drawing) -> bool:
    columns, rows = drawing.scene.camera.resolution
    return rows == columns


def _clipped(change: Callable[[Floats], Floats]) -> Edit:
    """Return an edit that changes the values after they are clipped to [0, 1]."""
    return then(shown=lambda values: np.asarray(change(np.clip(values, 0.0, 1.0)), np.float64))


def _in_order(order: tuple[int, ...]) -> Edit:
    return then(shown=lambda values: values[..., order])


def _weighted(*weights: float) -> Edit:
    """Return an edit that shows a mean of the channels."""
    return then(shown=lambda values: np.repeat((values @ np.array(weights))[..., None], 3, axis=-1))


PLACES = (
    _Misplaced(
        "upside down",
        "Row 0 of the course's functions is the bottom: flip with image[::-1] once, when writing a PNG.",
        {"": then(place=lambda rows, columns, shape: (shape[0] - 1 - rows, columns))},
    ),
    _Misplaced(
        "mirrored",
        "Check the sign of the camera's x axis, z cross y.",
        {"": then(place=lambda rows, columns, shape: (rows, shape[1] - 1 - columns))},
    ),
    _Misplaced(
        "turned by 180 degrees",
        "Rows and columns are both reversed: the image point is u to the right, v up.",
        {"": then(place=lambda rows, columns, shape: (shape[0] - 1 - rows, shape[1] - 1 - columns))},
    ),
    _Misplaced(
        "axes swapped",
        "Rows and columns are exchanged: index image[row, column], which is [y, x].",
        {
            "about the diagonal from the top left": then(place=lambda rows, columns, shape: (columns, rows)),
            "about the diagonal from the bottom left": then(
                place=lambda rows, columns, shape: (shape[0] - 1 - columns, shape[1] - 1 - rows)
            ),
        },
        _square,
    ),
)
VALUES = (
    _Miswritten(
        "wrong background", "The background has another color than bg_color.", {"as it is": instead(covers=True)}
    ),
    _Miswritten(
        "gamma",
        "The image is gamma-encoded: the course writes linear values, round(255*x).",
        {
            "sRGB": _clipped(srgb_curve),
            "1/2.2": _clipped(lambda values: values ** (1.0 / _DISPLAY_GAMMA)),
            "square root": _clipped(lambda values: values**0.5),
        },
    ),
    _Miswritten(
        "gamma twice",
        "The image is gamma-encoded twice: the course writes linear values, round(255*x).",
        {
            "sRGB": _clipped(lambda values: srgb_curve(np.clip(srgb_curve(values), 0.0, 1.0))),
            "1/2.2": _clipped(lambda values: values**_DISPLAY_GAMMA**-2),
        },
    ),
    _Miswritten(
        "gamma decoded",
        "The image is too dark: it was decoded from gamma.",
        {"sRGB": _clipped(srgb_to_linear), "2.2": _clipped(lambda values: values**_DISPLAY_GAMMA)},
    ),
    _Miswritten(
        "8-bit wrap",
        "Values above 1 wrap around: clip to [0, 1] before the conversion to 8 bits.",
        {"": then(shown=lambda values: np.mod(np.floor(values * 255.0), 256.0) / 255.0)},
    ),
    _Miswritten(
        "divided by its maximum",
        "Clip the image to [0, 1] instead.",
        {"": then(shown=lambda values: values / max(float(values.max(initial=0.0)), 1e-9))},
    ),
    _Miswritten(
        "channels in another order",
        "The channels are red, green, blue: OpenCV's are BGR.",
        {"".join("RGB"[k] for k in order): _in_order(order) for order in list(permutations(range(3)))[:0:-1]},
    ),
    _Miswritten(
        "gray",
        "The image has no color: a mean or one channel is shown.",
        {
            "mean of the channels": _weighted(1 / 3, 1 / 3, 1 / 3),
            "luma": _weighted(0.299, 0.587, 0.114),
            "red alone": _weighted(1.0, 0.0, 0.0),
        },
    ),
    _Miswritten("negative", "Dark and bright are exchanged: 1 - x.", {"": _clipped(lambda values: 1.0 - values)}),
)
