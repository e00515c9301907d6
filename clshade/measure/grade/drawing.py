"""Some pixels of an image, drawn by the oracle with or without mistakes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...base.arrays import Bools, Floats, Integers
from ...oracle import coverage
from ...oracle.corners import Corners
from ...oracle.frame import owners
from ...oracle.pixels import shade_pixels
from ...oracle.shade import RIGHT, Steps
from ...oracle.shot import Hits, Shot, prepare
from ...scene.model import Scene, Settings

Place = Callable[[Integers, Integers, tuple[int, int]], tuple[Integers, Integers]]
Shade = Callable[["Drawing"], Floats]
Compose = Callable[["Drawing", Shade], Floats]
Edit = Callable[["Drawing"], "Drawing"]  # what a mistake does to a drawing
_Value = TypeVar("_Value")


def _through(steps: Iterable[Callable[[_Value], _Value]], value: _Value) -> _Value:
    for step in steps:
        value = step(value)
    return value


def _own_depths(z: Floats) -> Floats:
    return z


def _at_once(drawing: Drawing, shade: Shade) -> Floats:
    return shade(drawing)


class Reach(NamedTuple):
    """Which pixels a triangle covers: those where it covers any, or all, of the pixels at these offsets (column, up)."""

    any: bool = True
    offsets: tuple[tuple[int, int], ...] = ((0, 0),)


ONE_PIXEL = Reach()


@dataclass(frozen=True, eq=False)
class Drawing:
    """How an image is made. A mistake returns a drawing with other steps.

    order: from corner depths (F, 3) to those that painter's order means. snap: of snapped coordinates (K, 3, 2), one
    after another. reach: of triangles. corners: of the faces' attributes, one after another. light: its steps. compose: from
    the drawing and a function that shades drawings to colors (K, 3). place: from rows (from the TOP), columns and shape (M,
    N) to the pixels that are shown there, the last first. shown: from linear colors (K, 3) to values that are then clipped
    to [0, 1], one after another. backdrop: color where the right image shows none of the object, (3,), as the image that is
    graded has it. covers: whether it replaces the finished background.
    """

    scene: Scene
    settings: Settings
    order: Callable[[Floats], Floats] = _own_depths
    snap: tuple[Callable[[Integers], Integers], ...] = ()
    reach: Reach = ONE_PIXEL
    corners: tuple[Callable[[Corners], Corners], ...] = ()
    light: Steps = RIGHT
    compose: Compose = _at_once
    place: tuple[Place, ...] = ()
    shown: tuple[Callable[[Floats], Floats], ...] = ()
    backdrop: Floats = field(default_factory=lambda: np.zeros(3))
    covers: bool = False

    def codes_of(self, linear: Floats) -> Floats:
        """Return linear colors (..., 3) as codes from 0 to 255, not rounded."""
        return as_codes(_through(self.shown, linear))


def then(**steps: Any) -> Edit:
    """Return an edit that adds steps, such as one of `snap`, after those that a drawing has."""

    def change(drawing: Drawing) -> Drawing:
        longer: dict[str, Any] = {name: (*getattr(drawing, name), step) for name, step in steps.items()}
        return replace(drawing, **longer)

    return change


def instead(**steps: Any) -> Edit:
    """Return an edit that replaces steps of a drawing, such as `order`."""
    return lambda drawing: replace(drawing, **steps)


class _Visible(NamedTuple):
    """What pixels show: the scene, the piece at each pixel, -1 for none, and columns and rows from the bottom."""

    shot: Shot
    owner: Integers
    column: Integers
    upward: Integers


class Canvas:
    """Pixels (rows from the TOP, columns, (K,) each) on which drawings of one scene are compared. What they show is kept for
    drawings that differ in light alone."""

    def __init__(self, rows: Integers, columns: Integers) -> None:
        self.rows, self.columns = np.asarray(rows, np.int64), np.asarray(columns, np.int64)
        self._kept: dict[tuple[object, ...], _Visible] = {}
        self._prepared: dict[bool, Shot] = {}

    def linear(self, drawing: Drawing) -> Floats:
        """Return the linear colors (K, 3) of a drawing, before `shown`."""
        visible = self._visible(drawing)
        background = drawing.scene.background
        colors = np.tile(np.zeros(3) if background is None else background, (len(visible.owner), 1))
        covered = visible.owner >= 0
        if covered.any():
            colors[covered] = drawing.compose(drawing, lambda part: _shade(part, visible, covered))
        return colors

    def codes(self, drawing: Drawing, linear: Floats | None = None) -> Floats:
        """Return the colors (K, 3) as a file of 8 bits has them, 0 to 255, not rounded. linear: those before, if known."""
        codes = drawing.codes_of(self.linear(drawing) if linear is None else linear)
        if drawing.covers:
            codes[self._visible(drawing).owner < 0] = as_codes(drawing.backdrop)
        return codes

    def _visible(self, drawing: Drawing) -> _Visible:
        """Find what the pixels show; all scenes have the same camera and meshes, with other materials."""
        settings = drawing.settings
        key = settings.visibility, settings.cull, drawing.order, drawing.snap, drawing.reach, drawing.place
        if key not in self._kept:
            self._kept[key] = self._found(drawing)
        return self._kept[key]

    def _found(self, drawing: Drawing) -> _Visible:
        scene, settings = drawing.scene, drawing.settings
        width, height = scene.camera.resolution
        rows: Integers = self.rows
        columns: Integers = self.columns
        for place in reversed(drawing.place):
            rows, columns = place(rows, columns, (height, width))
        if settings.cull not in self._prepared:
            self._prepared[settings.cull] = prepare(scene, settings)
        shot = replace(self._prepared[settings.cull], settings=settings)
        shot = replace(shot, pieces=replace(shot.pieces, xy=_through(drawing.snap, shot.pieces.xy)))
        upward = height - 1 - rows
        ordered, covered = replace(shot, z=drawing.order(shot.z)), partial(_covered, reach=drawing.reach)
        return _Visible(shot, owners(ordered, columns, upward, covered, see_through=False), columns, upward)


def _of_all_pixels(drawing: Drawing, colors: Callable[[Canvas, Drawing], Floats]) -> Floats:
    columns, rows = drawing.scene.camera.resolution
    return colors(Canvas(*np.divmod(np.arange(rows * columns), columns)), drawing).reshape(rows, columns, 3)


def linear_image(drawing: Drawing) -> Floats:
    """Return the linear image (M, N, 3) of a drawing, before `shown`, row 0 at the top."""
    return _of_all_pixels(drawing, Canvas.linear)


def code_image(drawing: Drawing) -> Floats:
    """Return the codes (M, N, 3) of a drawing, not rounded, row 0 at the top."""
    return _of_all_pixels(drawing, Canvas.codes)


def as_codes(values: Floats) -> Floats:
    """Return values as codes from 0 to 255, clipped, not rounded."""
    return np.clip(np.nan_to_num(values), 0.0, 1.0) * 255.0


def _covered(
    xy: Integers, boxes: Integers, column: Integers, upward: Integers, reach: Reach
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield which triangles cover, in their reach, which pixels (Q,), as `coverage.samples_at` does, all at once."""
    hits = [np.zeros(0, np.int64)]
    for across, up in reach.offsets:
        for k, pixel, _ in coverage.samples_at(xy, boxes, column + across, upward + up):
            hits.append(k * len(column) + pixel)
    keys, times = np.unique(np.concatenate(hits), return_counts=True)
    k, pixel = np.divmod(keys if reach.any else keys[times == len(reach.offsets)], len(column))
    yield k, pixel, coverage.edge_functions(xy[k], column[pixel], upward[pixel])


def _shade(drawing: Drawing, visible: _Visible, covered: Bools) -> Floats:
    """Return the colors (D, 3) of the pixels that are drawn, (K,) bool."""
    piece, column, upward = visible.owner[covered], visible.column[covered], visible.upward[covered]
    corners = _through(drawing.corners, replace(visible.shot.corners, scene=drawing.scene))
    shot = replace(visible.shot, scene=drawing.scene, settings=drawing.settings, corners=corners)
    edges = coverage.edge_functions(shot.pieces.xy[piece], column, upward)
    place = np.broadcast_to(shot.place, (len(piece), 2))
    return shade_pixels(Hits(shot, piece, column, upward, place, edges), drawing.light).rgb
