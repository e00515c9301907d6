"""Some pixels of an image, drawn by the oracle with or without mistakes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ...base.arrays import Bools, Floats, Integers
from ...oracle import coverage
from ...oracle.corners import Corners
from ...oracle.frame import Prepared, face_weights, prepare, set_up
from ...oracle.pixels import shade_pixels
from ...oracle.shade import depth
from ...oracle.terms import RIGHT, Steps
from ...scene.model import Scene, Settings

Place = Callable[[Integers, Integers, tuple[int, int]], tuple[Integers, Integers]]
Shade = Callable[["Drawing"], Floats]
Compose = Callable[["Drawing", Shade], Floats]


def _same(values: Floats) -> Floats:
    return values


def _as_they_are(corners: Corners) -> Corners:
    return corners


def _in_place(rows: Integers, columns: Integers, shape: tuple[int, int]) -> tuple[Integers, Integers]:
    return rows, columns


def _unmoved(xy: Integers) -> Integers:
    return xy


def _at_once(drawing: Drawing, shade: Shade) -> Floats:
    return shade(drawing)


class Reach(NamedTuple):
    """Which pixels a triangle covers: those where it covers any, or all, of the pixels at these steps (column, up)."""

    any: bool = True
    steps: tuple[tuple[int, int], ...] = ((0, 0),)


ONE_PIXEL = Reach()


@dataclass(frozen=True, eq=False)
class Drawing:
    """How an image is made. A mistake returns a drawing with other steps.

    order: from corner depths (F, 3) to those that painter's order means. snap: of image coordinates (K, 3, 2), 1/256 px.
    reach: of triangles. corners: of the faces' attributes. light: its steps. compose: from the drawing and a function that
    shades drawings to colors (K, 3). place: from rows (from the TOP), columns and shape (M, N) to the pixels that are shown
    there. shown: from linear colors (K, 3) to values that are then clipped to [0, 1]. backdrop: color where the right image
    shows none of the object, (3,), as the image that is graded has it. covers: whether it replaces the finished background.
    """

    scene: Scene
    settings: Settings
    order: Callable[[Floats], Floats] = _same
    snap: Callable[[Integers], Integers] = _unmoved
    reach: Reach = ONE_PIXEL
    corners: Callable[[Corners], Corners] = _as_they_are
    light: Steps = RIGHT
    compose: Compose = _at_once
    place: Place = _in_place
    shown: Callable[[Floats], Floats] = _same
    backdrop: Floats = field(default_factory=lambda: np.zeros(3))
    covers: bool = False

    @property
    def of_scene(self) -> bool:
        """Whether only scene and settings may differ from the right ones: any renderer can draw it."""
        right = Drawing(self.scene, self.settings)
        names = ("order", "snap", "corners", "light", "compose", "place", "shown", "covers")
        return self.reach == right.reach and all(getattr(self, name) is getattr(right, name) for name in names)


Variant = tuple[str, Callable[[Drawing], Drawing]]  # of a mistake: its words, and what it does to a drawing


class _Visible(NamedTuple):
    """What pixels show: the prepared scene, the piece at each pixel, -1 for none, and columns and rows from the bottom."""

    prepared: Prepared
    owner: Integers
    column: Integers
    upward: Integers


class Canvas:
    """Pixels (rows from the TOP, columns, (K,) each) on which drawings of one scene are compared. What they show is kept for
    drawings that differ in light alone."""

    def __init__(self, shape: tuple[int, int], rows: Integers, columns: Integers) -> None:
        self.shape, self.rows, self.columns = shape, np.asarray(rows, np.int64), np.asarray(columns, np.int64)
        self._kept: dict[tuple[object, ...], _Visible] = {}
        self._prepared: dict[tuple[object, ...], Prepared] = {}

    def linear(self, drawing: Drawing) -> Floats:
        """Return the linear colors (K, 3) of a drawing, before `shown`."""
        seen = self._visible(drawing)
        background = drawing.scene.background
        found = np.tile(np.zeros(3) if background is None else background, (len(seen.owner), 1))
        drawn = seen.owner >= 0
        if drawn.any():
            found[drawn] = drawing.compose(drawing, lambda part: _shade(part, seen, drawn))
        return found

    def codes(self, drawing: Drawing) -> Floats:
        """Return the colors (K, 3) as a file of 8 bits has them, 0 to 255, not rounded."""
        return self.written(drawing, self.linear(drawing))

    def written(self, drawing: Drawing, linear: Floats) -> Floats:
        """Return the codes (K, 3), not rounded, that a drawing makes of linear colors."""
        found = as_codes(drawing.shown(linear))
        if drawing.covers:
            found[self.covered(drawing) < 0] = as_codes(drawing.backdrop)
        return found

    def covered(self, drawing: Drawing) -> Integers:
        """Return the piece that each pixel shows, (K,), -1 for the background."""
        return self._visible(drawing).owner

    def _visible(self, drawing: Drawing) -> _Visible:
        """Find what the pixels show; scenes of one camera have the same meshes, with other materials."""
        settings, changed = drawing.settings, (drawing.order, drawing.snap, drawing.reach, drawing.place)
        key = (drawing.scene.camera, settings.visibility, settings.cull, *changed)
        if key not in self._kept:
            self._kept[key] = self._found(drawing)
        return self._kept[key]

    def _found(self, drawing: Drawing) -> _Visible:
        rows, column = drawing.place(self.rows, self.columns, self.shape)
        upward = self.shape[0] - 1 - rows
        seen_by = drawing.scene.camera, drawing.settings.cull
        if seen_by not in self._prepared:
            self._prepared[seen_by] = prepare(drawing.scene, drawing.settings)
        prepared = self._prepared[seen_by]
        if drawing.snap is not _unmoved:
            cut = replace(prepared.pieces, xy=drawing.snap(prepared.pieces.xy))
            setup = set_up(drawing.scene, drawing.settings, prepared.corners, cut)
            prepared = replace(prepared, pieces=cut, setup=setup)
        return _Visible(prepared, _first(drawing, prepared, column, upward), column, upward)


def as_codes(values: Floats) -> Floats:
    """Return values as codes from 0 to 255, clipped, not rounded."""
    return np.clip(np.nan_to_num(values), 0.0, 1.0) * 255.0


def _first(drawing: Drawing, prepared: Prepared, column: Integers, upward: Integers) -> Integers:
    """Return the piece that pixels (Q,) show, -1 for none: the first in painter's order, or of the smallest depth."""
    cut, setup, reach = prepared.pieces, prepared.setup, drawing.reach
    count = len(column)
    depths = drawing.order(prepared.z)[cut.face]
    order = coverage.painter_order(depths, ~setup.culled)
    hits: list[Integers] = []
    for across, up in reach.steps:
        found = coverage.samples_at(cut.xy[order], setup.box[order], column + across, upward + up)
        hits.append(np.concatenate([np.zeros(0, np.int64), *(k * count + pixel for k, pixel, _ in found)]))
    keys, times = np.unique(np.concatenate([np.zeros(0, np.int64), *hits]), return_counts=True)
    rank, pixel = np.divmod(keys if reach.any else keys[times == len(reach.steps)], count)
    if drawing.settings.visibility == "depth":
        edges = coverage.edge_functions(cut.xy[order[rank]], column[pixel], upward[pixel])
        near = depth(edges, cut.z[order[rank]])
        by_depth = np.lexsort((-order[rank], near))
        rank, pixel = rank[by_depth], pixel[by_depth]
    first = np.full(count, -1)
    shown, at = np.unique(pixel, return_index=True)
    first[shown] = order[rank[at]]
    return first


def _shade(drawing: Drawing, seen: _Visible, drawn: Bools) -> Floats:
    """Return the colors (D, 3) of the pixels that are drawn, (K,) bool."""
    scene, settings, cut = drawing.scene, drawing.settings, seen.prepared.pieces
    piece, column, upward = seen.owner[drawn], seen.column[drawn], seen.upward[drawn]
    edges = coverage.edge_functions(cut.xy[piece], column, upward)
    weights = face_weights(scene, settings, seen.prepared, piece, edges)
    behind = seen.prepared.setup.area[piece] < 0
    corners = drawing.corners(seen.prepared.corners)
    return shade_pixels(scene, settings, corners, cut.face[piece], weights, behind, light=drawing.light).rgb
