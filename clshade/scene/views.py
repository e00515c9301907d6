"""Named views of a scene, as in a technical drawing: parallel projections along its axes, all of one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..base.arrays import Array, Floats
from ..base.validation import choice
from . import geometry
from .camera import Camera, checked_resolution
from .framing import UPS, Up, sphere_of_box
from .model import Scene

MARGIN = 1.1  # of the bounding box
CAMERA = "camera"  # the scene's own view
_DISTANCE = 2.0  # of the eye from the center, bounding radii: in a parallel projection any outside will do
# The direction from the center to the eye, and what points up in the image: each as right, up and backward.
_VIEWS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "front": ((0, 0, 1), (0, 1, 0)),
    "back": ((0, 0, -1), (0, 1, 0)),
    "left": ((-1, 0, 0), (0, 1, 0)),
    "right": ((1, 0, 0), (0, 1, 0)),
    "top": ((0, 1, 0), (0, 0, -1)),
    "bottom": ((0, -1, 0), (0, 0, 1)),
    "iso": ((1, 1, 1), (0, 1, 0)),
}
VIEWS = (*_VIEWS, CAMERA)


def up_of(camera: Camera) -> Up:
    """Return the axis of world space that is nearest to the camera's up."""
    axis = int(np.argmax(np.abs(camera.up)))
    found: dict[str, Up] = {str(up): up for up in UPS}
    return found["-" * bool(camera.up[axis] < 0.0) + "xyz"[axis]]


def named_cameras(scene: Scene, names: Sequence[str], resolution: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Return a camera for each name, in this order.

    names: of VIEWS. `camera` is the scene's own; all others are parallel projections that show the whole bounding box,
    all of one scale: the largest at which each fits. The axis nearest to the camera's up points up; `front` is seen
    from +z where that is y, from -y where it is z (`framing.UPS`).
    resolution: (N, M); default: the scene's camera's.
    Raises InputError for another name, and where a position overflows.
    """
    for name in names:
        choice("named_cameras", "names", name, VIEWS)
    resolution = scene.camera.resolution if resolution is None else checked_resolution("named_cameras", resolution)
    columns, rows = resolution
    low, high = geometry.bounding_box(scene)
    center, radius = sphere_of_box(low, high)
    axes = np.array(UPS[up_of(scene.camera)], np.float64)
    found, height = {}, 0.0
    for name in dict.fromkeys(names):
        if name == CAMERA:
            own = scene.camera
            found[name] = own if own.resolution == resolution else own.with_resolution(resolution)
            continue
        towards, up = (np.array(each, np.float64) @ axes for each in _VIEWS[name])
        with np.errstate(over="ignore"):
            eye = center + towards * (_DISTANCE * radius / math.hypot(*towards))
        found[name] = Camera(eye, center, up, 1.0, (1.0, 1.0), resolution, orthographic=True)
        half = np.abs(geometry.camera_axes(found[name])) @ (high / 2 - low / 2)
        height = max(height, 2.0 * half[1], 2.0 * half[0] * rows / columns)
    height = MARGIN * height or 2.0 * radius
    return {
        name: each if name == CAMERA else replace(each, plane=(height, height * columns / rows))
        for name, each in found.items()
    }


def seen_by(scene: Scene, camera: Camera, *, fixed_lights: bool = False) -> Scene:
    """Return the scene with this camera and with lights that stand to it as they stand to the scene's own camera.

    They are turned about the center of the bounding box, so that every view is lit as the scene's own is.
    fixed_lights: they stay where they are in the scene.
    """
    if camera is scene.camera or fixed_lights or not scene.lights:
        return replace(scene, camera=camera)
    low, high = geometry.bounding_box(scene)
    center = low / 2 + high / 2
    turn: Array = geometry.camera_axes(camera).T @ geometry.camera_axes(scene.camera)
    if np.array_equal(camera.eye, scene.camera.eye) and np.allclose(turn, np.eye(3), rtol=0.0, atol=1e-15):
        return replace(scene, camera=camera)  # another resolution
    lights = tuple(replace(each, position=_turned(each.position, center, turn)) for each in scene.lights)
    return replace(scene, camera=camera, lights=lights)


def _turned(point: Floats, center: Floats, turn: Array) -> Array:
    with np.errstate(over="ignore"):
        return np.asarray(center + turn @ (point - center))


def units_per_pixel(camera: Camera) -> float:
    """Return the length that one pixel is wide, scene units: everywhere in a parallel projection, else at the distance of
    the focal point."""
    width = camera.plane[1] / camera.resolution[0]
    if camera.orthographic:
        return width
    return width * math.dist(camera.lookat, camera.eye) / camera.focal


def towards_eye(camera: Camera) -> str:
    """Return the signs and axes that the eye lies at as seen from what it looks at, such as "+z" or "+x +y +z"."""
    backward = -geometry.camera_axes(camera)[2]
    return " ".join(
        f"{'+' if value > 0 else '-'}{axis}" for axis, value in zip("xyz", backward, strict=True) if abs(value) > 1e-9
    )
