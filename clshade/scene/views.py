"""Named views of a scene, as in a technical drawing: parallel projections along its axes, all of one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..base.arrays import Array
from ..base.validation import choice
from . import geometry
from .camera import Camera, checked_resolution
from .fitting import FILL, extent, sphere_of_box
from .framing import UPS, up_of
from .ground import objects_of
from .model import Scene

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


def named_cameras(scene: Scene, names: Sequence[str], resolution: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Return a camera for each name, in this order.

    names: of VIEWS. `camera` is the scene's own; all others are parallel projections that show all vertices, but not
    all of a ground, and all of one scale: the largest at which each fits into fitting.FILL of the image. The axis nearest
    to the camera's up points up; `front` is seen from +z where that is y, from -y where it is z (`framing.UPS`).
    resolution: (N, M); default: the scene's camera's.
    Raises InputError for another name, and where a position overflows.
    """
    for name in names:
        choice("named_cameras", "names", name, VIEWS)
    resolution = scene.camera.resolution if resolution is None else checked_resolution("named_cameras", resolution)
    columns, rows = resolution
    objects = objects_of(scene)
    low, high = geometry.bounding_box(objects)
    center, radius = sphere_of_box(low, high)
    axes = np.array(UPS[up_of(scene.camera)], np.float64)
    cameras, height = {}, 0.0
    for name in dict.fromkeys(names):
        if name == CAMERA:
            same = scene.camera.resolution == resolution
            cameras[name] = scene.camera if same else scene.camera.with_resolution(resolution)
            continue
        towards, up = (np.array(direction, np.float64) @ axes for direction in _VIEWS[name])
        with np.errstate(over="ignore"):
            eye = center + towards * (_DISTANCE * radius / math.hypot(*towards))
        flat = Camera(eye, center, up, 1.0, (1.0, 1.0), resolution, orthographic=True)
        aside, half = extent(flat, objects.meshes, (center, radius))
        cameras[name] = replace(flat, eye=eye + aside, lookat=center + aside)
        height = max(height, 2.0 * half[1], 2.0 * half[0] * rows / columns)
    height = height / FILL or 2.0 * radius
    return {
        name: camera if name == CAMERA else replace(camera, plane=(height, height * columns / rows))
        for name, camera in cameras.items()
    }


def seen_by(scene: Scene, camera: Camera, *, fixed_lights: bool = False) -> Scene:
    """Return the scene with this camera and with lights that stand to it as they stand to the scene's own camera.

    They are turned about the center of the bounding box, so that every view is lit as the scene's own is.
    fixed_lights: they stay where they are in the scene.
    """
    if camera is scene.camera or fixed_lights or not scene.lights:
        return replace(scene, camera=camera)
    low, high = geometry.bounding_box(objects_of(scene))
    center = low / 2 + high / 2
    turn: Array = geometry.camera_axes(camera).T @ geometry.camera_axes(scene.camera)
    if np.array_equal(camera.eye, scene.camera.eye) and np.allclose(turn, np.eye(3), rtol=0.0, atol=1e-15):
        return replace(scene, camera=camera)  # another resolution
    lights = tuple(light.turned(center, turn) for light in scene.lights)
    return replace(scene, camera=camera, lights=lights)


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
