"""Fit a camera to meshes: its direction and lens stay, and its eye moves so that all vertices are in the image.

They fill FILL of the image. With a perspective camera that is a closed form. In the camera's axes x, y, z (z forward), with
tx and ty the tangents of FILL of the half field of view, an eye e shows the points p in so much of the image if

    |px - ex| <= tx*(pz - ez)  and  |py - ey| <= ty*(pz - ez).

With A = max(px - tx*pz) and B = min(px + tx*pz) the first is A + tx*ez <= ex <= B - tx*ez, so that the nearest eye has
ez = (B - A)/(2*tx), or the like of y where that is less.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..base.arrays import Array, Floats
from .camera import Camera
from .geometry import bounding_box, camera_axes, half_diagonal, placed_blocks
from .model import Mesh, Scene

FILL = 0.9  # of the image's width or height, whichever the vertices reach first
_CLEARANCE = 0.25  # minimum distance of the eye from the nearest vertex, bounding radii: a needle may point at it
_THINNEST = 1e-3  # minimum size of a parallel projection, about bounding radii: a line seen end on has none
_ROUNDS = 6  # of centering, at most: two or three are usual

_KEPT = 1 << 22  # vertices, 96 MiB: of more, the positions are computed in each pass


def bounding_sphere(meshes: Sequence[Mesh]) -> tuple[Array, float]:
    """Return center and radius of the sphere around the bounding box; a radius of 0 is replaced by a positive one."""
    eye, lookat, up = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0, 0.0])
    return sphere_of_box(*bounding_box(Scene(meshes, Camera(eye, lookat, up, 1.0, (1.0, 1.0)))))


def sphere_of_box(low: Floats, high: Floats) -> tuple[Floats, float]:
    """Return center and radius of the sphere around a box; a radius of 0 is replaced by a positive one."""
    center, radius = low / 2 + high / 2, half_diagonal(low, high)
    if radius == 0.0:
        largest = float(np.abs(center).max())
        radius = 1e-3 * largest if largest else 1.0
    return center, radius


def fitted(
    camera: Camera,
    meshes: Sequence[Mesh],
    *,
    turning: bool = False,
    orthographic: bool = False,
    sphere: tuple[Array, float] | None = None,
) -> Camera:
    """Return a perspective camera with its eye moved so that all vertices fill FILL of the image's width or height.

    Direction, lens and resolution stay; the viewing direction meets the image in its center. The camera looks at the
    middle of the meshes' depths.
    turning: fit what the vertices sweep as the camera goes round their bounding box about its `up`, so that no frame of
        a turntable cuts anything; it looks at the center of the box.
    orthographic: fit the parallel projection that `adjust_camera.adjusted` makes of this camera.
    sphere: see `bounding_sphere`, if known.
    Raises InputError where positions leave the range of float64.
    """
    center, radius = sphere = sphere or bounding_sphere(meshes)
    body = _Body(camera, meshes, sphere, turning=turning)
    nearest, farthest = body.farthest(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))[:, 2].tolist()
    clear = nearest - float(np.ldexp(_CLEARANCE * radius, -body.exponent))
    tangents = FILL / 2.0 * np.array(camera.plane[::-1]) / camera.focal  # of x and y
    middle = 0.0 if turning else (nearest + farthest) / 2.0
    if orthographic:
        # Away: where a perspective camera with these tangents sees as much.
        spans = body.spans
        place = np.zeros(2) if turning else spans.mean(axis=1)
        away = max(float((np.abs(spans - place[:, None]).max(axis=1) / tangents).max()), _THINNEST)
        depth = min(clear, middle - away)
        target = np.array([*place, depth + away])
    else:
        place, depth = _perspective_eye(body, tangents, clear, centered=not turning)
        target = np.array([*place, middle])
    with np.errstate(over="ignore"):  # Camera refuses an overflow
        lookat = center + np.ldexp(target, body.exponent) @ body.axes
        eye = lookat - np.ldexp(target[2] - depth, body.exponent) * body.axes[2]
    return replace(camera, eye=eye, lookat=lookat, principal=(0.5, 0.5), orthographic=False)


def extent(camera: Camera, meshes: Sequence[Mesh], sphere: tuple[Array, float]) -> tuple[Floats, Floats]:
    """Return from where a parallel projection sees the vertices, and how large they are there.

    The first is the vector from the center of the sphere to the middle of the image's part that they fill, (3,) in
    world space; the second is half of its width and height, (2,) in scene units.
    """
    body = _Body(camera, meshes, sphere)
    aside, half = body.spans.mean(axis=1) @ body.axes[:2], (body.spans[:, 1] - body.spans[:, 0]) / 2.0
    return np.ldexp(aside, body.exponent), np.ldexp(half, body.exponent)


def _perspective_eye(body: _Body, tangents: Floats, clear: float, *, centered: bool) -> tuple[Floats, float]:
    """Return x and y of a perspective camera's eye, and its z, at most `clear`. centered: move x and y."""
    limits = []
    for axis, tangent in enumerate(tangents):
        low, high = body.ends(axis, tangent)
        limits.append((high[axis] - tangent * high[2], low[axis] + tangent * low[2]))  # A and B
    if not centered:
        return np.zeros(2), min(clear, *(min(-a, b) / t for (a, b), t in zip(limits, tangents, strict=True)))
    depth = min(clear, *((b - a) / (2.0 * t) for (a, b), t in zip(limits, tangents, strict=True)))
    return np.array([_centered(body, axis, *limits[axis], tangents[axis], depth) for axis in range(2)]), depth


