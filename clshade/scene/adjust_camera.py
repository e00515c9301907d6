"""Adjust a camera by angles around its target, a view angle or a position, or so that it shows all of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..base import console
from ..base.arrays import Array, Floats
from ..base.validation import number, vector
from .camera import Camera, height_seen
from .fitting import fitted
from .framing import UPS, default_camera, up_of
from .geometry import camera_axes
from .ground import objects_of
from .model import Mesh, Scene

# Where the eye is straight above or below, by the cosine of its elevation, `up` is tilted so much towards the image's:
# it stays the axis of the scene that is up, about which turntables turn.
_POLE, _TILT = 1e-9, 1e-6


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
    fit: meshes that the eye is then moved to show, in the same direction: see `fitting.fitted`, also for turning.
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
    turning: it will go round the scene, see `fitting.fitted`.
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
