"""The figure of `report`: error against time, the causes of the error, work and precision by family, and error images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import text_tables
from ...base.arrays import Array, Floats
from ...images import figures
from ...images.tonemap import tonemap
from ...scene.model import default_tonemap
from .decomposition import Decomposition
from .families import FILTER, GOURAUD, PRECISION, SAMPLES, SHADED, Family, alone
from .labels import label_points
from .measure import Measured
from .study import SHOWN, Details, Study
from .tessellation import Tessellation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec
    from matplotlib.text import Text

Lines = Sequence[Sequence[tuple[float, float]]]
WIDTH, DPI = 9.0, 150  # inches; text of 8 points has 11 pixels where a page shows it 900 pixels wide
TOP, MIDDLE, BOTTOM = 4.9, 2.5, 1.8  # heights of the rows of panels; details are beside the first and in the second
STYLE: dict[Any, Any] = {
    **{"font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "legend.fontsize": 7.5},
    **{"xtick.labelsize": 7.5, "ytick.labelsize": 7.5, "grid.alpha": 0.2, "axes.linewidth": 0.6},
}
PICTURES = 1 + SHOWN  # the reference and the differences from it
CAUSE_COLORS = (
    *("#4c72b0", "#dd8452", "#55a868", "#c44e52", "#8172b3"),
    *("#937860", "#da8bc3", "#ccb974", "#64b5cd", figures.MUTED),
)
FAMILY_COLORS = {SAMPLES: "#8172b3", SHADED: "#2e8b57", GOURAUD: "#c07a00", FILTER: "#c44e52"}
DOMINATED = "#777777"
COLORS = "magma"
LEAST_ERROR = 1e-12  # drawn; smaller ones are drawn there
TITLE = 120  # characters of a line
LEAST, MOST = 1e-3, 1.0  # differences drawn black and in the brightest color
MARGIN = 1.12  # times the size of what differs
LABELED = 0.2  # shares above this have room for a number
POWERS = (-2.1, 2.1)  # the range of powers shown, at least


def draw(study: Study) -> Figure:
    """Return the figure."""
    from matplotlib import rc_context

    with rc_context(STYLE):
        heights = (TOP, MIDDLE, BOTTOM) if study.details else (TOP, BOTTOM)
        figure = figures.blank(WIDTH, sum(heights) + 0.8, dpi=DPI)
        figure.get_layout_engine().set(w_pad=0.06, h_pad=0.05)  # type: ignore[union-attr, call-arg]
        rows = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        top = rows[0].subgridspec(1, 2 if study.details else 1, width_ratios=(1.75, 1.0) if study.details else None)
        scatter = figure.add_subplot(top[0])
        _errors_against_time(scatter, study)
        precision = _details(figure, study, study.details, top[1], rows[1]) if study.details else None
        row = rows[len(heights) - 1].subgridspec(1, PICTURES)
        _pictures(figure, [figure.add_subplot(row[k]) for k in range(PICTURES)], study)
        lines = (f"Error against run time: {study.title}", study.device, study.machine)
        title = "\n".join(text_tables.cut(line, TITLE) for line in lines)
        figure.suptitle(title.replace("$", r"\$"), fontsize=8.5)
        figure.canvas.draw()
        figure.set_layout_engine("none")
        _label(scatter, study)
        if precision is not None:
            variants = _precise(study)
            _named(precision, variants, [each.arithmetic.rms for each in variants])
    return figure


def _details(figure: Figure, study: Study, details: Details, right: SubplotSpec, middle: SubplotSpec) -> Axes:
    """Draw the panels of the details to the right of the first panel and in the middle row; return that of precisions."""
    places = right.subgridspec(2, 1, height_ratios=(0.3, 1.0))
    _shares(figure.add_subplot(places[0]), details.decomposition)
    _causes(figure.add_subplot(places[1]), details.decomposition)
    row = middle.subgridspec(1, 3)
    precision, tessellation, powers = (figure.add_subplot(row[place]) for place in range(3))
    _precision(precision, study)
    _errors_against_triangles(tessellation, details.tessellation)
    _powers(powers, study)
    return precision


def size(difference: Array) -> Floats:
    """Return the largest absolute difference of the channels, (M, N), clamped to at least LEAST."""
    apart = np.abs(np.asarray(difference, np.float64)).max(axis=2)
    shown: Floats = np.maximum(np.nan_to_num(apart, posinf=MOST), LEAST)
    return shown


def colored(study: Study) -> dict[str, Array]:
    """Return the reference and the differences from it as uint8 (M, N, 3), by what they show."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    found = {"reference": tonemap(study.reference.rgb, default_tonemap(study.scene))}
    for name, picture in study.pictures.items():
        found[name] = colormaps[COLORS](LogNorm(LEAST, MOST, clip=True)(size(picture)), bytes=True)[..., :3]
    return found


