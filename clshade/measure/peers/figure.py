"""The figure of `report --peers`: the error of the color against the time of a frame, all renderers in one plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...images import figures
from ..report.labels import label_points
from .drawing import SAMPLES
from .measure import Found, Result
from .tables import results

COLORS = ("#1f5fa8", "#58a5d8", "#c0504d", "#e08e3c", "#2e8b57", "#7a5195", "#8c6d31", "gray")
LEAST = 1e-9  # errors below are drawn here


def plot(found: Found, path: Path) -> None:
    """Draw and save the figure. Small points: scenes. Large ones, with names: geometric means of a renderer's scenes.
    Raises OutputError."""
    figure = figures.blank(9.0, 6.0)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel="milliseconds a frame", ylabel="RMSE of the linear color")
    axes.grid(True, which="major", alpha=0.2)
    names = list(dict.fromkeys(each.renderer for each in results(found)))
    means, labels = [], []
    for name, color in zip(names, COLORS, strict=False):
        for samples, fill in zip(SAMPLES, (color, "white"), strict=True):
            mine = [each for each in results(found) if (each.renderer, each.samples) == (name, samples)]
            if not mine:
                continue
            points = np.array([_point(each) for each in mine])
            axes.plot(*points.T, "o", ms=3, color=color, mfc=fill, mew=0.7, alpha=0.45)
            mean = np.exp(np.log(points).mean(axis=0))
            axes.plot(*mean, "o", ms=9, color=color, mfc=fill, mew=1.8)
            means.append(mean)
            labels.append(name if samples == 1 else f"{name}, {samples}")
    axes.set_title("filled: 1 sample a pixel, open: 16; small: a scene, large: the geometric mean of all", fontsize=9)
    if means:
        figure.canvas.draw()
        figure.set_layout_engine("none")
        across, up = np.array(means).T
        label_points(axes, across, up, labels)
    figures.save(figure, path, colors=256)


def _point(each: Result) -> tuple[float, float]:
    return each.ms.median, max(each.errors.color, LEAST)
