"""Looks: the background, light and ground that a scene is shown with; and changes of its lights.

The contact shadow on the ground is the visibility of the sky past the objects that stand on it, voxelized.
All points of the ground see the sky along the same directions, so the occluders that their rays meet after a step are the
grid, shifted: no ray is traced. Only operations that IEEE 754 rounds are used, so that all machines compute equal numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..base.arrays import Array, Bools, Floats, Floats32
from ..base.validation import arguments, choice, flag, number
from ..errors import InputError
from .builtin.studio import studio
from .framing import UPS, Up, bounding_sphere, up_of
from .ground import objects_of, with_ground
from .model import Mesh, PointLight, Scene, Settings, Texture
from .settings import LOOKS, Look

BACKGROUND = 0.6  # of the studio, linear: a light gray, code 203 of sRGB
_GRAY = 0.8  # of its ground: in the middle about as bright as the background
_REACH = 1.6  # bounding radii: half the side of the square of ground that the shadow covers
_FADE = 0.6  # where the shadow begins to fade, as a part of _REACH
_SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0  # of neighboring texels, along both axes
_TEXELS = 128  # squares of the ground to a side
_RAYS = 128
_LENGTH = 40  # of the rays, squares: a bounding radius
_FINE = 4  # cells to a square's side
_HIGH, _SIDE, _FIRST = (
    _LENGTH * _FINE,
    2 * _LENGTH,
    _TEXELS // 2 - _LENGTH,
)  # of the grid: cells, squares, its first square
_SPACING = 0.5  # of the points that mark cells, cells
_COUNTS = np.array(sorted({round(1.3**k) for k in range(27)}))  # of points along a side: few different ones, to 917
_AT_ONCE = 1 << 17  # points, or faces
_TURN = (-0.7373688780783197, 0.6754902942615238)  # cosine and sine of the golden angle


@arguments(scene=Scene, ground=flag)
def with_look(
    scene: Scene,
    look: Look,
    *,
    ground: bool = True,
    contact_shadow: bool | Texture = True,
    up: Up | None = None,
    settings: Settings | None = None,
) -> Scene:
    """Return the scene as a look shows it.

    Parameters
    ----------
    scene : Scene
        What is shown, in the pose in which it touches the ground.
    look : {"studio", "plain", "course"}
        `studio`: preset pbr, lit by an environment alone, its own or the built-in studio, before a
        light neutral background, on a ground, the last mesh, with a contact shadow. `course`: preset course.
        `plain`: the scene as it is.
    ground : bool, default True
        Whether the studio has a ground.
    contact_shadow : bool or Texture, default True
        Whether the scene darkens it; False for one that will move. The texture of a ground that it
        darkened before saves computing it again.
    up : {"x", "y", "z", "-x", "-y", "-z"}, optional
        Axis that points up. Default: the one nearest to the camera's.
    settings : Settings, optional
        How it will be drawn, for the color of the ground towards its edge. Default: as its preset says.

    Notes
    -----
    The contact shadow is the ground's ambient occlusion: the share of the rays up to a bounding radius
    that meet the scene, on a grid of 1/160 of that radius, in an image of 128x128 texels that is smoothed
    over two texels to each side: in scenes tried a share is off by 0.004 to 0.01 (RMS) from one of exact
    rays. It is computed once, so that frames cost no more.
    """
    choice("with_look", "look", look, LOOKS)
    if look == "plain":
        return scene
    if look == "course":
        return replace(scene, preset="course")
    up = up_of(scene.camera) if up is None else up
    choice("with_look", "up", up, tuple(UPS))
    environment = scene.environment or studio(tuple(np.array(UPS[up][1], np.float64).tolist()))
    scene = replace(scene, preset="pbr", environment=environment, own_lights=False, background=BACKGROUND)
    if not ground:
        return scene
    scene = with_ground(scene, up, settings, gray=_GRAY)
    if contact_shadow is False or not objects_of(scene).face_count:
        return scene
    return _with_contact_shadow(scene, up, None if contact_shadow is True else contact_shadow)


def has_ground(look: Look, edges: object = None) -> bool:
    """Whether a look has a ground on the command line: the studio, unless edges are drawn, which its own would join."""
    return look == "studio" and not edges


def with_lights(scene: Scene, chosen: Sequence[int], option: str = "lights") -> Scene:
    """Return the scene with only the lights of these indices, its own from now on. Raises InputError, naming `option`,
    for an index that it lacks."""
    for index in chosen:
        if not scene.lights:
            raise InputError(f"{option}: the scene has no lights")
        if not 0 <= index < len(scene.lights):
            raise InputError(f"{option}: expected indices from 0 to {len(scene.lights) - 1}, found {index}")
    return replace(scene, lights=tuple(scene.lights[i] for i in dict.fromkeys(chosen)), own_lights=True)


def scaled_lights(scene: Scene, factors: Sequence[float], option: str = "light intensity") -> Scene:
    """Return the scene with its lights' intensities multiplied by `factors`, at least 0: one for each light, or one for all.
    Raises InputError, naming `option`."""
    count = len(scene.lights)
    if len(factors) not in (1, count):
        expected = f"one factor, or {count}: one for each light" if count > 1 else "one factor"
        raise InputError(f"{option}: expected {expected}, found {len(factors)}")
    scales = [number("scene", option, factor, least=0.0) for factor in factors]
    scales = scales * count if len(scales) == 1 else scales
    lights = zip(scene.lights, scales, strict=True)
    return replace(scene, lights=tuple(replace(light, intensity=light.intensity * scale) for light, scale in lights))


def sized_lights(scene: Scene, radius: float, option: str = "light radius") -> Scene:
    """Return the scene with spheres of this radius, scene units, for its point lights. Raises InputError, naming `option`,
    for a radius below 0 or a scene without point lights."""
    size = number("scene", option, radius, least=0.0)
    if not any(isinstance(light, PointLight) for light in scene.lights):
        raise InputError(f"{option}: the scene has no point lights")
    lights = (replace(light, radius=size) if isinstance(light, PointLight) else light for light in scene.lights)
    return replace(scene, lights=tuple(lights))


def _with_contact_shadow(scene: Scene, up: Up, shadow: Texture | None) -> Scene:
    """Return the scene with the shadow, if it is known, of what stands on its ground, the last mesh."""
    *others, ground = scene.meshes
    axes = np.array(UPS[up], np.float64)
    _, radius = bounding_sphere(objects_of(scene).meshes)
    middle = ground.verts[0].astype(np.float64)
    right, away = axes[0], -axes[2]
    if shadow is None:
        image = np.repeat(_share_of_light(scene, middle, right, away, radius)[..., None], 3, axis=2)
        shadow = Texture(image, "clamp", name="contact shadow")
    place = (ground.verts - middle) / (2.0 * _REACH * radius)
    uvs = 0.5 + np.stack([place @ right, place @ away], axis=1)
    material = replace(ground.material, texture=shadow)
    return replace(scene, meshes=(*others, replace(ground, uvs=uvs, material=material)))


def _share_of_light(scene: Scene, middle: Floats, right: Floats, away: Floats, radius: float) -> Floats:
    """Return the share of the light from above that reaches the ground around its middle, (_TEXELS, _TEXELS): rows go along
    `away`, columns along `right`. radius: of the bounding sphere of what stands there."""
    unit = 2.0 * _REACH * radius / _TEXELS
    axes = np.stack([right, away, np.cross(right, away)]) * (_FINE / unit)
    open_ = _open_sky(objects_of(scene).meshes, middle - 0.5 * _TEXELS * unit * (right + away), axes)
    for axis in (0, 1):
        padded = np.pad(open_, [(2, 2) if k == axis else (0, 0) for k in (0, 1)], constant_values=1.0)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=axis)
        open_ = windows @ _SMOOTHING
    at = np.linspace(-1.0, 1.0, _TEXELS)  # on the border there is no shadow: its texels are repeated outside
    x = np.clip((1.0 - np.sqrt(at[:, None] ** 2 + at * at)) / (1.0 - _FADE), 0.0, 1.0)
    return np.asarray(1.0 - (1.0 - open_) * x * x * (3.0 - 2.0 * x))


def _open_sky(meshes: Sequence[Mesh], origin: Floats, axes: Floats) -> Floats:
    """Return the cosine-weighted visibility of the sky from squares of the ground, (_TEXELS, _TEXELS), rows along axes[1].

    meshes: no further than _LENGTH from the ground's middle. origin: the corner of the first square. axes: (3, 3), along the
    rows of squares, along their columns, and up, all along axes of the world; their length is the cells to a scene unit.
    """
    opaque, translucent = _Grid(bool), None
    for mesh, corners in _surfaces(meshes, origin, axes):
        if mesh is None:
            opaque.mark(corners)
        else:
            translucent = translucent or _Grid(np.float32)
            translucent.mark(corners, mesh)
    total = np.zeros((_TEXELS, _TEXELS), np.float32)
    for direction in _directions():
        visible = ~opaque.hidden(direction)
        total += visible * translucent.transmittance(direction) if translucent else visible
    return total.astype(np.float64) / _RAYS


def _directions() -> Floats:
    """Return unit vectors above the plane z = 0, (_RAYS, 3), distributed as the cosine of the angle to its normal: one to
    each ring of equal area, turned by the golden angle."""
    share = (np.arange(_RAYS) + 0.5) / _RAYS
    turn, directions = (1.0, 0.0), np.empty((_RAYS, 3))
    for row, radius, height in zip(directions, np.sqrt(share), np.sqrt(1.0 - share), strict=True):
        row[:] = radius * turn[0], radius * turn[1], height
        turn = turn[0] * _TURN[0] - turn[1] * _TURN[1], turn[0] * _TURN[1] + turn[1] * _TURN[0]
    return directions


def _surfaces(meshes: Sequence[Mesh], origin: Floats, axes: Floats) -> Iterator[tuple[Mesh | None, Floats32]]:
    """Yield corners of triangles, not many more than _AT_ONCE: their places in cells, (F, 3, 3); of a translucent mesh with
    the mesh, and u, v and alpha, (F, 3, 6)."""
    pool: list[Floats32] = []
    for mesh in meshes:
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
    placements, uv_faces = mesh.instances, mesh.faces if mesh.uv_faces is None else mesh.uv_faces
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
    for code, alike in zip(kinds.tolist(), np.split(order, starts[1:]), strict=True):
        i, j = (_COUNTS[k] for k in divmod(code, len(_COUNTS)))
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
    that the rays of neighboring squares meet at a step are a slice. The last layer is for everything higher."""

    def __init__(self, kind: type) -> None:
        self._cells: Array = np.zeros((_HIGH + 1, _FINE, _FINE, _SIDE, _SIDE), kind)
        self._counts = np.zeros(self._cells.shape if kind is not bool else 0, np.float32)

    def mark(self, corners: Floats32, mesh: Mesh | None = None) -> None:
        """Mark the cells that triangles touch; of a translucent mesh with sums of its alpha."""
        cells, counts = self._cells.reshape(-1), self._counts.reshape(-1)
        with np.errstate(over="ignore", invalid="ignore"):  # of texture coordinates beyond float32
            for points in _points(corners[corners[:, :, 2].min(axis=1) < _HIGH]):
                x, y = (np.clip(v - _FIRST * _FINE, 0, _SIDE * _FINE - 1).astype(np.int32) for v in points[:2])
                z = np.clip(points[2], 0, _HIGH).astype(np.int32)
                layer = (z * _FINE + y % _FINE) * _FINE + x % _FINE
                touched = (layer * _SIDE + y // _FINE) * _SIDE + x // _FINE
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
        steps = (np.arange(int(_HIGH * longest)) + 0.5) / longest
        x, y, z = np.floor(np.array([_FINE / 2, _FINE / 2, 0.0]) + steps[:, None] * direction).astype(int).T
        x, y = x - _FIRST * _FINE, y - _FIRST * _FINE
        return np.stack([y // _FINE, x // _FINE, (z * _FINE + y % _FINE) * _FINE + x % _FINE])

    @cached_property
    def _masks(self) -> Array:
        """The cells of each layer as an integer: a bit each, with as many zeros after each row of them."""
        packed = np.packbits(self._cells[:-1].reshape(-1, _SIDE, _SIDE), axis=2, bitorder="little")
        rows = np.concatenate([packed, np.zeros_like(packed)], axis=2)
        return np.array([int.from_bytes(row.tobytes(), "little") for row in rows], object)

    def hidden(self, direction: Floats) -> Bools:
        """Return which squares see an occluder in a direction, (_TEXELS, _TEXELS)."""
        # Shifting a mask moves its cells by rows and columns: none comes further than the zeros after a row.
        width, first, hidden = 2 * _SIDE, _SIDE // 2 - _FIRST, 0
        row, column, layer = self._steps(direction)
        shift = (first - row) * width + first - column
        for mask, places in zip(self._masks[layer].tolist(), shift.tolist(), strict=True):
            hidden |= mask << places
        packed = np.frombuffer(hidden.to_bytes(width * width // 8, "little"), np.uint8)
        squares = np.unpackbits(packed, bitorder="little").reshape(width, width).view(bool)
        return squares[first : first + _TEXELS, first : first + _TEXELS]

    @cached_property
    def _opacities(self) -> dict[int, Array]:
        """The mean alphas of the points in cells, (side, side), by layer, of those that surfaces touch."""
        layers, counts = (cells.reshape(-1, _SIDE, _SIDE) for cells in (self._cells[:-1], self._counts))
        touched = np.flatnonzero(layers.any(axis=(1, 2))).tolist()
        return {number: layers[number] / np.maximum(counts[number], 1.0) for number in touched}

    def transmittance(self, direction: Floats) -> Floats32:
        """Return the share of light that arrives from a direction. A surface counts where a ray enters its cells."""
        passed, before = np.ones((_TEXELS, _TEXELS), np.float32), np.zeros((_TEXELS, _TEXELS), np.float32)
        for row, column, layer in self._steps(direction).T.tolist():
            now = np.zeros_like(before)
            if layer in self._opacities:
                top, left = max(0, -row), max(0, -column)
                cells = self._opacities[layer][top + row : _TEXELS + row, left + column : _TEXELS + column]
                now[top : top + len(cells), left : left + cells.shape[1]] = cells
                passed *= 1.0 - np.maximum(now - before, 0.0)
            before = now
        return passed
