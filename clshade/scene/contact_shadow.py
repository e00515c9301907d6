"""Contact shadows: the visibility of the sky from a ground, past the objects that stand on it.

Surfaces are voxelized. All points of the ground see the sky along the same directions, so the occluders that their rays
meet after a step are the grid, shifted: no ray is traced. Only operations that IEEE 754 rounds are used, so that all
machines compute equal numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from ..base.arrays import Array, Bools, Floats, Floats32
from .model import Mesh, Scene

TEXELS = 128  # squares of the ground to a side
_RAYS = 128
_FINE = 4  # cells to a square's side
_SPACING = 0.5  # of the points that mark cells, cells
_COUNTS = np.array(sorted({round(1.3**k) for k in range(27)}))  # of points along a side: few different ones, to 917
_AT_ONCE = 1 << 17  # points, or faces
_TURN = (-0.7373688780783197, 0.6754902942615238)  # cosine and sine of the golden angle


def open_sky(scene: Scene, origin: Floats, axes: Floats, unit: float, reach: int) -> Floats:
    """Return the cosine-weighted visibility of the sky from squares of the ground, (TEXELS, TEXELS), rows along axes[1].

    scene: the objects, no further than `reach` squares from the ground's middle. origin: the corner of the first square.
    axes: (3, 3), unit vectors along the rows of squares, along their columns, and up; all along axes of the world. unit:
    the side of a square. reach: the length of the rays, squares: a multiple of 4.
    """
    opaque, translucent = _Grid(reach, bool), None
    for mesh, corners in _surfaces(scene, origin, axes * (_FINE / unit)):
        if mesh is not None and translucent is None:
            translucent = _Grid(reach, np.float32)
        (translucent if mesh is not None and translucent else opaque).mark(corners, mesh)
    total = np.zeros((TEXELS, TEXELS), np.float32)
    for direction in _directions(_RAYS):
        visible = ~opaque.hidden(direction)
        total += visible * translucent.transmittance(direction) if translucent else visible
    return total.astype(np.float64) / _RAYS


def _directions(count: int) -> Floats:
    """Return unit vectors above the plane z = 0, (count, 3), distributed as the cosine of the angle to its normal: one to
    each ring of equal area, turned by the golden angle."""
    share = (np.arange(count) + 0.5) / count
    turn, directions = (1.0, 0.0), np.empty((count, 3))
    for row, radius, height in zip(directions, np.sqrt(share), np.sqrt(1.0 - share), strict=True):
        row[:] = radius * turn[0], radius * turn[1], height
        turn = turn[0] * _TURN[0] - turn[1] * _TURN[1], turn[0] * _TURN[1] + turn[1] * _TURN[0]
    return directions


def _surfaces(scene: Scene, origin: Floats, axes: Floats) -> Iterator[tuple[Mesh | None, Floats32]]:
    """Yield corners of triangles, not many more than _AT_ONCE: their places in cells, (F, 3, 3); of a translucent mesh with
    the mesh, and u, v and alpha, (F, 3, 6)."""
    pool: list[Floats32] = []
    for mesh in scene.meshes:
        for corners in _corners(mesh, origin, axes):
            if corners.shape[2] > 3:
                yield mesh, corners
                continue
            pool.append(corners)
            if sum(map(len, pool)) >= _AT_ONCE:
                yield None, np.concatenate(pool)
                pool.clear()
    if pool:
        yield None, np.concatenate(pool)


def _corners(mesh: Mesh, origin: Floats, axes: Floats) -> Iterator[Floats32]:
    placements, uv_faces = np.asarray(mesh.instances), mesh.faces if mesh.uv_faces is None else mesh.uv_faces
    uvs = np.zeros((len(mesh.verts), 2)) if mesh.uvs is None else mesh.uvs
    alphas = np.ones(len(mesh.verts)) if mesh.alphas is None else mesh.alphas
    x, y, z = mesh.verts.astype(np.float64).T[..., None]
    few = max(1, _AT_ONCE // max(len(mesh.verts), len(mesh.faces), 1))
    for first in range(0, len(placements), few):
        matrix = placements[first : first + few, None, :3]
        placed = (matrix[..., 0] * x + matrix[..., 1] * y) + matrix[..., 2] * z + matrix[..., 3]
        places = ((placed - origin) @ axes.T).astype(np.float32)
        for start in range(0, len(mesh.faces), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            corners: Floats32 = places[:, mesh.faces[some]]
            if mesh.blends or mesh.tests_alpha:
                more = np.concatenate([uvs[uv_faces[some]], alphas[mesh.faces[some]][..., None]], axis=-1)
                with np.errstate(over="ignore"):
                    more = np.broadcast_to(more.astype(np.float32), corners.shape)
                corners = np.concatenate([corners, more], axis=-1)
            yield corners.reshape(-1, *corners.shape[2:])


def _points(corners: Floats32) -> Iterator[Floats32]:
    """Yield points of triangles, (C, K), at most _SPACING apart along both sides at the corner opposite to the longest,
    for sides up to 458 cells: what rays reach is at most 320 wide."""
    sides = corners[:, [2, 0, 1], :3] - corners[:, [1, 2, 0], :3]
    x, y, z = np.moveaxis(sides, 2, 0)
    length = np.sqrt(x * x + y * y + z * z)
    rows, first = np.arange(len(corners)), length.argmax(axis=1)
    second, third = (first + 1) % 3, (first + 2) % 3
    i, j = (np.searchsorted(_COUNTS[:-1], length[rows, side] / _SPACING) for side in (third, second))
    kind = i * len(_COUNTS) + j
    order = np.argsort(kind, kind="stable")
    kinds, starts = np.unique(kind[order], return_index=True)
    for number, alike in zip(kinds.tolist(), np.split(order, starts[1:]), strict=True):
        i, j = (_COUNTS[k] for k in divmod(number, len(_COUNTS)))
        s, t = np.repeat((np.arange(i) + 0.5) / i, j), np.tile((np.arange(j) + 0.5) / j, i)
        s, t = (s[s + t <= 1.0], t[s + t <= 1.0]) if i * j > 1 else (np.array([1.0 / 3.0]), np.array([1.0 / 3.0]))
        s, t = s.astype(np.float32), t.astype(np.float32)
        step = max(1, _AT_ONCE // len(s))
        for start in range(0, len(alike), step):
            some = alike[start : start + step]
            a, b, c = (corners[some, corner[some]].T[..., None] for corner in (first, second, third))
            yield (a + s * (b - a) + t * (c - a)).reshape(corners.shape[2], -1)


def _alphas(mesh: Mesh, points: Floats32) -> Floats32:
    """Return the opacity of points of a mesh, (K,). points: (3, K), u, v and the vertices' alpha."""
    material, texture = mesh.material, mesh.material.texture
    alpha = points[2] * np.float32(material.opacity)
    if texture is not None and mesh.uvs is not None and texture.texels.shape[2] == 4:
        texels = []
        for axis, coordinate in enumerate(points[:2]):
            wrap, size = "clamp" if texture.lookup == "course" else texture.wrap[axis], texture.texels.shape[1 - axis]
            repeated = coordinate % (2.0 if wrap == "mirror" else 1.0)
            place = np.clip(coordinate, 0.0, 1.0) if wrap == "clamp" else np.minimum(repeated, 2.0 - repeated)
            texels.append(np.minimum(np.nan_to_num(place) * size, size - 1).astype(np.int32))
        alpha = alpha * texture.image[texels[1], texels[0], 3]
    if material.alpha_cutoff is not None:
        alpha = np.where(alpha >= material.alpha_cutoff, alpha if material.blend else np.float32(1.0), np.float32(0.0))
    clipped: Floats32 = np.clip(alpha, 0.0, 1.0)
    return clipped


