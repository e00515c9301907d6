"""Cameras that show all of some meshes, and lights for meshes that have none, the same for every format.

A camera is fitted to meshes in its direction: its eye moves so that all vertices fill FILL of the image. With a perspective
camera that is a closed form. In the camera's axes x, y, z (z forward), with tx and ty the tangents of FILL of the half field
of view, an eye e shows the points p in so much of the image if

    |px - ex| <= tx*(pz - ez)  and  |py - ey| <= ty*(pz - ez).

With A = max(px - tx*pz) and B = min(px + tx*pz) the first is A + tx*ez <= ex <= B - tx*ez, so that the nearest eye has
ez = (B - A)/(2*tx), or the like of y where that is less.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ..base.arrays import Array, Floats
from .camera import Camera
from .geometry import bounding_box, camera_axes, half_diagonal, placed_blocks
from .model import Light, Mesh, PointLight, Scene

FILL = 0.9  # of the image's width or height, whichever the vertices reach first
FOV = 35.0  # degrees, vertical
RESOLUTION = (800, 600)
AMBIENT = 0.1  # intensity; materials of mesh files have ka = 1 by default
BACKGROUND = 0.05
# The camera's right, up and backward axes for each axis that may point up, each a rotation of those of y.
Up: TypeAlias = Literal["y", "z", "x", "-y", "-z", "-x"]
UPS: dict[Up, tuple[tuple[int, int, int], ...]] = {
    "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "-y": ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
    "-z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "-x": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
}
_STANDS = 0.01  # of the size along an axis: so near to 0 a mesh stands on it
_PLATE = 0.05  # of the largest size: thinner is a plate, such as a relief, which may face any way
_TALLER = 1.2  # times as large: a mesh that is so along another axis may stand on it
_TOWARDS_EYE = (0.55, 0.42, 1.0)  # from the object: from the right, a little above

# Position in the camera's axes (right, up, towards the camera), in bounding radii from the center, and linear RGB.
_LIGHTS = (
    ((-3.4, 3.4, 1.9), (0.92, 0.88, 0.82)),  # key
    ((3.4, 0.6, 3.0), (0.2, 0.225, 0.28)),  # fill
    ((2.4, 2.6, -3.2), (0.6, 0.6, 0.64)),  # rim
)
_CLEARANCE = 0.25  # minimum distance of the eye from the nearest vertex, bounding radii: a needle may point at it
_THINNEST = 1e-3  # minimum size of a parallel projection, about bounding radii: a line seen end on has none
_ROUNDS = 6  # of centering, at most: two or three are usual
_KEPT = 1 << 22  # vertices, 96 MiB: of more, the positions are computed in each pass

Sphere: TypeAlias = tuple[Floats, float]  # center and radius


def framed(
    meshes: tuple[Mesh, ...],
    name: str,
    resolution: tuple[int, int] | None = None,
    *,
    up: Up = "y",
    camera: Camera | None = None,
    lights: tuple[Light, ...] = (),
    sphere: Sphere | None = None,
) -> Scene:
    """Return a `standard` scene of the meshes, by default in a three-quarter view that shows all of them, and with a key, a
    fill and a rim light that stand relative to the camera.

    resolution: (N, M), default RESOLUTION. up: the axis of world space that points up in the image. sphere: see
    `bounding_sphere`, if known. Raises InputError where positions leave the range of float64.
    """
    center, radius = sphere = sphere or bounding_sphere(meshes)
    chosen, own_lights = camera is None, bool(lights)
    camera = camera or default_camera(meshes, up, resolution, sphere)
    if not lights:
        # Those of a chosen camera before it is fitted: they are the same for images of any shape, to the last bit.
        of = Camera.from_fov(_TOWARDS_EYE @ np.array(UPS[up]), np.zeros(3), UPS[up][1], FOV) if chosen else camera
        axes = camera_axes(of) * [[1.0], [1.0], [-1.0]]
        with np.errstate(over="ignore"):  # PointLight refuses an overflow
            places = [center + radius * (np.array(place) @ axes) for place, _ in _LIGHTS]
        lights = tuple(PointLight(at, np.array(light)) for at, (_, light) in zip(places, _LIGHTS, strict=True))
    return Scene(meshes, camera, lights, AMBIENT, BACKGROUND, name=name, own_lights=own_lights, fitted=chosen)


def default_camera(
    meshes: Sequence[Mesh],
    up: Up = "y",
    resolution: tuple[int, int] | None = None,
    sphere: Sphere | None = None,
) -> Camera:
    """Return the camera of the three-quarter view, fitted to the meshes. Arguments as for `framed`."""
    center, radius = sphere = sphere or bounding_sphere(meshes)
    axes = np.array(UPS[up], np.float64)
    towards = (np.array(_TOWARDS_EYE) / math.hypot(*_TOWARDS_EYE)) @ axes
    with np.errstate(over="ignore"):
        camera = Camera.from_fov(center + towards * radius, center, axes[1], FOV, resolution or RESOLUTION)
    return fitted(camera, meshes, sphere=sphere)


def likely_up(low: Array, high: Array, up: Up) -> Up | None:
    """Return the axis, y or z, that points up by the extents of a mesh, or None if they do not speak against `up`.

    low, high: (3,) corners of the bounding box. up: y or z, the axis that was taken. The other one is likelier where the
    mesh stands on its zero and is no plate, or is _TALLER along it and `up` is not its thinnest axis: flat things lie.
    Neither counts for a mesh that stands on the zero of `up`.
    """
    size = np.asarray(high) - low
    stands = (np.abs(low) <= _STANDS * size) & (size > _PLATE * size.max())
    up_axis, other_axis = (1, 2) if up == "y" else (2, 1)
    if up not in ("y", "z") or stands[up_axis]:
        return None
    tall = size[other_axis] == size.max() and size[other_axis] > _TALLER * size[up_axis] > _TALLER * size.min()
    return ("x", "y", "z")[other_axis] if stands[other_axis] or tall else None


def up_of(camera: Camera) -> Up:
    """Return the axis of world space that is nearest to the camera's up."""
    axis = int(np.argmax(np.abs(camera.up)))
    name = "-" * bool(camera.up[axis] < 0.0) + "xyz"[axis]
    return next(up for up in UPS if up == name)


def bounding_sphere(meshes: Sequence[Mesh]) -> Sphere:
    """Return the sphere around the bounding box of meshes."""
    return sphere_of_box(*bounding_box(meshes))


def sphere_of_box(low: Floats, high: Floats) -> Sphere:
    """Return the sphere around a box; a radius of 0 is replaced by a positive one."""
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
    sphere: Sphere | None = None,
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


def extent(camera: Camera, meshes: Sequence[Mesh], sphere: Sphere) -> tuple[Floats, Floats]:
    """Return from where a parallel projection sees the vertices, and how large they are there: the vector, (3,) in world
    space, from the center of the sphere to the middle of what they fill of the image, and half its width and height, (2,).
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

    def __init__(self, camera: Camera, meshes: Sequence[Mesh], sphere: Sphere, *, turning: bool = False) -> None:
        self._meshes, self._center, self.axes = meshes, sphere[0], camera_axes(camera)
        self.exponent = int(np.frexp(sphere[1])[1])
        up = camera.up / np.abs(camera.up).max()
        self._up = up / np.linalg.norm(up) if turning else None
        few = sum(len(mesh.verts) * len(mesh.instances) for mesh in meshes) <= _KEPT
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
