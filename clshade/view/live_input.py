"""What a client of a live view may send: the types of messages with their fields, and the moves of the camera.

A move returns a new camera; `up` never changes. Lengths are relative to the distance between the eye and the point
looked at, so that a scene of any size feels alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

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


class Field(NamedTuple):
    """A field of a message. check: returns the value that is used. default: where the field is missing."""

    check: Check
    default: Any = None


def _factors(owner: str, name: str, value: Any) -> tuple[float, ...]:
    return tuple(number(owner, name, factor, least=0.0) for factor in items(owner, name, value))


_MOVE = Field(number, 0.0)
_SIDE = Field(partial(integer, least=1, most=MAX_RESOLUTION))  # pixels of the window
_LATER = Field(lambda _owner, _name, value: value)  # checked by what uses it: `Settings`, scene, tone map or picture

# type -> fields; those of `set` may be missing
MESSAGES: dict[str, dict[str, Field]] = {
    "orbit": {"right": _MOVE, "up": _MOVE},  # degrees
    "pan": {"right": _MOVE, "up": _MOVE},  # heights of the image
    "dolly": {"factor": Field(partial(number, above=0.0))},  # of the distance
    "fly": {"right": _MOVE, "up": _MOVE, "forward": _MOVE},  # distances
    "reset": {},
    "size": {"columns": _SIDE, "rows": _SIDE},
    "set": {
        **dict.fromkeys((name for name in Settings.__dataclass_fields__ if name not in REPEATED), _LATER),
        "lights": Field(_factors),
        "ground": Field(flag),
        "environment": _LATER,
        "environment_intensity": Field(partial(number, least=0.0)),
        "tonemap": _LATER,
        "exposure": _LATER,
        "as_floats": Field(lambda _owner, _name, value: value is True),
    },
    "probe": {"column": _LATER, "row": _LATER},
    "snapshot": {},
    "command": {},
    "reload": {},
    "shown": {},
}
ANSWERED = ("probe", "snapshot", "command")


def checked(message: Any) -> tuple[str, dict[str, Any]]:
    """Return the type and the fields of a message, an object of JSON. Raises InputError."""
    if not isinstance(message, Mapping):
        raise InputError("view: message: expected an object")
    kind = message.get("type")
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise value_error("view", "type", f"one of {', '.join(MESSAGES)}", kind)
    fields = MESSAGES[kind]
    if kind == "set":
        names = [name for name in message if name != "type"]
        known("view", names, fields)
        fields = {name: field for name, field in fields.items() if name in names}
    return kind, {name: field.check(kind, name, message.get(name, field.default)) for name, field in fields.items()}


def _distance(camera: Camera) -> float:
    return math.dist(camera.eye, camera.lookat)


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
    height = camera.plane[0] if camera.orthographic else camera.plane[0] / camera.focal * _distance(camera)
    return _moved(camera, right * height, up * height, 0.0)


def dolly(camera: Camera, factor: float, first: Camera) -> Camera:
    """Multiply the distance to the point looked at, within NEAREST and FARTHEST times that of the `first` camera."""
    offset = camera.eye - camera.lookat
    distance, reference = _distance(camera), _distance(first)
    factor = max(NEAREST * reference, min(FARTHEST * reference, distance * factor)) / distance
    return replace(camera, eye=camera.lookat + offset * factor)


def fly(camera: Camera, right: float, up: float, forward: float) -> Camera:
    """Move eye and target along the camera's axes, by multiples of their distance."""
    distance = _distance(camera)
    return _moved(camera, right * distance, up * distance, forward * distance)


def _moved(camera: Camera, right: float, up: float, forward: float) -> Camera:
    shift = np.array([right, up, forward]) @ camera_axes(camera)
    return replace(camera, eye=camera.eye + shift, lookat=camera.lookat + shift)
