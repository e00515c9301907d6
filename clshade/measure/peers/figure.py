"""The figure of `report --peers`: the error of the color against the time of a frame, all renderers in one plane."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...base.arrays import Floats
from ...images import figures
from ..report.labels import label_points
from . import PEERS
from .drawing import SAMPLES
from .measure import Found, Result
from .tables import results

COLORS = ("#1f5fa8", "#58a5d8", "#17becf", "#c0504d", "#e08e3c", "#2e8b57", "#7a5195", "#8c6d31", "gray")
LEAST = 1e-9  # errors below are drawn here
TITLE = f"filled: 1 sample a pixel, open: {SAMPLES[-1]}; small: a scene, large: geometric mean of those that all drew"


def plot(found: Found, path: Path) -> None:
    """Draw and save the figure. Small points: scenes. Large ones, with names: geometric means of those that all have drawn.
    Raises OutputError."""
    figure = figures.blank(9.0, 7.0)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel="milliseconds a frame", ylabel="RMSE of the linear color")
    axes.grid(True, which="major", alpha=0.2)
    drawn = [each for each in results(found) if each.errors.color is not None]
    means: dict[str, Floats] = {}
    for samples in SAMPLES:
        common = _common([each for each in drawn if each.samples == samples])
        for name, color in zip(PEERS, COLORS, strict=True):
            fill = color if samples == 1 else "white"
            mine = [each for each in drawn if (each.renderer, each.samples) == (name, samples)]
            if mine:
                axes.plot(*_points(mine).T, "o", ms=3, color=color, mfc=fill, mew=0.7, alpha=0.45)
            shared = [each for each in mine if each.scene in common]
            if shared:
                mean = np.exp(np.log(_points(shared)).mean(axis=0))
                axes.plot(*mean, "o", ms=9, color=color, mfc=fill, mew=1.8)
                means[name if samples == 1 else f"{name}, {samples}"] = mean
    axes.set_title(TITLE, fontsize=9)
    if means:
        figure.canvas.draw()
        figure.set_layout_engine("none")
        across, up = np.array(list(means.values())).T
        label_points(axes, across, up, list(means))
    figures.save(figure, path, colors=256)


def _common(drawn: Sequence[Result]) -> set[str]:
    """Return the scenes that all renderers of these have drawn."""
    names = {each.renderer for each in drawn}
    return {each.scene for each in drawn if names == {other.renderer for other in drawn if other.scene == each.scene}}


def _points(drawn: Sequence[Result]) -> Floats:
    """Return milliseconds and errors, (K, 2)."""
    return np.array([(each.ms.median, max(each.errors.color or 0.0, LEAST)) for each in drawn])
