"""The figure of `report`: error against time, error against triangle count, and difference images."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import Array, Floats
from ...images import figures
from ...images.tonemap import tonemap
from ...scene.model import default_tonemap
from .labels import label_points
from .study import SHOWN, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PICTURES = 1 + SHOWN  # the reference and the differences from it
LEAST, MOST = 1e-3, 1.0  # differences drawn black and in the brightest color


def plot(study: Study, path: Path) -> None:
    """Draw and save the figure. Raises OutputError."""
    from matplotlib.colors import LogNorm

    figure = figures.blank(11.0, 7.6, dpi=100)
    rows = figure.add_gridspec(2, 1, height_ratios=(2.4, 1.0))
    plots, row = rows[0].subgridspec(1, 2, width_ratios=(1.7, 1.0)), rows[1].subgridspec(1, PICTURES)
    scatter = figure.add_subplot(plots[0])
    _errors_against_time(scatter, study)
    _errors_against_triangles(figure.add_subplot(plots[1]), study)
    pictures = [figure.add_subplot(row[k]) for k in range(PICTURES)]
    for axes in pictures:
        axes.set_axis_off()
    pictures[0].imshow(tonemap(study.reference.rgb, default_tonemap(study.scene)))
    pictures[0].set_title("reference", fontsize=9)
    shown = None
    for axes, (name, picture) in zip(pictures[1:], study.pictures.items(), strict=False):
        shown = axes.imshow(
            difference(picture, study.reference.rgb), cmap="magma", norm=LogNorm(LEAST, MOST, clip=True)
        )
        axes.set_title(f"{name}, off by", fontsize=9)
    if shown is not None:
        figure.colorbar(shown, ax=pictures, shrink=0.8, pad=0.01, aspect=12)
    figure.suptitle(f"Error against run time: {study.title}\n{study.device}\n{study.machine}", fontsize=9)
    figure.canvas.draw()
    figure.set_layout_engine("none")
    names, times = ([getattr(each, field) for each in study.measured] for field in ("name", "cost"))
    errors = _drawn(study)
    spreads = [
        [(each.frame_ms.low, y), (each.frame_ms.high, y)] for each, y in zip(study.measured, errors, strict=True)
    ]
    label_points(scatter, times, errors, names, [_steps(study), *spreads])
    figures.save(figure, path, colors=256)


def difference(picture: Array, reference: Array) -> Floats:
    """Return the largest difference of the channels, (M, N), clamped to at least LEAST."""
    apart = np.abs(np.asarray(picture, np.float64) - reference).max(axis=2)
    shown: Floats = np.maximum(np.nan_to_num(apart, posinf=MOST), LEAST)
    return shown


def _drawn(study: Study) -> list[float]:
    """Return the errors to draw: on the logarithmic axis, 0 is drawn at the error of the reference."""
    return [max(each.error, study.reference.error, 1e-12) for each in study.measured]


def _steps(study: Study) -> list[tuple[float, float]]:
    """Return the corners of the Pareto front's staircase, below which no variant lies."""
    errors = dict(zip(study.measured, _drawn(study), strict=True))
    best = study.front
    corners = [(best[0].cost, errors[best[0]])]
    for each in best[1:]:
        if errors[each] < corners[-1][1]:  # not of a tie
            corners += [(each.cost, corners[-1][1]), (each.cost, errors[each])]
    return corners


def _errors_against_time(axes: Axes, study: Study) -> None:
    from matplotlib.ticker import LogLocator

    errors = dict(zip(study.measured, _drawn(study), strict=True))
    best = study.front
    axes.plot(*zip(*_steps(study), strict=True), color=figures.OURS, lw=1.2, label="Pareto front")
    for each, error in errors.items():
        low, median, high = each.frame_ms
        color = figures.OURS if each in best else figures.OTHER
        axes.errorbar(median, error, xerr=[[median - low], [high - median]], fmt="o", ms=4, color=color, lw=0.8)
    axes.axhline(
        study.reference.error, color=figures.MUTED, lw=0.8, ls=":", label="the reference's own error, estimated"
    )
    axes.set(xscale="log", yscale="log", xlabel="time of a frame, ms", ylabel="RMSE against the reference")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.margins(0.16, 0.12)
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=8, loc="lower left")


def _errors_against_triangles(axes: Axes, study: Study) -> None:
    found = study.tessellation
    for (shader, errors), color in zip(found.errors.items(), (figures.OTHER, figures.OURS), strict=True):
        label = f"{shader}: slope {found.slope(shader):.2f}"
        axes.loglog(found.triangles, errors, "o-", ms=4, color=color, label=label)
    axes.set(xlabel="triangles of a sphere", ylabel=f"RMSE against {found.finest:,} triangles")
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=8)