def _window(study: Study) -> tuple[slice, slice]:
    """Return the rows and columns where images differ, with a margin, in the image's proportions; all if none differ."""
    shape = study.reference.rgb.shape[:2]
    off = (
        np.any([size(each) > LEAST for each in study.pictures.values()], axis=0) if study.pictures else np.zeros(shape)
    )
    at = np.nonzero(off)
    if not len(at[0]):
        return slice(None), slice(None)
    part = max((float(np.ptp(each)) + 1.0) / side for each, side in zip(at, shape, strict=True))
    window = []
    for each, side in zip(at, shape, strict=True):
        length = min(side, round(MARGIN * part * side))
        first = min(max((int(each.min()) + int(each.max()) - length) // 2, 0), side - length)
        window.append(slice(first, first + length))
    return window[0], window[1]


def _pictures(figure: Figure, places: Sequence[Axes], study: Study) -> None:
    """Show the reference and the differences."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    for axes in places:
        axes.set_axis_off()
    rows, columns = _window(study)
    for axes, (name, picture) in zip(places, colored(study).items(), strict=False):
        axes.imshow(picture[rows, columns])
        axes.set_title(name.replace(", ", ",\n", 1), fontsize=8)
    bar = ScalarMappable(LogNorm(LEAST, MOST), COLORS)
    figure.colorbar(bar, ax=list(places), shrink=0.9, pad=0.01, aspect=10, label="difference, white is 1")


# Error against time


def _drawn(study: Study) -> list[float]:
    """Return the errors to draw: on the logarithmic axis, 0 is drawn at the error of the reference."""
    return [max(each.error, study.reference.error, LEAST_ERROR) for each in study.measured]


def _steps(study: Study) -> list[tuple[float, float]]:
    """Return the corners of the Pareto front's staircase, below which no variant lies."""
    errors = dict(zip(study.measured, _drawn(study), strict=True))
    best = study.front
    corners = [(best[0].cost, errors[best[0]])]
    for each in best[1:]:
        if errors[each] < corners[-1][1]:  # not of a tie
            corners += [(each.cost, corners[-1][1]), (each.cost, errors[each])]
    return corners


def _label(axes: Axes, study: Study) -> None:
    """Name every point, those of the front in its color."""
    errors, best = _drawn(study), study.front
    lines = [_steps(study), *([(time, error) for time, error in each] for each in _curves(study).values())]
    texts = _named(axes, study.measured, errors, lines)
    for text, each in zip(texts, study.measured, strict=True):
        text.set_color(figures.OURS if each in best else "#444444")


def _named(axes: Axes, variants: Sequence[Measured], errors: Sequence[float], lines: Lines = ()) -> list[Text]:
    """Name the points of these variants; labels avoid the bars of their times, and lines."""
    bars = [[(each.frame_ms.low, y), (each.frame_ms.high, y)] for each, y in zip(variants, errors, strict=True)]
    names = [each.name for each in variants]
    return label_points(axes, [each.cost for each in variants], errors, names, [*lines, *bars])


def _curves(study: Study) -> dict[Family, list[tuple[float, float]]]:
    """Return times and errors of the families whose errors are against the reference."""
    found = [each for each in study.families if each.name in FAMILY_COLORS]
    return {each: [(member.ms.median, member.error) for member in each.fit] for each in found}


def _errors_against_time(axes: Axes, study: Study) -> None:
    from matplotlib.ticker import LogLocator

    errors = dict(zip(study.measured, _drawn(study), strict=True))
    best = study.front
    known = max(study.reference.error, LEAST_ERROR)
    _limit(axes, study.measured, [*errors.values()], known)
    axes.plot(*zip(*_steps(study), strict=True), color=figures.OURS, lw=1.6, label="Pareto front")
    for family, points in _curves(study).items():
        power = family.by_time()
        label = f"{family.title}: time to the power {power.exponent:.2f}" if power.resolved else family.title
        axes.plot(*zip(*points, strict=True), "--", color=FAMILY_COLORS[family.name], lw=1.0, label=label, zorder=1)
    for each, error in errors.items():
        low, median, high = each.frame_ms
        color = figures.OURS if each in best else DOMINATED
        axes.errorbar(median, error, xerr=[[median - low], [high - median]], fmt="o", ms=4, color=color, lw=0.8)
    axes.axhline(known, color=figures.MUTED, lw=0.8, ls=":", label="the reference's own error")
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


def _limit(axes: Axes, variants: Sequence[Measured], errors: Sequence[float], *others: float) -> None:
    """Make axes, without anything yet, logarithmic, and wide enough if the values are all about the same.

    others: further errors to show.
    """
    axes.set(xscale="log", yscale="log")
    times = [ms for each in variants for ms in each.quartiles]
    for values, more, set_limits in ((times, (), axes.set_xlim), (errors, others, axes.set_ylim)):
        if max(values) < 1.1 * min(values):
            shown = (*values, *more)
            set_limits(min(shown) / 2.0, max(shown) * 2.0)


# The causes of the error


def _shares(axes: Axes, found: Decomposition) -> None:
    """Stack the shares of the causes in the error of the image and of its PNG; negative ones to the left."""
    ends = {(bar, positive): 0.0 for bar in range(2) for positive in (False, True)}
    for part, color in zip(found.parts, CAUSE_COLORS, strict=False):
        for bar, share in enumerate((part.png_share, part.share or 0.0)):
            start = ends[bar, share > 0.0]
            axes.barh(bar, share, left=start, color=color, height=0.7)
            if abs(share) > LABELED:
                axes.text(start + share / 2.0, bar, f"{100.0 * share:.0f} %", ha="center", va="center", color="white")
            ends[bar, share > 0.0] += share
    axes.set_yticks(range(2), ("its PNG", "image"))
    axes.xaxis.set_major_formatter(lambda share, _: f"{100.0 * share:.0f} %")
    axes.set_title("where the error comes from")


def _causes(axes: Axes, found: Decomposition) -> None:
    """Plot the causes' errors, in the colors of their shares, and the totals."""
    errors = {part.cause: part.rmse for part in found.parts}
    errors |= {"total": found.total, "total, as a PNG": found.png_total}
    colors = [*CAUSE_COLORS[: len(found.parts)], "#555555", "k"]
    some = [error for error in errors.values() if error > 0.0] or [1.0]
    axes.set(xscale="log", xlim=(min(some) / 2.0, max(some) * 2.0))
    axes.barh(range(len(errors)), list(errors.values()), color=colors)
    for place, error in enumerate(errors.values()):
        text = f"{error:.2g}"
        axes.text(1.02, place, text, transform=axes.get_yaxis_transform(), va="center", fontsize=7.5)
    axes.set_yticks(range(len(errors)), list(errors))
    axes.invert_yaxis()
    axes.set_xlabel("RMSE (lower is more accurate)")
    axes.grid(True, axis="x")


# Work and precision


def _precision(axes: Axes, study: Study) -> None:
    """Plot the error of the arithmetic against time, of the variants that differ in precision alone."""
    axes.set_title("precision: error of the arithmetic")
    variants = _precise(study)
    if not variants:
        _nothing(axes)
        return
    _limit(axes, variants, [each.arithmetic.rms for each in variants])
    axes.set(xlabel="time of a frame, ms", ylabel="RMS of |value - oracle| / light")
    for each in variants:
        low, median, high = each.frame_ms
        error = each.arithmetic.rms
        axes.errorbar(median, error, xerr=[[median - low], [high - median]], fmt="o", ms=4, color=figures.OURS, lw=0.8)
    axes.margins(0.3, 0.2)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "25" else "")
    axes.grid(True)


def _precise(study: Study) -> list[Measured]:
    """Return the variants that differ in precision alone."""
    return [each for each in study.measured if alone(each.variant, PRECISION) and each.arithmetic.rms > 0.0]


def _nothing(axes: Axes) -> None:
    axes.set_axis_off()
    axes.text(0.5, 0.5, "not measured", ha="center", va="center", transform=axes.transAxes, color=figures.MUTED)


def _errors_against_triangles(axes: Axes, found: Tessellation) -> None:
    for (shader, errors), color in zip(found.errors.items(), (figures.OTHER, figures.OURS), strict=True):
        axes.loglog(found.triangles, errors, "o-", ms=3, lw=1.0, color=color, label=shader)
    axes.set(xlabel="triangles of a sphere", ylabel=f"RMSE against {found.finest:,} triangles")
    axes.set_title("tessellation")
    axes.grid(True)
    axes.legend()


def _powers(axes: Axes, study: Study) -> None:
    """Plot the fitted powers with their intervals, and those of theory."""
    axes.set_title("powers of the error (|: theory)")
    found = study.families
    if not found:
        _nothing(axes)
        return
    for place, each in enumerate(found):
        exponent, low, high = each.by_size()
        axes.plot([low, high], [place, place], color=figures.OURS, lw=1.5)
        axes.plot(exponent, place, "o", color=figures.OURS, ms=4)
        axes.plot([each.law.exponent] * 2, [place - 0.32, place + 0.32], color="k", lw=1.5)
    shown = [*POWERS, *(each.by_size().exponent for each in found)]
    axes.set(xlim=(min(shown), max(shown)), ylim=(len(found) - 0.4, -0.6), xlabel="power of the size that varies, 95 %")
    axes.set_yticks(range(len(found)), [each.title.replace(", ", ",\n") for each in found])
    axes.grid(True, axis="x")
