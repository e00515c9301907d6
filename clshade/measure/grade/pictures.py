"""Pictures of a graded image: itself, the right one and the difference; and what is left after the best explanation."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...base.arrays import Bytes, Floats
from ...images import compare_figure, figures
from ...images.channels import Group
from ...images.layer_plots import panel_size
from ...images.thumbnails import largest, thinned
from .grade import Grade, Right, explained_codes
from .search import Explanation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIDE = 240  # most pixels of a small picture along its longer side
_PANEL, _TITLE, _BAR = 3.6, 0.75, 0.9  # inches
_LETTERS = 110  # of a title, in a line


class Shot(NamedTuple):
    """A small picture, (M, N, 3) uint8, and what it shows."""

    caption: str
    pixels: Bytes


def draw(found: Grade, right: Right) -> Figure:
    """Draw image, right one and difference; below them the right one with the mistakes in its place."""
    image = _group(found.image)
    verdict = "right within 1/255" if found.right else f"not right: {found.differ:,} pixels differ"
    rows = [(verdict, "the right image", _group(right.codes))]
    if found.best is not None:
        mistake = found.best.label if found.best.claimed else f"not explained; nearest: {found.best.label}"
        rows.append((mistake, _with_mistakes(found.best), _group(explained_codes(right, found.best))))
    width, height = panel_size(found.image.shape, _PANEL)
    figure = figures.blank(3 * width + _BAR, len(rows) * (height + _TITLE), dpi=100)
    parts = figure.subfigures(len(rows), 1, squeeze=False)[:, 0]
    for part, (title, caption, expected) in zip(parts, rows, strict=True):
        part.suptitle(textwrap.fill(title, _LETTERS), fontsize=10, fontweight="bold")
        panels = part.subplots(1, 3)
        compare_figure.draw_row(part, panels, "image", (image, expected), True, ("your image", caption))
    return figure


def _group(codes: Floats) -> Group:
    planes = np.moveaxis(codes.astype(np.float32) / np.float32(255.0), 2, 0)
    return Group("RGB", ("R", "G", "B"), tuple(planes))


def _with_mistakes(found: Explanation) -> str:
    return f"the right image with {'this mistake' if len(found.changes) == 1 else 'these mistakes'}"


def shots(found: Grade, right: Right) -> tuple[Shot, ...]:
    """Return small pictures of an image for a page: `draw` without its scale."""
    made = [_shot("submission", found.image), _shot("the right image", right.codes)]
    if found.differ:
        made.append(_difference("difference", found.image, right.codes))
    if found.best is not None:
        explained = explained_codes(right, found.best)
        made.append(_shot(_with_mistakes(found.best), explained))
        made.append(_difference("difference that is left", found.image, explained))
    return tuple(made)


def _shot(caption: str, codes: Floats) -> Shot:
    return Shot(caption, np.ascontiguousarray(np.uint8(np.rint(thinned(codes, _SIDE)))))


def _difference(caption: str, codes: Floats, expected: Floats) -> Shot:
    """Show what differs by more than one code, the brighter, the more; of pixels that are skipped, too."""
    apart = largest(np.abs(codes - expected).max(axis=2), _SIDE)
    level = np.where(apart > 1.0 + 1e-9, 64.0 + 0.75 * apart, 0.0)
    return Shot(caption, np.repeat(np.uint8(np.minimum(level, 255.0))[..., None], 3, axis=2))
