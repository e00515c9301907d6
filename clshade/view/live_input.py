"""What a client of a live view may send: the types of messages with their fields, and the moves of the camera.

A move returns a new camera; `up` never changes. Lengths are relative to the distance between the eye and the point
looked at, so that a scene of any size feels alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..base.declare import Check
from ..base.validation import flag, integer, items, known, number, value_error
from ..errors import InputError
from ..scene.adjust_camera import adjusted
from ..scene.camera import MAX_RESOLUTION, Camera
from ..scene.geometry import camera_axes
from ..scene.settings import Settings
from .live_scene import REPEATED

POLE = 89.5  # degrees: the eye stays that far from straight above, where `up` would be parallel to the view
NEAREST, FARTHEST = 1e-6, 1e6  # distance from the point looked at, relative to that of the first camera


def _factors(owner: str, name: str, value: Any) -> tuple[float, ...]:
    return tuple(number(owner, name, factor, least=0.0) for factor in items(owner, name, value))


_side = partial(integer, least=1, most=MAX_RESOLUTION)  # pixels of the window


def _later(_owner: str, _name: str, value: Any) -> Any:
    """Leave the check to what uses the value: `Settings`, scene, tone map or picture."""
    return value


# type -> fields and their checks. Those of `set` may be missing, and directions, which are then 0.
MESSAGES: dict[str, dict[str, Check]] = {
    "orbit": {"right": number, "up": number},  # degrees
    "pan": {"right": number, "up": number},  # heights of the image
    "dolly": {"factor": partial(number, above=0.0)},  # of the distance
    "fly": {"right": number, "up": number, "forward": number},  # distances
    "reset": {},
    "size": {"columns": _side, "rows": _side},
    "set": {
        **{name: _later for name in Settings.__dataclass_fields__ if name not in REPEATED},
        "lights": _factors,
        "ground": flag,
        "environment": _later,
        "environment_intensity": partial(number, least=0.0),
        "tonemap": _later,
        "exposure": _later,
        "as_floats": lambda _owner, _name, value: value is True,
    },
    "probe": {"column": _later, "row": _later},
    "snapshot": {},
    "command": {},
    "reload": {},
    "shown": {},
}
ANSWERED = ("probe", "snapshot", "command")
_DIRECTIONS = {"right": 0.0, "up": 0.0, "forward": 0.0}


def checked(message: Any) -> tuple[str, dict[str, Any]]:
    """Return the type and the fields of a message, an object of JSON. Raises InputError."""
    if not isinstance(message, Mapping):
        raise InputError("view: message: expected an object")
    kind = message.get("type")
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise value_error("view", "type", f"one of {', '.join(MESSAGES)}", kind)
    checks = MESSAGES[kind]
    if kind == "set":
        names = [name for name in message if name != "type"]
        known("view", names, checks)
        checks = {name: check for name, check in checks.items() if name in names}
    values = {**_DIRECTIONS, **message}
    return kind, {name: check(kind, name, values.get(name)) for name, check in checks.items()}


def elevation(camera: Camera) -> float:
    """Return the angle of the eye above the plane through the point looked at that `up` is normal to, degrees."""
    offset = camera.eye - camera.lookat
    sine = float(offset @ camera.up) / (float(np.linalg.norm(offset)) * float(np.linalg.norm(camera.up)))
    return math.degrees(math.asin(max(-1.0, min(1.0, sine))))


def orbit(camera: Camera, right: float, up: float) -> Camera:
    """Rotate the eye around the point looked at, in degrees, to its right about `up` and upwards, short of the poles."""
    before = elevation(camera)
    low, high = min(-POLE, before), max(POLE, before)  # a camera that begins beyond may stay there
    return adjusted(camera, azimuth=math.fmod(right, 360.0), elevation=max(low, min(high, before + up)) - before)


def pan(camera: Camera, right: float, up: float) -> Camera:
    """Move eye and target in the image plane, by fractions of the image's height at the target's distance."""
    height = camera.plane[0]
    if not camera.orthographic:
        height = height / camera.focal * math.dist(camera.eye, camera.lookat)
    return _moved(camera, height, right, up, 0.0)


def dolly(camera: Camera, factor: float, first: Camera) -> Camera:
    """Multiply the distance to the point looked at, within NEAREST and FARTHEST times that of the `first` camera."""
    distance, reference = (math.dist(view.eye, view.lookat) for view in (camera, first))
    factor = max(NEAREST * reference, min(FARTHEST * reference, distance * factor)) / distance
    return replace(camera, eye=camera.lookat + (camera.eye - camera.lookat) * factor)


def fly(camera: Camera, right: float, up: float, forward: float) -> Camera:
    """Move eye and target along the camera's axes, by multiples of their distance."""
    return _moved(camera, math.dist(camera.eye, camera.lookat), right, up, forward)


def _moved(camera: Camera, unit: float, *steps: float) -> Camera:
    shift = np.array(steps) * unit @ camera_axes(camera)
    return replace(camera, eye=camera.eye + shift, lookat=camera.lookat + shift)
