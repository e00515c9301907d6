"""Other cameras of a scene: adjusted by angles around their target, a view angle or a position; fitted to all of it; named
views, as in a technical drawing: parallel projections along its axes, all of one scale."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..base import console
from ..base.arrays import Array, Floats
from ..base.validation import choice, number, vector
from .camera import Camera, checked_resolution, height_seen
from .framing import FILL, UPS, bounding_sphere, default_camera, extent, fitted, up_of
from .geometry import camera_axes
from .ground import objects_of
from .model import Mesh, Scene

# Where the eye is straight above or below, by the cosine of its elevation, `up` is tilted so much towards the image's:
# it stays the axis of the scene that is up, about which turntables turn.
_POLE, _TILT = 1e-9, 1e-6
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


def _rotated(offset: Array, axis: Array, degrees: float) -> Floats:
    """Rotate `offset` about the unit vector `axis` (Rodrigues' formula), counter-clockwise seen against it."""
    angle = math.radians(degrees)
    along = axis * (axis @ offset)
    return np.asarray(along + math.cos(angle) * (offset - along) + math.sin(angle) * np.cross(axis, offset))


def adjusted(
    camera: Camera,
    *,
    position: Any = None,
    focal_point: Any = None,
    up: Any = None,
    azimuth: float = 0.0,
    elevation: float = 0.0,
    view_angle: float | None = None,
    orthographic: bool = False,
    fit: Sequence[Mesh] | None = None,
    turning: bool = False,
) -> Camera:
    """Return the camera with some of its parameters changed, in this order.

    position, focal_point, up: 3-vectors, world space, in place of eye, lookat and up.
    azimuth, elevation: degrees by which the eye rotates around the focal point: to its right about `up`, and upwards, also
        over the pole, beyond which the image is upside down.
    view_angle: vertical field of view, degrees from 1e-6 to less than 180; pixels become square.
    fit: meshes that the eye is then moved to show, in the same direction: see `framing.fitted`, also for turning.
    orthographic: parallel projection of what the perspective camera sees at the focal point's distance.
    Raises InputError for values out of range.
    """
    who = "camera"
    lookat = camera.lookat if focal_point is None else vector(who, "focal point", focal_point)
    eye = camera.eye if position is None else vector(who, "position", position)
    camera = posed(camera, who, eye=eye, lookat=lookat, **({} if up is None else {"up": vector(who, "up", up)}))
    azimuth, elevation = number(who, "azimuth", azimuth), number(who, "elevation", elevation)
    offset = camera.eye - camera.lookat
    if azimuth or elevation:
        up_axis = camera.up / np.linalg.norm(camera.up)
        right, upward, _ = camera_axes(camera)
        offset, upward = (_rotated(_rotated(axis, right, -elevation), up_axis, azimuth) for axis in (offset, upward))
        beside = float(upward @ up_axis)  # the cosine of the elevation, below 0 beyond a pole
        up = camera.up if beside > 0.0 else -camera.up
        camera = replace(camera, eye=camera.lookat + offset, up=up_axis + _TILT * upward if abs(beside) < _POLE else up)
    if view_angle is not None:
        columns, rows = camera.resolution
        height = height_seen(who, "view angle", view_angle)
        camera = replace(camera, focal=1.0, plane=(height, height * columns / rows))
    if fit is not None:
        camera = fitted(camera, fit, turning=turning, orthographic=orthographic)
    if orthographic and not camera.orthographic:
        scale = float(np.linalg.norm(camera.eye - camera.lookat)) / camera.focal
        camera = replace(camera, orthographic=True, plane=(camera.plane[0] * scale, camera.plane[1] * scale))
    return camera


def posed(camera: Camera, who: str, **changes: Any) -> Camera:
    """Return the camera with other fields. If it looks along its `up` and the changes do not set one, `up` is tilted a
    little: the image is then oriented as in the views `top` and `bottom`, and a line says so."""
    eye, lookat = (vector("Camera", name, changes.get(name, getattr(camera, name))) for name in ("eye", "lookat"))
    with np.errstate(over="ignore"):
        forward = lookat - eye
    length, up = np.abs(forward).max(), camera.up / np.linalg.norm(camera.up)
    if "up" not in changes and 0.0 < length < math.inf:
        forward /= length
        if np.linalg.norm(np.cross(forward, up)) <= 1e-12:
            upward = np.array(UPS[up_of(camera)][2], np.float64) * np.sign(forward @ up)
            changes["up"] = up + _TILT * upward
            listed = ["{:g},{:g},{:g}".format(*(axis + 0.0)) for axis in (camera.up, upward)]
            console.progress(f"{who}: it looks along {listed[0]}, its up vector: {listed[1]} is up in the image")
    return replace(camera, **changes)


def camera_of(scene: Scene, changes: Mapping[str, Any], *, fit: bool = False, turning: bool = False) -> Camera:
    """Return the scene's camera adjusted by `changes`, arguments of `adjusted`.

    A camera that was chosen to show all of the scene (`Scene.fitted`) is chosen again for another direction or
    projection, unless the changes place it: by a position, a focal point or a view angle.
    fit: choose it so in any case but if position and focal point are both given.
    turning: it will go round the scene, see `framing.fitted`.
    """
    changed = {name for name, value in changes.items() if value not in (None, False, 0.0)}
    placed = changed & {"position", "focal_point", "view_angle"}
    again = not {"position", "focal_point"} <= changed if fit else scene.fitted and not placed
    if again and (turning or changed):
        return adjusted(scene.camera, **changes, fit=objects_of(scene).meshes, turning=turning)
    return adjusted(scene.camera, **changes)


def refitted(scene: Scene, resolution: tuple[int, int] | None = None) -> Scene:
    """Return the scene with the default camera of its meshes; the axis nearest to its camera's up points up. resolution:
    (N, M), default: its camera's."""
    meshes, resolution = objects_of(scene).meshes, resolution or scene.camera.resolution
    camera = default_camera(meshes, up_of(scene.camera), resolution)
    return replace(scene, camera=camera, fitted=True)


def named_cameras(scene: Scene, names: Sequence[str], resolution: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Return a camera for each name, in this order.

    names: of VIEWS. `camera` is the scene's own; all others are parallel projections that show all vertices, but not
    all of a ground, and all of one scale: the largest at which each fits into framing.FILL of the image. The axis nearest
    to the camera's up points up; `front` is seen from +z where that is y, from -y where it is z (`framing.UPS`).
    resolution: (N, M); default: the scene's camera's.
    Raises InputError for another name, and where a position overflows.
    """
    for name in names:
        choice("named_cameras", "names", name, VIEWS)
    resolution = scene.camera.resolution if resolution is None else checked_resolution("named_cameras", resolution)
    (columns, rows), meshes = resolution, objects_of(scene).meshes
    center, radius = sphere = bounding_sphere(meshes)
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
        aside, half = extent(flat, meshes, sphere)
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
    center, _ = bounding_sphere(objects_of(scene).meshes)
    turn: Array = camera_axes(camera).T @ camera_axes(scene.camera)
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
    backward = -camera_axes(camera)[2]
    return " ".join(
        f"{'+' if value > 0 else '-'}{axis}" for axis, value in zip("xyz", backward, strict=True) if abs(value) > 1e-9
    )
