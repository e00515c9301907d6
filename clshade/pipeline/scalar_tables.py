"""Scalars as the kernels read them: positions in the color map, and its table of colors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import Mesh, Scalars, Scene
from ..scene.scalar_colors import ColorMap, at_corners, at_vertices, color_map_of
from .struct_layout import MOST_POSITION, NAN_POSITION, WHITE_POSITION

_LEAST_WIDTH = 2.0**-1000  # of a map, relative to the numbers of a face
_MOST_EXPONENT = math.frexp(MOST_POSITION)[1] - 1


def map_positions(values: Array, color_map: ColorMap) -> Floats:
    """Return positions (K, C) in a map of numbers (K, C): 0 at its low end, N at its high one, of any size; NaN stays.

    Where the map is so narrow, or a row so large, that the quotient could overflow, the row is a multiple of that.
    """
    ends = np.broadcast_to((color_map.low, color_map.high), (len(values), 2))
    every = np.concatenate([ends, np.nan_to_num(values.astype(np.float64))], axis=1)
    exponent = -np.frexp(np.abs(every).max(axis=1, keepdims=True))[1] - 1  # to at most 1/2: no difference overflows
    ends, scaled = np.ldexp(ends, exponent), np.ldexp(values.astype(np.float64), exponent)
    apart, width = scaled - ends[:, :1], ends[:, 1:] - ends[:, :1]
    most = np.fmax.reduce(np.abs(apart), axis=1, keepdims=True, initial=0.0)
    narrow = width < _LEAST_WIDTH
    width = np.where(narrow, np.where(most > 0.0, most, 1.0), width)
    # The product first: where the quotient is a whole number, it is exact.
    positions: Floats = apart * np.where(narrow, 1.0 / _LEAST_WIDTH, color_map.count) / width
    return positions


def _held(positions: Floats) -> Floats:
    """Return positions (F, 3) of faces' corners of at most MOST_POSITION, in proportion; of faces with a NaN
    NAN_POSITION."""
    missing = np.isnan(positions).any(axis=1, keepdims=True)
    most = np.where(missing, 0.0, np.abs(positions)).max(axis=1, keepdims=True)
    too_large = np.maximum(np.frexp(most)[1] - _MOST_EXPONENT, 0)
    held: Floats = np.where(missing, NAN_POSITION, np.ldexp(positions, -too_large))
    return held


@dataclass(frozen=True, eq=False)
class ScalarTables:
    """The scalars that a scene shows. at_corners: whether each corner of a face has a position, else each vertex."""

    scalars: Scalars
    color_map: ColorMap
    at_corners: bool

    @classmethod
    def of(cls, scene: Scene, scalars: Scalars) -> ScalarTables:
        """Return the tables of a scene. Raises InputError if it has no such scalars."""
        color_map = color_map_of(scene, scalars)
        shown = [mesh for mesh in scene.meshes if scalars.name in mesh.scalars]
        return cls(scalars, color_map, not all(_fits_vertices(mesh, scalars.name, color_map) for mesh in shown))

    def shows(self, mesh: Mesh) -> bool:
        return self.scalars.name in mesh.scalars

    def positions(self, mesh: Mesh) -> Floats:
        """Return the positions of a mesh's vertices, (V,), or of its faces' corners, (F, 3)."""
        name = self.scalars.name
        if not self.shows(mesh):
            return np.full((len(mesh.faces), 3) if self.at_corners else len(mesh.verts), WHITE_POSITION)
        if self.at_corners:
            return _held(map_positions(at_corners(mesh, name), self.color_map))
        return map_positions(mesh.scalars[name][:, None], self.color_map)[:, 0]

    def values(self, mesh: Mesh) -> Floats:
        """Return the scalars at the corners of a mesh's faces, (F, 3); NaN at all corners of faces that lack one."""
        if not self.shows(mesh):
            return np.full((len(mesh.faces), 3), np.nan)
        values = at_corners(mesh, self.scalars.name)
        return np.where(np.isnan(values).any(axis=1, keepdims=True), np.nan, values)


def _fits_vertices(mesh: Mesh, name: str, color_map: ColorMap) -> bool:
    """Return whether each vertex can have one position: scalars per vertex, none of a face NaN, none too far beyond the
    map's ends."""
    if not at_vertices(mesh, name):
        return False
    positions = map_positions(mesh.scalars[name][:, None], color_map)[mesh.faces]
    return bool((np.abs(positions) <= MOST_POSITION).all())


def color_table(tables: ScalarTables | None) -> Array:
    """Return the rows that kernels look up, (N + 4, 4) float32: those of the map, and white."""
    colors = np.ones((3, 3)) if tables is None else tables.color_map.table
    table = np.ones((len(colors) + 1, 4), np.float32)
    table[:-1, :3] = colors
    return table
