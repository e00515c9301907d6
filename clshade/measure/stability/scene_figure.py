"""Figure of one scene's stability: the image with the worst pixels, kappa, and errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import Array, Floats
from ...base.atomic_files import shown
from ...base.text_tables import cut
from ...images import figures
from ...images.tonemap import tonemap
from ...scene.model import default_tonemap
from .scene_study import SceneStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

SIDE = 900  # pixels of a panel's longer side: larger images are reduced
SAMPLED_SIDE = 200  # of an image that was sampled, so that each pixel holds some of the sample
LEAST_SHARE = 1e-5  # of the bound, drawn in the darkest color
BACKGROUND, OVER = "#d9d9d9", "#ff2020"
MARGIN = 2.5  # pixels around what is drawn


def plot(study: SceneStudy, device: str, path: Path) -> None:
    """Draw image, kappa and errors with the worst pixels numbered in each. Raises OutputError."""
    figure = figures.blank(16.0, 5.6)
    picture, kappa, errors = figure.subplots(1, 3)
    picture.imshow(tonemap(study.frame.rgb, default_tonemap(study.frame.scene)))
    picture.set_title("image, with the worst pixels", fontsize=10)
    largest = float(study.kappa[np.isfinite(study.kappa)].max(initial=2.0))
    draw_map(kappa, study, study.kappa, "viridis", (1.0, largest), label="condition number kappa")
    kappa.set_title("kappa: how far the geometry amplifies rounding", fontsize=10)
    draw_map(errors, study, study.share, "magma", (LEAST_SHARE, 1.0), label="error / bound", extend="max")
    errors.set_title(f"error: at most {study.check.bounds:.3g} of {study.check.allowed:.4g} bounds", fontsize=10)
    for axes in (picture, kappa, errors):
        _zoom(axes, study)
        _numbers(axes, study)
    rows, columns = study.kappa.shape
    name = cut(shown(study.frame.scene.name or "unnamed"), 48).replace("$", r"\$")
    title = f"Stability of {name}, {columns}x{rows}, {study.frame.settings.precision}\n{device}"
    figure.suptitle(title, fontsize=10)
    figures.save(figure, path)


def draw_map(
    axes: Axes, study: SceneStudy, values: Array, colors: str, ends: tuple[float, float], **options: Any
) -> AxesImage:
    """Draw values (M, N) of covered pixels on a logarithmic scale, smaller ones than its end in the darkest color, larger
    ones in OVER. options: of the color bar."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    side = SIDE if study.check.complete else SAMPLED_SIDE
    block = -(-max(study.kappa.shape) // side)  # of pixels that become a pixel of the panel
    kappa, largest = reduced(study.kappa, block), reduced(values, block)
    axes.set_facecolor(BACKGROUND)
    image = axes.imshow(
        np.where(kappa == 0.0, np.nan, np.maximum(largest, ends[0])),
        cmap=colormaps[colors].with_extremes(over=OVER, bad=(0.0, 0.0, 0.0, 0.0)),
        norm=LogNorm(*ends),
        extent=(-0.5, block * kappa.shape[1] - 0.5, block * kappa.shape[0] - 0.5, -0.5),
        interpolation="nearest",
    )
    axes.figure.colorbar(image, ax=axes, location="bottom", shrink=0.9, **options)
    return image


def reduced(values: Array, block: int) -> Floats:
    """Return the largest value of each block of block x block pixels of an image (M, N); NaN where it holds nothing
    else."""
    rows, columns = (-(-size // block) for size in values.shape)
    padded = np.full((rows * block, columns * block), np.nan)
    padded[: values.shape[0], : values.shape[1]] = values
    largest: Floats = np.fmax.reduce(np.fmax.reduce(padded.reshape(rows, block, columns, block), axis=3), axis=1)
    return largest


def _zoom(axes: Axes, study: SceneStudy) -> None:
    """Show the part of the image that holds something, all of it if nothing does."""
    rows, columns = np.nonzero(study.kappa)
    if len(rows):
        axes.set_xlim(columns.min() - MARGIN, columns.max() + MARGIN)
        axes.set_ylim(rows.max() + MARGIN, rows.min() - MARGIN)
    axes.set(xlabel="column", ylabel="row")
    axes.tick_params(labelsize=7)
    axes.set_anchor("N")  # the panels' tops are in line, with a color bar below or without


def _numbers(axes: Axes, study: SceneStudy) -> None:
    """Mark the worst pixels by rings and numbers."""
    from matplotlib.patheffects import withStroke

    outline = [withStroke(linewidth=2.5, foreground="black")]
    style: dict[str, Any] = {"color": "white", "path_effects": outline}
    for pixel in study.worst:
        place = pixel.column, pixel.row
        axes.plot(*place, "o", markersize=6.0, markerfacecolor="none", **style)
        axes.annotate(str(pixel.number), place, (5.0, 5.0), textcoords="offset points", fontsize=9.0, **style)
