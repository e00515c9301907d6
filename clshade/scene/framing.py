"""Default camera and lights for meshes that have none, the same for every format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from ..base.arrays import Array
from . import geometry
from .camera import Camera
from .fitting import bounding_sphere, fitted
from .model import Light, Mesh, PointLight, Scene

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


def framed(
    meshes: tuple[Mesh, ...],
    name: str,
    resolution: tuple[int, int] | None = None,
    *,
    up: Up = "y",
    camera: Camera | None = None,
    lights: tuple[Light, ...] = (),
    sphere: tuple[Array, float] | None = None,
) -> Scene:
    """Return a `standard` scene of the meshes in a three-quarter view that shows all of them (see `fitting`).

    resolution: (N, M), default RESOLUTION. up: one of UPS, the axis of world space that points up in the image.
    camera, lights: used instead of the default ones. sphere: see bounding_sphere, if known.
    The default lights, key, fill and rim, are placed relative to the camera.
    Raises InputError where positions leave the range of float64.
    """
    center, radius = sphere = sphere or bounding_sphere(meshes)
    chosen, own_lights = camera is None, bool(lights)
    camera = camera or default_camera(meshes, up, resolution, sphere)
    if not lights:
        # Those of a chosen camera before it is fitted: they are the same for images of any shape, to the last bit.
        of = Camera.from_fov(_TOWARDS_EYE @ np.array(UPS[up]), np.zeros(3), UPS[up][1], FOV) if chosen else camera
        right, upward, forward = geometry.camera_axes(of)
        axes = np.stack([right, upward, -forward])
        with np.errstate(over="ignore"):  # PointLight refuses an overflow
            places = [center + radius * (np.array(place) @ axes) for place, _ in _LIGHTS]
        lights = tuple(PointLight(at, np.array(light)) for at, (_, light) in zip(places, _LIGHTS, strict=True))
    return Scene(meshes, camera, lights, AMBIENT, BACKGROUND, name=name, own_lights=own_lights, fitted=chosen)


def default_camera(
    meshes: Sequence[Mesh],
    up: Up = "y",
    resolution: tuple[int, int] | None = None,
    sphere: tuple[Array, float] | None = None,
) -> Camera:
    """Return the camera of the three-quarter view, fitted to the meshes. Arguments as for `framed`."""
    center, radius = sphere or bounding_sphere(meshes)
    axes = np.array(UPS[up], np.float64)
    towards = (np.array(_TOWARDS_EYE) / math.hypot(*_TOWARDS_EYE)) @ axes
    with np.errstate(over="ignore"):
        camera = Camera.from_fov(center + towards * radius, center, axes[1], FOV, resolution or RESOLUTION)
    return fitted(camera, meshes, sphere=(center, radius))


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
