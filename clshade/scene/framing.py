"""Default camera and lights for meshes that have none: chosen from the bounding box, the same for every format."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ..base.arrays import Array, Floats
from . import geometry
from .camera import Camera
from .model import Mesh, PointLight, Scene

FOV = 35.0  # degrees, vertical
MARGIN = 1.05  # of the bounding sphere
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
_TOWARDS_EYE = (0.55, 0.42, 1.0)  # from the object: from the right, a little above

# Position in the camera's axes (right, up, towards the camera), in bounding radii from the center, and linear RGB.
_LIGHTS = (
    ((-2.4, 2.6, 3.0), (0.85, 0.82, 0.77)),  # key
    ((3.6, 0.4, 2.2), (0.24, 0.27, 0.33)),  # fill
    ((1.6, 3.0, -3.2), (0.55, 0.55, 0.58)),  # rim
)


def framed(
    meshes: tuple[Mesh, ...],
    name: str,
    resolution: tuple[int, int] | None = None,
    *,
    up: Up = "y",
    camera: Camera | None = None,
    lights: tuple[PointLight, ...] = (),
    sphere: tuple[Array, float] | None = None,
) -> Scene:
    """Return a `standard` scene of the meshes in a three-quarter view, with their bounding sphere inside the image.

    resolution: (N, M), default RESOLUTION. up: one of UPS, the axis of world space that points up in the image.
    camera, lights: used instead of the default ones. sphere: see bounding_sphere, if known.
    The default lights, key, fill and rim, are placed relative to the camera.
    Raises InputError where positions leave the range of float64.
    """
    center, radius = sphere or bounding_sphere(meshes)
    if camera is None:
        camera = _camera(center, radius, up, resolution or RESOLUTION)
    if not lights:
        right, upward, forward = geometry.camera_axes(camera)
        axes = np.stack([right, upward, -forward])
        with np.errstate(over="ignore"):  # PointLight refuses an overflow
            places = [center + radius * (np.array(place) @ axes) for place, _ in _LIGHTS]
        lights = tuple(PointLight(at, np.array(light)) for at, (_, light) in zip(places, _LIGHTS, strict=True))
    return Scene(meshes, camera, lights, np.full(3, AMBIENT), np.full(3, BACKGROUND), "standard", name)


def _camera(center: Array, radius: float, up: Up, resolution: tuple[int, int]) -> Camera:
    """Return the camera of the three-quarter view."""
    axes = np.array(UPS[up], np.float64)
    towards = (np.array(_TOWARDS_EYE) / math.hypot(*_TOWARDS_EYE)) @ axes
    camera = Camera.from_fov(center + towards * radius, center, axes[1], FOV, resolution)
    half_angle = math.atan(min(camera.plane) / 2.0)
    with np.errstate(over="ignore"):
        return replace(camera, eye=center + towards * (MARGIN * radius / math.sin(half_angle)))


def bounding_sphere(meshes: tuple[Mesh, ...]) -> tuple[Array, float]:
    """Return center and radius of the sphere around the bounding box; a radius of 0 is replaced by a positive one."""
    eye, lookat, up = np.array([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0, 0.0])
    unframed = Scene(meshes, Camera(eye, lookat, up, 1.0, (1.0, 1.0)))
    low, high = geometry.bounding_box(unframed)
    return sphere_of_box(low, high)


def sphere_of_box(low: Floats, high: Floats) -> tuple[Floats, float]:
    """Return center and radius of the sphere around a box; a radius of 0 is replaced by a positive one."""
    center, radius = low / 2 + high / 2, geometry.half_diagonal(low, high)
    if radius == 0.0:
        largest = float(np.abs(center).max())
        radius = 1e-3 * largest if largest else 1.0
    return center, radius
