"""Figure of a comparison: for each layer the image, the reference and the error of each pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import Array
from . import figures
from .channels import Group
from .clusters import Cluster
from .compare import errors_of
from .compare_windows import Window, cut, windows
from .layer_plots import panel_size, plain_text, show_pixels
from .thumbnails import largest, thinned, thumbnails

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 40  # layers in the figure, which has at most 2^16 pixels a side
SIDE = 512  # most pixels along the longer side of a panel
UNEQUAL_COLOR = (0, 255, 255)

_EDGE = 0.08  # of an image's height: room for the number of a window
_PANEL, _TITLE, _BAR, _CROP_PANEL = 3.6, 0.5, 0.9, 3.0  # inches


def draw(
    layers: Mapping[str, tuple[Group, Group]],
    *,
    encoded: bool,
    titles: tuple[str, str],
    clusters: Mapping[str, Sequence[Cluster]] | None = None,
) -> Figure:
    """Draw image and reference in one range of values, and their difference; below each layer the same magnified where
    they differ most.

    layers: from `compare.chosen_layers`. titles: of image and reference. clusters: of each layer, largest first, of
    which `compare_windows.windows` chooses. Of a large image every k-th pixel is shown, but the largest error of each
    k x k.
    """
    crops = windows(layers, clusters or {})
    shape = next(iter(layers.values()))[0].planes[0].shape
    width, height = panel_size(shape, _PANEL)
    heights = [
        each for name in layers for each in (height + _TITLE, *[_CROP_PANEL + _TITLE] * len(crops.get(name, ())))
    ]
    figure = figures.blank(3 * width + _BAR, sum(heights), dpi=100)
    rows = iter(figure.subplots(len(heights), 3, squeeze=False, height_ratios=heights))
    for name, (group, reference) in layers.items():
        shown = crops.get(name, ())
        whole = next(rows)
        draw_row(
            figure, whole, name, (group, reference), encoded, [f"{plain_text(name)} of {plain_text(t)}" for t in titles]
        )
        for number, (cluster, window) in enumerate(shown, 1):
            for axes in whole:
                _mark(axes, window, shape, str(number))
            pair = (cut(group, window), cut(reference, window))
            place = f"{number}: {plain_text(name)} at {cluster.x},{cluster.y}, {cluster.width} x {cluster.height}"
            count = f"{cluster.pixels:,} pixel{'s' * (cluster.pixels != 1)} of large error"
            captions = [
                f"{place}\n{count}",
                f"{number}: {plain_text(titles[1])}\n{window[2]} x {window[3]} pixels from {window[0]},{window[1]}",
            ]
            draw_row(figure, next(rows), name, pair, encoded, captions, prefix=f"{number}: ")
    return figure


def draw_row(
    figure: Any,
    row: Any,
    name: str,
    pair: tuple[Group, Group],
    encoded: bool,
    captions: Sequence[str],
    prefix: str = "",
) -> None:
    """Draw image, reference and difference into three axes."""
    for panel, pixels, caption in zip(row[:2], _side_by_side(name, *pair, encoded), captions, strict=True):
        show_pixels(panel, pixels, caption)
    _draw_errors(figure, row[2], errors_of(*pair), prefix)


def _mark(axes: Any, window: Window, shape: tuple[int, ...], number: str) -> None:
    """Draw the window's frame and number into the axes of a whole image, which may show every k-th pixel only."""
    from matplotlib.patches import Rectangle

    rows, columns = axes.images[0].get_array().shape[:2]
    across, down = columns / shape[1], rows / shape[0]
    x, y, width, height = window
    left, top, tall = x * across - 0.5, y * down - 0.5, height * down
    for color, line in (("black", 2.2), ("white", 1.0)):
        style: dict[str, Any] = {"fill": False, "edgecolor": color, "linewidth": line, "clip_on": False}
        axes.add_patch(Rectangle((left, top), width * across, tall, **style))
    if y > _EDGE * shape[0]:
        at, side = top, "bottom"
    else:  # no room above it: below, or inside where there is none either
        at, side = (top + tall, "top") if y + height < (1.0 - _EDGE) * shape[0] else (top, "top")
    plate: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "linewidth": 0.6, "pad": 1.2}
    axes.text(left, at, number, fontsize=7, color="black", bbox=plate, ha="left", va=side)


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


def _draw_errors(figure: Any, axes: Any, errors: Array, prefix: str = "") -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    finite = errors[np.isfinite(errors)]
    most = float(finite.max()) if finite.size else 0.0
    small = largest(errors, SIDE)
    pixels = np.rint(255.0 * colormaps["inferno"](np.nan_to_num(small / (most or 1.0), posinf=1.0))[..., :3]).astype(
        np.uint8
    )
    pixels[np.isinf(small)] = UNEQUAL_COLOR
    note = ("," + " \n"[bool(prefix)] + "cyan: NaN or infinite in one") if np.isinf(small).any() else ""
    show_pixels(axes, pixels, f"{prefix}difference, up to {most:.4g}{note}")
    figure.colorbar(ScalarMappable(Normalize(0.0, most or 1.0), "inferno"), ax=axes)
