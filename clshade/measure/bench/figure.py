"""The figure of `bench`: speedups over each peer, and scaling of time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...images import figures
from .results import Speed
from .scaling import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WAY_COLORS = (figures.OURS, figures.OTHER, "#7a5195")
COLORS = {"llvmpipe": figures.OURS, "opengl": "#2e8b57", "numpy": figures.OTHER, "scanline": "#7a5195"}


def plot(speed: Speed, path: Path, *, targets: bool = False) -> None:
    """Draw and save the figure. targets: mark the ratios asked for. Raises OutputError."""
    panels = [_ratios] if any(result.compared for result in speed.results) else []
    panels = panels or ([] if speed.series else [_times])
    kinds = list(dict.fromkeys(series.kind for series in speed.series))
    count = len(panels) + len(kinds)
    figure = figures.blank(5.6 * count, 5.0)
    axes = figure.subplots(1, count, squeeze=False)[0]
    for draw, where in zip(panels, axes, strict=False):
        draw(where, speed, targets)
    for kind, where in zip(kinds, axes[len(panels) :], strict=True):
        _growth(where, [series for series in speed.series if series.kind == kind])
    figure.suptitle(f"{speed.device}\n{speed.machine}", fontsize=8)
    figures.save(figure, path, colors=64)


def _ratios(axes: Axes, speed: Speed, targets: bool) -> None:
    """Plot ratios on a logarithmic axis, a row per workload; a target is a tick across its row."""
    results = [each for each in speed.results if each.compared]
    labeled: set[str] = set()
    for row, result in enumerate(results):
        for each in result.compared:
            if each.ratio is None:
                continue
            color = COLORS.get(each.peer, figures.MUTED)
            label = None if each.peer in labeled else f"as fast as {each.peer}"
            labeled.add(each.peer)
            axes.plot(each.ratio, row, "o", color=color, ms=6, label=label)
            bar = result.workload.ratios.get(each.peer)
            if targets and bar is not None:
                axes.plot([bar, bar], [row - 0.35, row + 0.35], color=color, lw=1.5)
    axes.axvline(1.0, color=figures.MUTED, lw=0.8)
    axes.set(xscale="log", xlabel="times as fast" + (" (ticks: targets)" if targets else ""))
    axes.set_yticks(range(len(results)), [each.workload.name for each in results])
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(True, axis="x", which="both", alpha=0.2)
    axes.legend(fontsize=8)


def _times(axes: Axes, speed: Speed, targets: bool) -> None:
    """Plot frame times alone, if no peer was drawn."""
    drawn = [(each.workload.name, each.drawn.ms) for each in speed.results if each.drawn]
    axes.barh([name for name, _ in drawn], [ms for _, ms in drawn], color=figures.OURS)
    axes.invert_yaxis()
    axes.set(xlabel="ms a frame")


def _growth(axes: Axes, several: Sequence[Series]) -> None:
    """Plot the times of several ways against what grows, and the memory of the first."""
    for series, color in zip(several, WAY_COLORS, strict=False):
        low, middle, high = zip(*(each.frame_ms for each in series.points), strict=True)
        exponent = series.exponents()["time beyond the fixed cost"]
        fitted = "" if exponent is None else f", as the power {exponent:.2f} beyond the fixed cost"
        axes.fill_between(series.sizes, low, high, color=color, alpha=0.25, lw=0)
        axes.loglog(series.sizes, middle, "o-", color=color, ms=4, label=f"{series.way}: ms a frame{fitted}")
    first = several[0]
    axes.axhline(first.fixed.ms, color=figures.MUTED, ls=":", label=f"{first.way}: fixed cost, ms")
    memory = [each.peak_mib for each in first.points]
    if None not in memory:
        axes.loglog(first.sizes, memory, "s--", color=figures.MUTED, ms=4, label=f"{first.way}: peak of memory, MiB")
    axes.set(xlabel=first.kind)
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=7)
