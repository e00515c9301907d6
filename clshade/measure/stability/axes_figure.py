"""The figure of the axes of stiffness: errors above, times below."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...images import figures
from .axes import PLAIN, USELESS, Axis, Series
from .axes_tables import Found

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = {"standard": figures.OURS, "fast": "#c07a00", "float64": "#2e8b57", PLAIN: figures.OTHER}
MARKS = {"standard": "o", "fast": "^", "float64": "s", PLAIN: "x"}
LEAST, MOST = 1e-18, 3.0  # errors drawn: none at the least, larger ones at the most


def draw(found: Found, device: str) -> Figure:
    """Return the figure."""
    figure = figures.blank(4.2 * len(found), 7.2, dpi=130)
    panels = figure.subplots(2, len(found), squeeze=False, height_ratios=(2.2, 1.0))
    for (axis, series), errors, times in zip(found.items(), *panels, strict=True):
        _errors(errors, axis, series)
        _times(times, axis, series)
    panels[0][0].set_ylabel("RMS of |value - oracle| / light (lower is more accurate)")
    panels[1][0].set_ylabel("time of a frame, ms")
    figure.suptitle(f"Error and time against stiffness\n{device}".replace("$", r"\$"), fontsize=10)
    return figure


def _errors(axes: Axes, axis: Axis, series: list[Series]) -> None:
    from matplotlib.ticker import NullLocator

    for each in series:
        shown = [(point.stiffness, min(max(point.rms, LEAST), MOST)) for point in each.points if point.rms is not None]
        power = each.power()
        label = each.way if power is None else f"{each.way}: power {round(power.exponent, 2) + 0.0:.2f}"
        axes.plot(*zip(*shown, strict=True), marker=MARKS[each.way], color=COLORS[each.way], ms=4, lw=1.2, label=label)
    own = [axis.own(value) for value in axis.stiffness]
    axes.plot(axis.stiffness, own, ":", color="k", lw=1.0, label=f"oracle's own, at most {axis.own_about}")
    axes.axhspan(USELESS, 10.0 * MOST, color=figures.MUTED, alpha=0.15, lw=0)
    axes.text(axis.stiffness[0], 1.3 * USELESS, "shows nothing right", fontsize=7.5, color=figures.MUTED)
    axes.set(xscale="log", yscale="log", ylim=(LEAST, 10.0 * MOST), title=axis.title)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(True, alpha=0.25)
    axes.legend(fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.08), frameon=False)


def _times(axes: Axes, axis: Axis, series: list[Series]) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    for each in series:
        timed = [(point.stiffness, *point.ms) for point in each.points if point.ms]
        values, low, median, high = zip(*timed, strict=True)
        axes.fill_between(values, low, high, color=COLORS[each.way], alpha=0.2, lw=0)
        axes.plot(values, median, marker=MARKS[each.way], color=COLORS[each.way], ms=3, lw=1.0)
    axes.set(xscale="log", yscale="log", xlabel=axis.label)
    axes.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    for place in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        place("{x:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(True, which="both", alpha=0.2)
