"""The figure of `report`: error against time, and error images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import text_tables
from ...base.arrays import Array
from ...images import figures
from ...images.tonemap import tonemap
from ...scene.model import default_tonemap
from .labels import label_points
from .study import SHOWN, Study
from .variants import BASE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, DPI = 9.0, 150  # inches; text of 8 points has 11 pixels where a page shows it 900 pixels wide
TOP, BOTTOM = 4.9, 1.8  # heights of the rows of panels
STYLE: dict[Any, Any] = {
    **{"font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "legend.fontsize": 7.5},
    **{"xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "grid.alpha": 0.2, "axes.linewidth": 0.6},
}
PICTURES = 1 + SHOWN  # the reference and the differences from it
# Variants that differ in their number of samples alone: the first, the prefix of the others, and the color of their line.
FAMILIES = {
    "shaded once": (BASE, "samples-", "#8172b3"),
    "each shaded": (BASE, "shaded-", "#2e8b57"),
    "Gouraud": ("gouraud", "gouraud-", "#c07a00"),
    "mip maps": ("trilinear", "trilinear-", "#c44e52"),
}
DOMINATED = "#777777"
COLORS = "magma"
LEAST_ERROR = 1e-12  # drawn; smaller ones are drawn there
TITLE = 120  # characters of a line
LEAST, MOST = 1e-3, 1.0  # differences drawn black and in the brightest color


def draw(study: Study) -> Figure:
    """Return the figure."""
    from matplotlib import rc_context

    with rc_context(STYLE):
        figure = figures.blank(WIDTH, TOP + BOTTOM + 0.8, dpi=DPI)
        figure.get_layout_engine().set(w_pad=0.06, h_pad=0.05)  # type: ignore[union-attr, call-arg]
        rows = figure.add_gridspec(2, 1, height_ratios=(TOP, BOTTOM))
        scatter = figure.add_subplot(rows[0])
        _errors_against_time(scatter, study)
        row = rows[1].subgridspec(1, PICTURES)
        _pictures(figure, [figure.add_subplot(row[k]) for k in range(PICTURES)], study)
        lines = (f"Error against run time: {study.title}", study.device, study.machine)
        title = "\n".join(text_tables.cut(line, TITLE) for line in lines)
        figure.suptitle(title.replace("$", r"\$"), fontsize=8.5)
        figure.canvas.draw()
        figure.set_layout_engine("none")
        _label(scatter, study)
    return figure


def colored(study: Study) -> dict[str, Array]:
    """Return the reference and the differences from it as uint8 (M, N, 3), by what they show."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    images = {"reference": tonemap(study.reference.rgb, default_tonemap(study.scene))}
    for name, picture in study.pictures.items():
        apart = np.nan_to_num(np.abs(picture).max(axis=2), posinf=MOST).clip(LEAST)
        images[name] = colormaps[COLORS](LogNorm(LEAST, MOST, clip=True)(apart), bytes=True)[..., :3]
    return images


def _pictures(figure: Figure, places: Sequence[Axes], study: Study) -> None:
    """Show the reference and the differences."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    for axes in places:
        axes.set_axis_off()
    for axes, (name, picture) in zip(places, colored(study).items(), strict=False):
        axes.imshow(picture)
        axes.set_title(name.replace(", ", ",\n", 1), fontsize=8)
    bar = ScalarMappable(LogNorm(LEAST, MOST), COLORS)
    figure.colorbar(bar, ax=list(places), shrink=0.9, pad=0.01, aspect=10, label="difference, white is 1")


def _drawn(study: Study) -> list[float]:
    """Return the errors to draw: on the logarithmic axis, 0 is drawn at the error of the reference."""
    return [max(measured.error, study.reference.error, LEAST_ERROR) for measured in study.measured]


def _steps(study: Study) -> list[tuple[float, float]]:
    """Return the corners of the Pareto front's staircase, below which no variant lies."""
    errors = dict(zip(study.measured, _drawn(study), strict=True))
    first, *others = study.front
    corners = [(first.cost, errors[first])]
    for alternative in others:
        corners += [(alternative.cost, corners[-1][1]), (alternative.cost, errors[alternative])]
    return corners


def _curves(study: Study) -> dict[str, list[tuple[float, float]]]:
    """Return times and errors by family, if three or more errors are above the reference's own."""
    curves = {}
    for family, (first, prefix, _) in FAMILIES.items():
        named = [
            measured
            for measured in study.measured
            if measured.variant.name == first or measured.variant.name.startswith(prefix)
        ]
        members = sorted(named, key=lambda measured: measured.settings.samples)
        points = [(member.cost, member.error) for member in members if member.error > study.reference.error]
        if len(points) > 2:
            curves[family] = points
    return curves


def _label(axes: Axes, study: Study) -> None:
    """Name every point, those of the front in its color."""
    points = [(measured.cost, error) for measured, error in zip(study.measured, _drawn(study), strict=True)]
    texts = label_points(axes, points, [measured.name for measured in study.measured])
    for text, measured in zip(texts, study.measured, strict=True):
        text.set_color(figures.OURS if measured in study.front else "#444444")


def _errors_against_time(axes: Axes, study: Study) -> None:
    from matplotlib.ticker import LogLocator

    errors, best = _drawn(study), study.front
    reference_error = max(study.reference.error, LEAST_ERROR)
    axes.set(xscale="log", yscale="log")
    _widen(axes.set_xlim, [ms for measured in study.measured for ms in measured.frame_ms])
    _widen(axes.set_ylim, errors, reference_error)
    axes.plot(*zip(*_steps(study), strict=True), color=figures.OURS, lw=1.6, label="Pareto front")
    for family, points in _curves(study).items():
        axes.plot(*zip(*points, strict=True), "--", color=FAMILIES[family][2], lw=1.0, label=family, zorder=1)
    for measured, error in zip(study.measured, errors, strict=True):
        color = figures.OURS if measured in best else DOMINATED
        axes.plot(measured.frame_ms, [error] * 3, "-o", ms=4, markevery=[1], color=color, lw=0.8)
    axes.axhline(reference_error, color=figures.MUTED, lw=0.8, ls=":", label="the reference's own error")
    axes.set(
        xlabel="time of a frame, ms (bars: the middle half of the frames)",
        ylabel="RMSE against the reference (lower is more accurate)",
    )
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    axes.xaxis.set_minor_formatter("{x:g}")
    axes.margins(0.14, 0.1)
    axes.grid(True, which="both")
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), ncol=2, frameon=False, borderaxespad=0.2)


def _widen(set_limits: Callable[[float, float], object], values: Sequence[float], *others: float) -> None:
    """Set the limits of an axis if the values are all about the same. others: further values to show."""
    if max(values) < 1.1 * min(values):
        extremes = (*values, *others)
        set_limits(min(extremes) / 2.0, max(extremes) * 2.0)
