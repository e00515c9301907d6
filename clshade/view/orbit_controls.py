"""Camera controls: orbit, pan, dolly and fly. Each returns a new camera; `up` never changes.

Lengths are relative to the distance between the eye and the point looked at, so that a scene of any size feels the
same.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..scene.adjust_camera import adjusted
from ..scene.camera import Camera
from ..scene.geometry import camera_axes

POLE = 89.5  # degrees: the eye stays that far from straight above, where `up` would be parallel to the view
NEAREST, FARTHEST = 1e-6, 1e6  # distance from the point looked at, relative to that of the first camera


def _distance(camera: Camera) -> float:
    return math.dist(camera.eye, camera.lookat)


def elevation(camera: Camera) -> float:
    """Return the angle of the eye above the plane through the point looked at that `up` is normal to, degrees."""
    offset = camera.eye - camera.lookat
    sine = float(offset @ camera.up) / (float(np.linalg.norm(offset)) * float(np.linalg.norm(camera.up)))
    return math.degrees(math.asin(max(-1.0, min(1.0, sine))))


def orbit(camera: Camera, right: float, up: float) -> Camera:
    """Rotate the eye around the point looked at, in degrees, to its right about `up` and upwards, short of the poles."""
    own = elevation(camera)
    low, high = min(-POLE, own), max(POLE, own)  # a camera that begins beyond may stay there
    return adjusted(camera, azimuth=math.fmod(right, 360.0), elevation=max(low, min(high, own + up)) - own)


def pan(camera: Camera, right: float, up: float) -> Camera:
    """Move eye and target in the image plane, by fractions of the image's height at the target's distance."""
    height = camera.plane[0] if camera.orthographic else camera.plane[0] / camera.focal * _distance(camera)
    return _moved(camera, right * height, up * height, 0.0)


def dolly(camera: Camera, factor: float, first: Camera) -> Camera:
    """Multiply the distance to the point looked at, within NEAREST and FARTHEST times that of the `first` camera."""
    offset = camera.eye - camera.lookat
    distance, usual = _distance(camera), _distance(first)
    factor = max(NEAREST * usual, min(FARTHEST * usual, distance * factor)) / distance
    return replace(camera, eye=camera.lookat + offset * factor)


def fly(camera: Camera, right: float, up: float, forward: float) -> Camera:
    """Move eye and target along the camera's axes, by multiples of their distance."""
    distance = _distance(camera)
    return _moved(camera, right * distance, up * distance, forward * distance)


def _moved(camera: Camera, right: float, up: float, forward: float) -> Camera:
    shift = np.array([right, up, forward]) @ camera_axes(camera)
    return replace(camera, eye=camera.eye + shift, lookat=camera.lookat + shift)
