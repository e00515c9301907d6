"""Figure of a comparison: for each layer the image, the reference and the error of each pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from . import figures
from .compare import Cluster, errors_of, leading_clusters
from .figures import apply_color_map, block_maxima, thin, thumbnails
from .image_file import Group

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_LAYERS = 40  # in the figure, which has at most 2^16 pixels a side
CROPS, MAX_CROPS = 3, 24  # windows per layer, and in the whole figure
SIDE = 512  # pixels, at most, along the longer side of a panel
UNEQUAL_COLOR = (0, 255, 255)

Window: TypeAlias = tuple[int, int, int, int]  # column, row, width, height in pixels

_WINDOW_SIDES = 24, 128  # pixels, the smallest and largest side of a window
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
    which `windows` chooses. Of a large image every k-th pixel is shown, but the largest error of each k x k.
    """
    crops = windows(layers, clusters or {})
    shape = next(iter(layers.values()))[0].planes[0].shape
    width, height = figures.panel_size(shape, _PANEL)
    heights = [size + _TITLE for name in layers for size in (height, *[_CROP_PANEL] * len(crops[name]))]
    figure = figures.blank(3 * width + _BAR, sum(heights), dpi=100)
    rows = iter(figure.subplots(len(heights), 3, squeeze=False, height_ratios=heights))
    for name, pair in layers.items():
        row, title = next(rows), figures.plain_text(name)
        draw_row(figure, row, pair, encoded, [f"{title} of {figures.plain_text(t)}" for t in titles])
        for number, (cluster, (x, y, columns, lines)) in enumerate(crops[name], 1):
            for axes in row:
                _mark(axes, (x, y, columns, lines), shape, str(number))
            window = np.s_[y : y + lines, x : x + columns]
            place = f"{number}: {title} at {cluster.x},{cluster.y}, {cluster.width} x {cluster.height}"
            count = f"{cluster.pixels:,} pixel{'s' * (cluster.pixels != 1)} of large error"
            part = f"{number}: {figures.plain_text(titles[1])}\n{columns} x {lines} pixels from {x},{y}"
            cut, captions = (pair[0].part(window), pair[1].part(window)), [f"{place}\n{count}", part]
            draw_row(figure, next(rows), cut, encoded, captions, prefix=f"{number}: ")
    return figure


def windows(
    layers: Mapping[str, tuple[Group, Group]], clusters: Mapping[str, Sequence[Cluster]]
) -> dict[str, list[tuple[Cluster, Window]]]:
    """Return the clusters of each layer that a figure shows, each with its window.

    Those are the CROPS leading ones of each layer, without any that an earlier window holds, and at most MAX_CROPS in
    all. A window is a square around a cluster with some of its surroundings, moved and clipped to the image; of a large
    cluster the part around its worst pixel.
    """
    left = MAX_CROPS
    chosen: dict[str, list[tuple[Cluster, Window]]] = {}
    for name, (group, _) in layers.items():
        rows, columns = group.planes[0].shape
        chosen[name] = []
        for cluster in leading_clusters(clusters.get(name, ()), min(CROPS, left)):
            if any(
                x <= cluster.x <= x + width - cluster.width and y <= cluster.y <= y + height - cluster.height
                for _, (x, y, width, height) in chosen[name]
            ):
                continue
            longer = max(cluster.width, cluster.height)
            side = min(max(longer + longer // 2, _WINDOW_SIDES[0]), _WINDOW_SIDES[1])
            middle = cluster.x + cluster.width // 2, cluster.y + cluster.height // 2
            column, row = middle if longer <= side else cluster.worst
            width, height = min(side, columns), min(side, rows)
            x, y = min(max(column - width // 2, 0), columns - width), min(max(row - height // 2, 0), rows - height)
            chosen[name].append((cluster, (x, y, width, height)))
        left -= len(chosen[name])
    return chosen


def draw_row(
    figure: Any, row: Any, pair: tuple[Group, Group], encoded: bool, captions: Sequence[str], prefix: str = ""
) -> None:
    """Draw image, reference and difference into three axes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    # Computed together so that a color means the same in both.
    joined = {
        channel: np.concatenate([thin(plane, SIDE) for plane in planes])
        for channel, *planes in zip(pair[0].names, pair[0].planes, pair[1].planes, strict=True)
    }
    (both,) = thumbnails(joined, encoded=encoded, side=2 * SIDE).values()
    for panel, pixels, caption in zip(row[:2], np.split(both.pixels, 2), captions, strict=True):
        figures.show_pixels(panel, pixels, caption)
    errors = errors_of(*pair)
    maximum = float(np.max(errors, initial=0.0, where=np.isfinite(errors)))
    small = block_maxima(errors, SIDE)
    pixels = apply_color_map(np.nan_to_num(small / (maximum or 1.0), posinf=1.0), "inferno")
    pixels[np.isinf(small)] = UNEQUAL_COLOR
    note = ("," + " \n"[bool(prefix)] + "cyan: NaN or infinite in one") if np.isinf(small).any() else ""
    figures.show_pixels(row[2], pixels, f"{prefix}difference, up to {maximum:.4g}{note}")
    figure.colorbar(ScalarMappable(Normalize(0.0, maximum or 1.0), "inferno"), ax=row[2])


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
    # Above it; below where there is no room; inside where there is none either.
    has_room_above, has_room_below = y > _EDGE * shape[0], y + height < (1.0 - _EDGE) * shape[0]
    at, side = top if has_room_above or not has_room_below else top + tall, "bottom" if has_room_above else "top"
    plate: dict[str, Any] = {"facecolor": "white", "edgecolor": "black", "linewidth": 0.6, "pad": 1.2}
    axes.text(left, at, number, fontsize=7, color="black", bbox=plate, ha="left", va=side)
