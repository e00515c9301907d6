"""The parts of two compared images that a figure shows magnified: windows around clusters of large errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from .channels import Group
from .clusters import Cluster, leading

CROPS, MOST_CROPS = 3, 24  # windows per layer, and in the whole figure

Window: TypeAlias = tuple[int, int, int, int]  # column, row, width, height in pixels

_LEAST_WINDOW, _MOST_WINDOW = 24, 128  # pixels, the side of a window


def windows(
    layers: Mapping[str, tuple[Group, Group]], clusters: Mapping[str, Sequence[Cluster]]
) -> dict[str, list[tuple[Cluster, Window]]]:
    """Return the clusters that a figure shows, each with its window, by layer.

    Those are the CROPS leading ones of each layer, without any that an earlier window holds, and at most MOST_CROPS in
    all.
    """
    left = MOST_CROPS
    found: dict[str, list[tuple[Cluster, Window]]] = {}
    for name in layers:
        rows, columns = layers[name][0].planes[0].shape
        chosen: list[tuple[Cluster, Window]] = []
        for cluster in leading(clusters.get(name, ()), min(CROPS, left)):
            window = _window(cluster, columns, rows)
            if not any(_inside(cluster, other) for _, other in chosen):
                chosen.append((cluster, window))
        left -= len(chosen)
        found[name] = chosen
    return found


def _window(cluster: Cluster, columns: int, rows: int) -> Window:
    """Return a square around a cluster with some of what surrounds it, moved and clipped to the image; of a large cluster
    the part around its worst pixel."""
    longer = max(cluster.width, cluster.height)
    side = min(max(longer + longer // 2, _LEAST_WINDOW), _MOST_WINDOW)
    fits = longer <= side
    middle = (cluster.x + cluster.width // 2, cluster.y + cluster.height // 2) if fits else cluster.worst
    width, height = min(side, columns), min(side, rows)
    x, y = (
        min(max(at - length // 2, 0), most - length)
        for at, length, most in zip(middle, (width, height), (columns, rows), strict=True)
    )
    return x, y, width, height


def _inside(cluster: Cluster, window: Window) -> bool:
    x, y, width, height = window
    return (
        x <= cluster.x
        and y <= cluster.y
        and cluster.x + cluster.width <= x + width
        and cluster.y + cluster.height <= y + height
    )


def cut(group: Group, window: Window) -> Group:
    """Return the layer within the window."""
    x, y, width, height = window
    return group._replace(planes=tuple(plane[y : y + height, x : x + width] for plane in group.planes))
