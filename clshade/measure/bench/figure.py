"""The figure of `bench`: speedups over each peer, and scaling of time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...images import figures
from .results import Speed
from .scaling import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {"llvmpipe": figures.OURS, "opengl": "#2e8b57", "numpy": figures.OTHER, "scanline": "#7a5195"}


def plot(speed: Speed, path: Path) -> None:
    """Draw and save the figure. Raises OutputError."""
    panels = [_ratios] if any(result.compared for result in speed.results) else []
    panels = panels or ([] if speed.series else [_times])
    count = len(panels) + len(speed.series)
    figure = figures.blank(5.6 * count, 5.0)
    axes = figure.subplots(1, count, squeeze=False)[0]
    for draw, where in zip(panels, axes, strict=False):
        draw(where, speed)
    for series, where in zip(speed.series, axes[len(panels) :], strict=True):
        _growth(where, series)
    figure.suptitle(f"{speed.device}\n{speed.machine}", fontsize=8)
    figures.save(figure, path, colors=64)


def _ratios(axes: Axes, speed: Speed) -> None:
    """Plot ratios on a logarithmic axis, a row per workload; a required bar is a tick across its row."""
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
            if bar is not None:
                axes.plot([bar, bar], [row - 0.35, row + 0.35], color=color, lw=1.5)
    axes.axvline(1.0, color=figures.MUTED, lw=0.8)
    axes.set(xscale="log", xlabel="times as fast (ticks: what is asked for)")
    axes.set_yticks(range(len(results)), [each.workload.name for each in results])
    axes.invert_yaxis()
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(True, axis="x", which="both", alpha=0.2)
    axes.legend(fontsize=8)


def _times(axes: Axes, speed: Speed) -> None:
    """Plot frame times alone, if no peer was drawn."""
    drawn = [(each.workload.name, each.drawn.ms) for each in speed.results if each.drawn]
    axes.barh([name for name, _ in drawn], [ms for _, ms in drawn], color=figures.OURS)
    axes.invert_yaxis()
    axes.set(xlabel="ms a frame")


def _growth(axes: Axes, series: Series) -> None:
    exponents = series.exponents()
    text = ", ".join(f"{what} {value:.2f}" for what, value in exponents.items() if value is not None)
    low, _, high = zip(*(each.frame_ms for each in series.points), strict=True)
    axes.fill_between(series.sizes, low, high, color=figures.OURS, alpha=0.25, lw=0)
    axes.loglog(series.sizes, [each.ms for each in series.points], "o-", color=figures.OURS, ms=4, label="ms a frame")
    axes.axhline(series.fixed.ms, color=figures.MUTED, ls=":", label="fixed cost, ms")
    memory = [each.peak_mib for each in series.points]
    if None not in memory:
        axes.loglog(series.sizes, memory, "s--", color=figures.OTHER, ms=4, label="peak of memory, MiB")
    axes.set(xlabel=series.name)
    axes.set_title(f"exponents: {text}", fontsize=7)
    axes.grid(True, which="both", alpha=0.2)
    axes.legend(fontsize=8)
