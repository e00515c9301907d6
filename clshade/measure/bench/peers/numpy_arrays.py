"""A renderer in vectorized NumPy, float32: triangles become scanline spans, spans become pixels, and the nearest
triangle of each pixel is lit.

Loops run over chunks of triangles or pixels that fit a cache, never over single ones. Vectors are arrays of
components, (3, K).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ....base.arrays import Array, Floats32
from ....errors import InputError
from ....scene.camera import Camera
from ....scene.lights import plain_lights
from ....scene.model import Scene
from .arrays import depths, mesh_arrays, view_axes

FRAGMENTS = 1 << 17  # fragments processed together
PIXELS = 1 << 13  # pixels lit together
EDGES = ((1, 2), (2, 0), (0, 1))  # edge k is opposite to corner k
HALF = np.float32(0.5)


@dataclass(frozen=True)
class Projected:
    """Projected triangles.

    x, y: (3, F) corners in the image, in pixels, y up, counter-clockwise. w: (3, F), 1/depth. area: (F,), twice the
    area. corners: (3, F), the vertices in this order.
    """

    x: Array
    y: Array
    w: Array
    area: Array
    corners: Array


@dataclass(frozen=True)
class Spans:
    """Scanline spans: triangle, row, first column and number of pixels, (S,) int32 each."""

    triangle: Array
    row: Array
    first: Array
    count: Array


class Vectorized:
    """Renderer of one mesh without texture."""

    title, once = f"NumPy {np.__version__}, whole arrays", False

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        mesh = mesh_arrays(scene)
        if mesh.uvs is not None:
            raise InputError("bench: numpy: expected a scene without texture")
        depths(mesh.verts, scene.camera)
        self._verts, self._normals, self._colors, self._faces = (
            np.ascontiguousarray(table.T) for table in (mesh.verts, mesh.normals, mesh.colors, mesh.faces)
        )
        self._ambient = _float32(mesh.material.ka * scene.ambient)
        self._kd, self._ks = _float32(mesh.material.kd), _float32(mesh.material.ks)
        self._exponent = np.float32(mesh.material.n)
        columns, rows = self._size = scene.camera.resolution
        background = np.zeros(3) if scene.background is None else scene.background
        self._background = _float32([*background, 0.0])
        self._image = np.empty((rows, columns, 4), np.float32)
        self._nearest = np.empty(rows * columns, np.float32)
        self._owner = np.empty(rows * columns, np.int32)

    def draw(self, camera: Camera) -> Array:
        self._image[:] = self._background
        self._nearest[:] = 0.0
        self._owner[:] = -1
        triangles = self._project(camera)
        self._fill(triangles, self._spans(triangles))
        covered = np.flatnonzero(self._owner >= 0)
        for start in range(0, len(covered), PIXELS):
            self._light(triangles, camera, covered[start : start + PIXELS])
        return self._image[::-1]

    def depth(self) -> Array:
        """Return the depth of what `draw` has drawn, (M, N), +inf where nothing is."""
        with np.errstate(divide="ignore"):
            z: Array = np.float32(1.0) / self._nearest.reshape(self._image.shape[:2])[::-1]
        return z

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _project(self, camera: Camera) -> Projected:
        axes, scale = view_axes(camera)
        moved = _float32(axes) @ (self._verts - _float32(camera.eye)[:, None])
        w = 1.0 / moved[2]
        x, y = ((np.float32(0.5 * scale[k]) * moved[k] * w + HALF) * np.float32(self._size[k]) for k in range(2))
        a, b, c = self._faces
        area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
        kept = np.flatnonzero(area)
        corners = np.where(area > 0.0, self._faces, self._faces[::-1])[:, kept]
        return Projected(x[corners], y[corners], w[corners], np.abs(area[kept]), corners)

    def _spans(self, t: Projected) -> Spans:
        columns, rows = self._size
        low = np.maximum(np.ceil(t.y.min(axis=0) - HALF), 0).astype(np.int32)
        high = np.minimum(np.ceil(t.y.max(axis=0) - HALF), rows).astype(np.int32)
        left, right = np.maximum(t.x.min(axis=0), 0), np.minimum(t.x.max(axis=0), np.float32(columns))
        height = np.where(right > left, np.maximum(high - low, 0), 0)
        triangle = np.repeat(np.arange(len(height), dtype=np.int32), height)
        row = _counted(low, height)
        y = row.astype(np.float32) + HALF
        left, right = left[triangle], right[triangle]
        for i, j in EDGES:
            up = t.y[j] - t.y[i]
            slope = np.divide(t.x[j] - t.x[i], up, out=np.zeros_like(up), where=up != 0.0)
            bound = t.x[i][triangle] + slope[triangle] * (y - t.y[i][triangle])
            up = up[triangle]  # counter-clockwise: ascending edges are on the right
            right = np.where(up > 0.0, np.minimum(right, bound), right)
            left = np.where(up < 0.0, np.maximum(left, bound), left)
        first = np.ceil(left - HALF).astype(np.int32)
        count = np.ceil(right - HALF).astype(np.int32) - first
        kept = np.flatnonzero(count > 0)
        return Spans(triangle[kept], row[kept], first[kept], count[kept])

    def _fill(self, t: Projected, spans: Spans) -> None:
        """Find the nearest triangle of each pixel. 1/depth is linear in the image."""
        columns, _ = self._size
        dx, dy, dw = (each[1:] - each[0] for each in (t.x, t.y, t.w))
        slope_x = (dw[0] * dy[1] - dw[1] * dy[0]) / t.area
        slope_y = (dx[0] * dw[1] - dx[1] * dw[0]) / t.area
        k = spans.triangle
        x, y = (each.astype(np.float32) + HALF for each in (spans.first, spans.row))
        begin = t.w[0][k] + slope_x[k] * (x - t.x[0][k]) + slope_y[k] * (y - t.y[0][k])
        slope = slope_x[k]
        first_pixel = spans.row * columns + spans.first
        chunk = np.cumsum(spans.count, dtype=np.int64) // FRAGMENTS
        cuts = [0, *(np.flatnonzero(np.diff(chunk)) + 1).tolist(), len(chunk)]
        for start, stop in itertools.pairwise(cuts):
            part = slice(start, stop)
            count = spans.count[part]
            step = _counted(np.zeros_like(count), count)
            w = np.repeat(begin[part], count) + np.repeat(slope[part], count) * step.astype(np.float32)
            pixel = np.repeat(first_pixel[part], count) + step
            np.maximum.at(self._nearest, pixel, w)
            won = np.flatnonzero(w == self._nearest[pixel])
            self._owner[pixel[won]] = np.repeat(k[part], count)[won]

    def _light(self, t: Projected, camera: Camera, pixels: Array) -> None:
        columns, _ = self._size
        which = self._owner[pixels]
        x, y = (each.astype(np.float32) + HALF for each in (pixels % columns, pixels // columns))
        dx, dy = t.x.take(which, 1) - x, t.y.take(which, 1) - y
        weights = np.stack([dx[i] * dy[j] - dy[i] * dx[j] for i, j in EDGES]) * t.w.take(which, 1)
        weights /= weights.sum(axis=0)
        corners = t.corners.take(which, 1)
        position, normal, color = (
            np.stack([(weights * component[corners]).sum(axis=0) for component in table])
            for table in (self._verts, self._normals, self._colors)
        )
        normal, to_eye = _unit(normal), _unit(_float32(camera.eye)[:, None] - position)
        total = np.repeat(self._ambient[:, None], len(pixels), axis=1)
        for light in plain_lights("bench", self.scene.lights):
            to_light = _unit(_float32(light.position)[:, None] - position)
            cosine = _dot(normal, to_light)
            towards = np.maximum(_dot(2.0 * cosine * normal - to_light, to_eye), 0.0)
            highlight = np.where(cosine > 0.0, towards**self._exponent, 0.0)
            lambert = np.maximum(cosine, 0.0)
            for channel, intensity in enumerate(_float32(light.intensity)):
                total[channel] += intensity * (self._kd[channel] * lambert + self._ks[channel] * highlight)
        image = self._image.reshape(-1, 4)
        image[pixels, :3] = (total * color).T
        image[pixels, 3] = 1.0


def _float32(values: object) -> Array:
    return np.asarray(values, np.float32)


def _counted(first: Array, count: Array) -> Array:
    """Return the concatenation of the ranges first[i], ..., first[i] + count[i] - 1."""
    ends = np.cumsum(count, dtype=np.int32)
    total = int(ends[-1]) if len(ends) else 0
    return np.repeat(first - (ends - count), count) + np.arange(total, dtype=np.int32)


def _dot(a: Array, b: Array) -> Floats32:
    product: Floats32 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _unit(vectors: Array) -> Array:
    """Normalize vectors; zero vectors stay zero."""
    squares = _dot(vectors, vectors)
    return vectors / np.sqrt(np.where(squares > 0.0, squares, np.float32(1.0)))


def open_for(name: str, scene: Scene) -> Vectorized:
    return Vectorized(scene)
