"""Mistakes in the finished image: where its pixels are, and how they are written."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np

from ...base.arrays import Floats
from ...images.decode import srgb_to_linear
from ...images.tonemap import srgb_curve
from .drawing import Drawing, Edit, instead, only, then, variants

_DISPLAY_GAMMA = 2.2  # of monitors


def _square(drawing: Drawing) -> bool:
    columns, rows = drawing.scene.camera.resolution
    return rows == columns


rows_reversed = only(then(place=lambda rows, columns, shape: (shape[0] - 1 - rows, columns)))
mirrored = only(then(place=lambda rows, columns, shape: (rows, shape[1] - 1 - columns)))
turned = only(then(place=lambda rows, columns, shape: (shape[0] - 1 - rows, shape[1] - 1 - columns)))
transposed = variants(
    {
        "about the diagonal from the top left": then(place=lambda rows, columns, shape: (columns, rows)),
        "about the diagonal from the bottom left": then(
            place=lambda rows, columns, shape: (shape[0] - 1 - columns, shape[1] - 1 - rows)
        ),
    },
    _square,
)
wrong_background = variants({"as it is": instead(covers=True)})


def _clipped(change: Callable[[Floats], Floats]) -> Edit:
    """Return an edit that changes the values after they are clipped to [0, 1]."""
    return then(shown=lambda values: np.asarray(change(np.clip(values, 0.0, 1.0)), np.float64))


def _in_order(order: tuple[int, ...]) -> Edit:
    return then(shown=lambda values: values[..., order])


def _weighted(*weights: float) -> Edit:
    """Return an edit that shows a mean of the channels."""
    return then(shown=lambda values: np.repeat((values @ np.array(weights))[..., None], 3, axis=-1))


gamma = variants(
    {
        "sRGB": _clipped(srgb_curve),
        "1/2.2": _clipped(lambda values: values ** (1.0 / _DISPLAY_GAMMA)),
        "square root": _clipped(lambda values: values**0.5),
    }
)
gamma_twice = variants(
    {
        "sRGB": _clipped(lambda values: srgb_curve(np.clip(srgb_curve(values), 0.0, 1.0))),
        "1/2.2": _clipped(lambda values: values**_DISPLAY_GAMMA**-2),
    }
)
decoded = variants(
    {
        "sRGB": _clipped(srgb_to_linear),
        "2.2": _clipped(lambda values: values**_DISPLAY_GAMMA),
    }
)
wrapped = only(then(shown=lambda values: np.mod(np.floor(values * 255.0), 256.0) / 255.0))
normalized = only(then(shown=lambda values: values / max(float(values.max(initial=0.0)), 1e-9)))
channels = variants(
    {"".join("RGB"[k] for k in order): _in_order(order) for order in list(permutations(range(3)))[:0:-1]}
)
gray = variants(
    {
        "mean of the channels": _weighted(1 / 3, 1 / 3, 1 / 3),
        "luma": _weighted(0.299, 0.587, 0.114),
        "red alone": _weighted(1.0, 0.0, 0.0),
    }
)
negative = only(_clipped(lambda values: 1.0 - values))
