"""Figures of one scene's stability: kappa alone; and image, kappa, errors and the worst pixels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import shown
from ...images import figures
from ...images.tonemap import tonemap
from ...scene.model import default_tonemap
from ..report.labels import label_points
from ..rounding.spread import MOST_DIGITS
from .causes import CAUSES, bits_lost
from .scene_study import RoundingStudy, SceneStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDE = 900  # pixels of a panel's longer side: larger images are reduced
SAMPLED_SIDE = 200  # of an image that was sampled, so that each pixel holds some of the sample
LEAST_SHARE = 1e-5  # of the error allowed, drawn in the darkest color
BACKGROUND, OVER = "#d9d9d9", "#ff2020"
STRIP = 3.0  # aspect ratio beyond which an image is stretched to be visible
MARGIN = 0.06  # around what is drawn, of its longer side


def _block(study: SceneStudy) -> int:
    """Return the side of the blocks of pixels that become a pixel of a panel."""
    side = SIDE if study.check.complete else SAMPLED_SIDE
    return -(-int(max(study.kappa.shape)) // side)


def reduced(values: Array, block: int) -> Floats:
    """Return the largest value of each block of block x block pixels of an image (M, N); NaN where it holds nothing
    else."""
    rows, columns = (-(-size // block) for size in values.shape)
    padded = np.full((rows * block, columns * block), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    largest: Floats = np.fmax.reduce(np.fmax.reduce(padded.reshape(rows, block, columns, block), axis=3), axis=1)
    return largest


def _kappa(axes: Axes, study: SceneStudy) -> Any:
    """Draw kappa; return the image for the color bar."""
    from matplotlib.colors import LogNorm

    values = reduced(study.kappa, _block(study))
    finite = values[np.isfinite(values)]
    norm = LogNorm(1.0, max(2.0, float(finite.max(initial=1.0))))
    return _map(axes, study, np.where(values == 0.0, np.nan, values), "viridis", norm)


def _share(axes: Axes, study: SceneStudy) -> Any:
    """Draw the error in parts of the bound; return the image for the color bar."""
    from matplotlib.colors import LogNorm

    # Without an error a pixel is drawn as one with the least.
    kappa, share = (reduced(each, _block(study)) for each in (study.kappa, study.share))
    values = np.where(kappa == 0.0, np.nan, np.maximum(share, LEAST_SHARE))
    return _map(axes, study, values, "magma", LogNorm(LEAST_SHARE, 1.0))


def _map(axes: Axes, study: SceneStudy, values: Floats, colors: str, norm: Any) -> Any:
    from matplotlib import colormaps

    axes.set_facecolor(BACKGROUND)
    palette = colormaps[colors].with_extremes(over=OVER, bad=(0.0, 0.0, 0.0, 0.0))
    bottom, right = (size * _block(study) - 0.5 for size in values.shape)
    place = (-0.5, right, bottom, -0.5)
    return axes.imshow(values, cmap=palette, norm=norm, extent=place, interpolation="nearest")


def _zoom(axes: Axes, study: SceneStudy) -> None:
    """Show the part of the image that holds something, all of it if nothing does."""
    drawn = np.nonzero(study.kappa)
    ends = []
    margin = MARGIN * max((float(np.ptp(at)) + 1.0 for at in drawn if len(at)), default=0.0)
    for at, size in zip(drawn, study.kappa.shape, strict=True):
        first, last = (int(at.min()), int(at.max())) if len(at) else (0, size - 1)
        ends.append((max(first - margin, 0.0) - 0.5, min(last + margin, size - 1.0) + 0.5))
    (top, bottom), (left, right) = ends
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="column", ylabel="row")
    aspect = (right - left) / (bottom - top)
    axes.set_aspect("equal" if 1.0 / STRIP <= aspect <= STRIP else "auto")


def _kappa_bar(image: Any, axes: Axes) -> None:
    """Draw the color bar of kappa, with ticks within a decade where it spans few."""
    most = image.norm.vmax
    ticks = [m * 10.0**k for k in range(3) for m in (1.0, 1.5, 2.0, 3.0, 5.0)] if most < 300.0 else None
    bar = _bar(image, axes, "condition number kappa", ticks=ticks and [t for t in ticks if t <= most])
    bar.minorticks_off()
    if ticks:
        bar.ax.yaxis.set_major_formatter("{x:g}")


def _bar(image: Any, axes: Axes, label: str, **options: Any) -> Any:
    figure: Any = axes.figure
    return figure.colorbar(image, ax=axes, label=label, shrink=0.9, **options)


def _titled(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.tick_params(labelsize=7)


def _name(study: SceneStudy) -> str:
    columns, rows = study.frame.scene.camera.resolution
    name = shown(study.frame.scene.name or "unnamed")
    name = name if len(name) <= 48 else name[:45] + "..."
    return f"{name}, {columns}x{rows}, {study.frame.settings.precision}".replace("$", r"\$")


def plot_kappa(study: SceneStudy, path: Path) -> None:
    """Draw kappa alone. Raises OutputError."""
    figure = figures.blank(8.0, 6.2)
    axes = figure.subplots()
    _kappa_bar(_kappa(axes, study), axes)
    _titled(axes, f"How far the geometry amplifies rounding: {_name(study)}")
    axes.set(xlabel="column", ylabel="row")
    figures.save(figure, path)


def plot_digits(study: SceneStudy, path: Path, *, rounding: RoundingStudy) -> None:
    """Draw the digits that random rounding left, those that the bound promises, and how they compare. Raises OutputError."""
    from matplotlib.colors import Normalize

    figure = figures.blank(13.0, 4.6)
    found, promised, counts = figure.subplots(1, 3)
    shown_digits = [each[study.kappa != 0.0] for each in (rounding.digits, rounding.promised)]
    least = min((float(np.nanmin(each)) for each in shown_digits if np.isfinite(each).any()), default=0.0)
    first = float(np.floor(least))
    norm = Normalize(first, MOST_DIGITS)
    runs = rounding.spread.runs
    titles = f"digits found in {runs} runs", "digits promised by the bound"
    for axes, values, title in zip((found, promised), (rounding.digits, rounding.promised), titles, strict=True):
        # The least of a block, as for kappa its largest.
        least_of_block = -reduced(np.where(study.kappa == 0.0, np.nan, -values), _block(study))
        _bar(_map(axes, study, least_of_block, "viridis", norm), axes, "decimal digits of the light budget")
        _titled(axes, title)
        _zoom(axes, study)
    bins = np.linspace(first, MOST_DIGITS, 60)
    for values, name in zip(shown_digits, ("found", "promised"), strict=True):
        counts.hist(values[np.isfinite(values)], bins=bins, histtype="step", linewidth=1.5, label=name)
    counts.set(xlabel="decimal digits", ylabel="pixels", yscale="log")
    counts.legend(fontsize=8, frameon=False)
    _titled(counts, f"errors: at most {100.0 * rounding.spread.worst:.3g} % of a bound")
    figure.suptitle(f"Random rounding of {_name(study)}", fontsize=10)
    figures.save(figure, path)


def plot(study: SceneStudy, path: Path) -> None:
    """Draw image, kappa, errors, and the factors of the worst pixels. Raises OutputError."""
    figure = figures.blank(13.0, 9.6)
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.08)  # type: ignore[union-attr, call-arg]
    (picture, kappa), (errors, bars) = figure.subplots(2, 2)
    colors = tonemap(study.frame.rgb, default_tonemap(study.frame.scene))
    picture.imshow(colors)
    _titled(picture, "image, with the worst pixels")
    _kappa_bar(_kappa(kappa, study), kappa)
    _titled(kappa, "kappa: how far the geometry amplifies rounding")
    _bar(_share(errors, study), errors, "error found / most allowed", extend="max")
    _titled(errors, f"error: at most {study.check.bounds:.3g} of {study.check.allowed:.4g} bounds")
    for axes in (picture, kappa, errors):
        _zoom(axes, study)
    _bars(bars, study)
    figure.suptitle(f"Stability of {_name(study)}\n{study.device}", fontsize=10)
    for _ in range(2):  # the first layout does not know how far equal aspects shrink the panels
        figure.canvas.draw()
    figure.set_layout_engine("none")
    for axes in (picture, kappa, errors):
        _numbers(axes, study)
    figures.save(figure, path)


def _numbers(axes: Axes, study: SceneStudy) -> None:
    """Mark the worst pixels by rings and numbers."""
    from matplotlib.patheffects import withStroke

    x, y = [each.column for each in study.worst], [each.row for each in study.worst]
    axes.scatter(x, y, s=46, facecolors="none", edgecolors="black", linewidths=2.2)
    axes.scatter(x, y, s=46, facecolors="none", edgecolors="white", linewidths=1.0)
    names = [str(number) for number in range(1, len(x) + 1)]
    outlined = [withStroke(linewidth=2.5, foreground="black")]
    label_points(axes, x, y, names, size=9.0, color="white", path_effects=outlined)


def _bars(axes: Axes, study: SceneStudy) -> None:
    """Draw, for each worst pixel, the bits that each cause may cost."""
    from matplotlib import colormaps

    _titled(axes, "what costs bits at the worst pixels")
    if not study.worst:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "nothing is visible", ha="center", va="center", transform=axes.transAxes)
        return
    palette = colormaps["tab10"]
    places = np.arange(1, len(study.worst) + 1)
    left = np.zeros(len(places))
    for k, (name, title) in enumerate(CAUSES.items()):
        bits = bits_lost([each.factors[name] for each in study.worst])
        if bits.max() > 0.0:
            axes.barh(places, bits, left=left, color=palette(k), label=title)
            left += bits
    axes.set(xlabel="bits: log2 of each factor of the bound", ylabel="worst pixel", yticks=places)
    axes.set_xlim(0.0, max(1.0, 1.05 * float(left.max())))
    axes.invert_yaxis()
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)
