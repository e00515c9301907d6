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
CAUSE_COLORS = (
    *("#4c72b0", "#dd8452", "#55a868", "#c44e52", "#8172b3"),
    *("#937860", "#da8bc3", "#ccb974", "#64b5cd", figures.MUTED),
)
LEAST, MOST = 1e-3, 1.0  # differences drawn black and in the brightest color


def plot(study: Study, path: Path) -> None:
    """Draw and save the figure. Raises OutputError."""
    from matplotlib.colors import LogNorm

    figure = figures.blank(11.0, 9.0, dpi=100)
    rows = figure.add_gridspec(2, 1, height_ratios=(3.2, 1.0))
    plots, row = rows[0].subgridspec(1, 2, width_ratios=(1.7, 1.0)), rows[1].subgridspec(1, PICTURES)
    scatter = figure.add_subplot(plots[0])
    _errors_against_time(scatter, study)
    right = plots[1].subgridspec(3, 1, height_ratios=(0.35, 1.0, 1.3))
    for place, draw in enumerate((_shares, _causes, _errors_against_triangles)):
        draw(figure.add_subplot(right[place]), study)
    pictures = [figure.add_subplot(row[k]) for k in range(PICTURES)]
    for axes in pictures:
        axes.set_axis_off()
    pictures[0].imshow(tonemap(study.reference.rgb, default_tonemap(study.scene)))
    pictures[0].set_title("reference", fontsize=9)
    shown = None
    for axes, (name, picture) in zip(pictures[1:], study.pictures.items(), strict=False):
        shown = axes.imshow(size(picture), cmap="magma", norm=LogNorm(LEAST, MOST, clip=True))
        axes.set_title(name, fontsize=8)
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


def size(difference: Array) -> Floats:
    """Return the largest absolute difference of the channels, (M, N), clamped to at least LEAST."""
    apart = np.abs(np.asarray(difference, np.float64)).max(axis=2)
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
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="time of a frame, ms (bars: half of them)",
        ylabel="RMSE against the reference (lower is more accurate)",
    )
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.margins(0.16, 0.12)
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=8, loc="lower left")


def _shares(axes: Axes, study: Study) -> None:
    """Stack the shares of the causes in the error of the image and of its PNG; negative ones to the left."""
    ends = {(bar, positive): 0.0 for bar in range(2) for positive in (False, True)}
    for part, color in zip(study.decomposition.parts, CAUSE_COLORS, strict=False):
        for bar, share in enumerate((part.png_share, part.share or 0.0)):
            axes.barh(bar, share, left=ends[bar, share > 0.0], color=color, height=0.7)
            ends[bar, share > 0.0] += share
    axes.set_yticks(range(2), ("its PNG", "image"), fontsize=8)
    axes.xaxis.set_major_formatter(lambda share, _: f"{100.0 * share:.0f} %")
    axes.tick_params(labelsize=8)
    axes.set_title("where the error of the image comes from", fontsize=9)


def _causes(axes: Axes, study: Study) -> None:
    """Plot the causes' errors, in the colors of their shares, and the total."""
    found = study.decomposition
    errors = {part.cause: part.rmse for part in found.parts}
    errors["total, as a PNG"] = found.png_total
    some = [error for error in errors.values() if error > 0.0] or [1.0]
    axes.set(xscale="log", xlim=(min(some) / 2.0, max(some) * 2.0))
    axes.barh(range(len(errors)), list(errors.values()), color=[*CAUSE_COLORS[: len(errors) - 1], "k"])
    for place, error in enumerate(errors.values()):
        if error == 0.0:
            axes.text(0.01, place, "0", transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.set_yticks(range(len(errors)), list(errors), fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("RMSE (lower is more accurate)")
    axes.tick_params(axis="x", labelsize=8)
    axes.grid(True, axis="x", alpha=0.2)


def _errors_against_triangles(axes: Axes, study: Study) -> None:
    found = study.tessellation
    for (shader, errors), color in zip(found.errors.items(), (figures.OTHER, figures.OURS), strict=True):
        label = f"{shader}: power {found.slope(shader)}"
        axes.loglog(found.triangles, errors, "o-", ms=4, color=color, label=label)
    axes.set(xlabel="triangles of a sphere", ylabel=f"RMSE against {found.finest:,} triangles")
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=8)