class _Grid:
    """Which cells surfaces touch, or the opacities of cells. Cells at equal places in their squares lie together: those
    that the rays of neighboring squares meet at a step are a slice. reach: of the rays, squares."""

    def __init__(self, reach: int, kind: type) -> None:
        self._high, self._side, self._first = reach * _FINE, 2 * reach, TEXELS // 2 - reach
        # The last layer is for everything higher.
        self._cells: Array = np.zeros((self._high + 1, _FINE, _FINE, self._side, self._side), kind)
        self._counts = np.zeros(self._cells.shape if kind is not bool else 0, np.float32)

    def mark(self, corners: Floats32, mesh: Mesh | None) -> None:
        """Mark the cells that triangles touch; of a translucent mesh with sums of its alpha."""
        cells, counts = self._cells.reshape(-1), self._counts.reshape(-1)
        with np.errstate(over="ignore", invalid="ignore"):  # of texture coordinates beyond float32
            for points in _points(corners[corners[:, :, 2].min(axis=1) < self._high]):
                x, y = (
                    np.clip(v - self._first * _FINE, 0, self._side * _FINE - 1).astype(np.int32) for v in points[:2]
                )
                z = np.clip(points[2], 0, self._high).astype(np.int32)
                layer = (z * _FINE + y % _FINE) * _FINE + x % _FINE
                touched = (layer * self._side + y // _FINE) * self._side + x // _FINE
                if mesh is None:
                    cells[touched] = True
                    continue
                where, inverse, times = np.unique(touched, return_inverse=True, return_counts=True)
                cells[where] += np.bincount(inverse, _alphas(mesh, points[3:]))
                counts[where] += times

    def _steps(self, direction: Floats) -> Array:
        """Return where the first square's ray is after each step of a cell along the longest axis, (3, K): the row and the
        column of a square, from the grid's corner, and the number of the layer of cells at that height and place in squares.
        """
        longest = float(np.abs(direction).max())
        steps = (np.arange(int(self._high * longest)) + 0.5) / longest
        x, y, z = np.floor(np.array([_FINE / 2, _FINE / 2, 0.0]) + steps[:, None] * direction).astype(int).T
        x, y = x - self._first * _FINE, y - self._first * _FINE
        return np.stack([y // _FINE, x // _FINE, (z * _FINE + y % _FINE) * _FINE + x % _FINE])

    @cached_property
    def _masks(self) -> Array:
        """The cells of each layer as an integer: a bit each, with as many zeros after each row of them."""
        packed = np.packbits(self._cells[:-1].reshape(-1, self._side, self._side), axis=2, bitorder="little")
        rows = np.concatenate([packed, np.zeros_like(packed)], axis=2)
        return np.array([int.from_bytes(row.tobytes(), "little") for row in rows], object)

    def hidden(self, direction: Floats) -> Bools:
        """Return which squares see an occluder in a direction, (TEXELS, TEXELS)."""
        # Shifting a mask moves its cells by rows and columns: none comes further than the zeros after a row.
        width, first, hidden = 2 * self._side, self._side // 2 - self._first, 0
        row, column, layer = self._steps(direction)
        shift = (first - row) * width + first - column
        for mask, places in zip(self._masks[layer].tolist(), shift.tolist(), strict=True):
            hidden |= mask << places
        packed = np.frombuffer(hidden.to_bytes(width * width // 8, "little"), np.uint8)
        squares = np.unpackbits(packed, bitorder="little").reshape(width, width).view(bool)
        return squares[first : first + TEXELS, first : first + TEXELS]

    @cached_property
    def _opacities(self) -> dict[int, Array]:
        """The mean alphas of the points in cells, (side, side), by layer, of those that surfaces touch."""
        layers, counts = (cells.reshape(-1, self._side, self._side) for cells in (self._cells[:-1], self._counts))
        touched = np.flatnonzero(layers.any(axis=(1, 2))).tolist()
        return {number: layers[number] / np.maximum(counts[number], 1.0) for number in touched}

    def transmittance(self, direction: Floats) -> Floats32:
        """Return the share of light that arrives from a direction. A surface counts where a ray enters its cells."""
        passed, before = np.ones((TEXELS, TEXELS), np.float32), np.zeros((TEXELS, TEXELS), np.float32)
        for row, column, layer in self._steps(direction).T.tolist():
            now = np.zeros_like(before)
            if layer in self._opacities:
                top, left = max(0, -row), max(0, -column)
                cells = self._opacities[layer][top + row : TEXELS + row, left + column : TEXELS + column]
                now[top : top + len(cells), left : left + cells.shape[1]] = cells
                passed *= 1.0 - np.maximum(now - before, 0.0)
            before = now
        return passed
