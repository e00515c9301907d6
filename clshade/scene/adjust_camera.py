"""Adjust a camera by angles around its target, a view angle or a position."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats
from ..base.validation import number, value_error, vector
from .camera import Camera, height_seen
from .geometry import camera_axes


def _rotated(offset: Array, axis: Array, degrees: float) -> Floats:
    """Rotate `offset` about the unit vector `axis` (Rodrigues' formula), counter-clockwise seen against it."""
    angle = math.radians(degrees)
    along = axis * (axis @ offset)
    turned: Floats = along + math.cos(angle) * (offset - along) + math.sin(angle) * np.cross(axis, offset)
    return turned


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
) -> Camera:
    """Return the camera with some of its parameters changed, in this order.

    position, focal_point, up: 3-vectors, world space, in place of eye, lookat and up.
    azimuth, elevation: degrees by which the eye rotates around the focal point: to its right about `up`, and upwards
        (elevation stays short of the poles: the sum with the camera's own must lie between -90 and 90).
    view_angle: vertical field of view, degrees from 1e-6 to less than 180; pixels become square.
    orthographic: parallel projection of what the perspective camera sees at the focal point's distance.
    Raises InputError for values out of range.
    """
    who = "camera"
    lookat = camera.lookat if focal_point is None else vector(who, "focal point", focal_point)
    eye = camera.eye if position is None else vector(who, "position", position)
    camera = replace(camera, eye=eye, lookat=lookat, up=camera.up if up is None else vector(who, "up", up))
    azimuth, elevation = number(who, "azimuth", azimuth), number(who, "elevation", elevation)
    offset = camera.eye - camera.lookat
    if azimuth or elevation:
        up_axis = camera.up / np.linalg.norm(camera.up)
        own = math.degrees(math.asin(max(-1.0, min(1.0, float(offset @ up_axis) / float(np.linalg.norm(offset))))))
        if not -90.0 < own + elevation < 90.0:
            raise value_error(who, "elevation", f"degrees between {-90 - own:.4g} and {90 - own:.4g}", elevation)
        right = camera_axes(camera)[0]
        offset = _rotated(_rotated(offset, right, -elevation), up_axis, azimuth)
        camera = replace(camera, eye=camera.lookat + offset)
    if view_angle is not None:
        columns, rows = camera.resolution
        height = height_seen(who, "view angle", view_angle)
        camera = replace(camera, focal=1.0, plane=(height, height * columns / rows))
    if orthographic and not camera.orthographic:
        scale = float(np.linalg.norm(offset)) / camera.focal
        camera = replace(camera, orthographic=True, plane=(camera.plane[0] * scale, camera.plane[1] * scale))
    return camera
