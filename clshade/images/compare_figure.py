"""Figure of a comparison: for each layer the image, the reference and the error of each pixel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Array
from . import figures
from .channels import Group
from .layer_plots import panel_size, plain_text, show_pixels
from .thumbnails import thinned, thumbnails

if TYPE_CHECKING:
    from matplotlib.figure import Figure
from .compare import errors_of

MOST = 40  # layers in the figure, which has at most 2^16 pixels a side
SIDE = 512  # most pixels along the longer side of a panel
UNEQUAL_COLOR = (0, 255, 255)

_PANEL, _TITLE, _BAR = 3.6, 0.5, 0.9  # inches


def draw(layers: Mapping[str, tuple[Group, Group]], *, encoded: bool, titles: tuple[str, str]) -> Figure:
    """Draw image and reference in one range of values, and their difference.

    layers: from `compare.chosen_layers`. titles: of image and reference. Of a large image every k-th pixel is shown,
    but the largest error of each k x k.
    """
    width, height = panel_size(next(iter(layers.values()))[0].planes[0].shape, _PANEL)
    figure = figures.blank(3 * width + _BAR, len(layers) * (height + _TITLE), dpi=100)
    rows = figure.subplots(len(layers), 3, squeeze=False)
    for axes, (name, (group, reference)) in zip(rows, layers.items(), strict=True):
        both = _side_by_side(name, group, reference, encoded)
        for panel, pixels, title in zip(axes[:2], both, titles, strict=True):
            show_pixels(panel, pixels, f"{plain_text(name)} of {plain_text(title)}")
        _draw_errors(figure, axes[2], errors_of(group, reference))
    return figure


def _side_by_side(name: str, group: Group, reference: Group, encoded: bool) -> tuple[Array, Array]:
    """Return thumbnails of both, computed together so that a color means the same in both."""
    planes = zip(group.planes, reference.planes, strict=True)
    joined = {
        channel: np.concatenate([thinned(a, SIDE), thinned(b, SIDE)])
        for channel, (a, b) in zip(group.names, planes, strict=True)
    }
    (picture,) = thumbnails(joined, encoded=encoded, side=2 * SIDE).values()
    middle = len(picture.pixels) // 2
    return picture.pixels[:middle], picture.pixels[middle:]


def _draw_errors(figure: Any, axes: Any, errors: Array) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    finite = errors[np.isfinite(errors)]
    most = float(finite.max()) if finite.size else 0.0
    small = _largest(errors)
    pixels = np.rint(255.0 * colormaps["inferno"](np.nan_to_num(small / (most or 1.0), posinf=1.0))[..., :3]).astype(
        np.uint8
    )
    pixels[np.isinf(small)] = UNEQUAL_COLOR
    note = ", cyan: NaN or infinite in one" if np.isinf(small).any() else ""
    show_pixels(axes, pixels, f"difference, up to {most:.4g}{note}")
    figure.colorbar(ScalarMappable(Normalize(0.0, most or 1.0), "inferno"), ax=axes)


def _largest(errors: Array) -> Array:
    """Return the largest error of each block of pixels of which `thinned` shows the first."""
    rows, columns = thinned(errors, SIDE).shape
    down, across = -(-errors.shape[0] // rows), -(-errors.shape[1] // columns)
    padded = np.pad(errors, ((0, rows * down - errors.shape[0]), (0, columns * across - errors.shape[1])))
    largest: Array = padded.reshape(rows, down, columns, across).max(axis=(1, 3))
    return largest