def _centered(body: _Body, axis: int, a: float, b: float, tangent: float, depth: float) -> float:
    """Return the eye's x or y for which the ends of the body are equally far from the image's center.

    By Newton's method for the tangent at which they are seen: each round takes the points that are the ends at the
    tangent of the last. a, b: A and B at the tangent that the ends may not exceed.
    """
    low, high = a + tangent * depth, b - tangent * depth
    place = (low + high) / 2.0
    for _ in range(_ROUNDS if high > low else 0):
        first, last = body.ends(axis, tangent)
        before, behind = first[2] - depth, last[2] - depth
        better = (last[axis] * before + first[axis] * behind) / (before + behind)
        if better == place:
            break
        place, tangent = better, (last[axis] - first[axis]) / (before + behind)
    return float(min(max(place, low), high)) if high > low else place


class _Body:
    """The vertices of meshes about the center of a sphere, over 2^exponent; or the circles about a camera's `up` that they
    run through as it goes round, if it is turning."""

    def __init__(
        self, camera: Camera, meshes: Sequence[Mesh], sphere: tuple[Array, float], *, turning: bool = False
    ) -> None:
        self._meshes, self._center, self.axes = meshes, sphere[0], camera_axes(camera)
        self.exponent = int(np.frexp(sphere[1])[1])
        self._up = camera.up / np.abs(camera.up).max() if turning else None
        if self._up is not None:
            self._up = self._up / np.linalg.norm(self._up)
        few = sum(len(mesh.verts) * len(np.asarray(mesh.instances)) for mesh in meshes) <= _KEPT
        self._kept = list(self._scaled()) if few else None

    def _scaled(self) -> Iterator[Floats]:
        """Yield the vertices, (3, K)."""
        half, up = self._center[:, None] / 2.0, 1 - self.exponent
        for block in placed_blocks(self._meshes):
            points = 0.5 * block - half
            yield np.ldexp(points, up) if abs(up) > 1000 else points * 2.0**up

    def farthest(self, directions: Floats) -> Floats:
        """Return the points that are farthest along directions, (K, 3) each, both in the camera's axes."""
        towards, blocks, up = directions @ self.axes, self._scaled() if self._kept is None else self._kept, self._up
        if up is None:
            return np.asarray(_farthest(blocks, towards) @ self.axes.T)
        rise = towards @ up
        aside = towards - rise[:, None] * up
        length = np.linalg.norm(aside, axis=1)
        circles = (_radius_and_height(points, up) for points in blocks)
        ends = _farthest(circles, np.stack([length, rise], axis=1))
        places = ends[:, :1] * aside / np.where(length, length, 1.0)[:, None] + ends[:, 1:] * up
        return np.asarray(places @ self.axes.T)

    def ends(self, axis: int, tangent: float) -> Floats:
        """Return the points with the minimum of p[axis] + tangent*pz and the maximum of p[axis] - tangent*pz, (2, 3)."""
        directions = np.zeros((2, 3))
        directions[:, axis], directions[:, 2] = (-1.0, 1.0), -tangent
        return self.farthest(directions)

    @property
    def spans(self) -> Floats:
        """The minimum and maximum of x, and of y, (2, 2)."""
        return np.array([self.ends(axis, 0.0)[:, axis] for axis in range(2)])


def _radius_and_height(points: Floats, unit: Floats) -> Floats:
    height = (unit[0] * points[0] + unit[1] * points[1]) + unit[2] * points[2]
    return np.stack([np.linalg.norm(points - unit[:, None] * height, axis=0), height])


def _farthest(blocks: Iterable[Floats], weights: Floats) -> Floats:
    """Return for each row of weights (K, C) the column of the blocks, (C, n) each, with the greatest product, (K, C).

    The products are sums in a fixed order: equal on every machine.
    """
    best, farthest = np.full(len(weights), -np.inf), np.zeros(weights.shape)
    for block in blocks:
        for row, weight in enumerate(weights):
            along = weight[0] * block[0]
            for factor, coordinate in zip(weight[1:], block[1:], strict=True):
                along += factor * coordinate
            at = int(along.argmax())
            if along[at] > best[row]:
                best[row], farthest[row] = along[at], block[:, at]
    return farthest
