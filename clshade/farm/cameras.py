"""The camera of each frame: on a circle around the point it looks at, or one of two eyes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import partial
from numbers import Integral

from ..base.validation import arguments, items, number, value_error
from ..scene.adjust_camera import adjusted
from ..scene.camera import Camera
from ..scene.pose import PerFrame
from .frames import Frames


@arguments(camera=Camera, numbers=items, turn=Frames, degrees=number)
def orbit(camera: Camera, numbers: Iterable[int], turn: Frames, degrees: float = 360.0) -> Mapping[int, Camera]:
    """Return cameras on a circle about `up` through the point the camera looks at.

    Parameters
    ----------
    camera : Camera
        Camera of the first frame.
    numbers : iterable of int
        Frame numbers to return cameras for.
    turn : Frames
        Frames of the whole turn, as returned by `parse_frames`. Its first frame has `camera`
        itself; the frame after its last would have it again after a whole turn, so a film of them
        loops without a standstill.
    degrees : float, default 360.0
        Angle of the turn; positive values move the camera to its right.

    Returns
    -------
    mapping of int to Camera
        Cameras by frame number, created when looked up: a million would take minutes.
    """
    if not all(isinstance(number, Integral) for number in numbers):
        raise value_error("orbit", "numbers", "whole numbers", numbers)
    return PerFrame(numbers, partial(_on_circle, camera, turn, degrees))


def _on_circle(camera: Camera, turn: Frames, degrees: float, number: int) -> Camera:
    return adjusted(camera, azimuth=math.fmod(degrees * (number - turn.first) / turn.span, 360.0))


def stereo_cameras(
    cameras: Mapping[int, Camera], baseline: float, convergence: float | None = None
) -> tuple[Mapping[int, Camera], Mapping[int, Camera]]:
    """Return the cameras of left and right eyes around cameras by frame number.

    Parameters
    ----------
    cameras : mapping of int to Camera
        Camera between the eyes, by frame number.
    baseline, convergence
        See `Camera.stereo`.

    Returns
    -------
    left, right : mapping of int to Camera
        Cameras by frame number, created when looked up.
    """
    left, right = (PerFrame(cameras, partial(_eye_of, cameras, baseline, convergence, side)) for side in (0, 1))
    return left, right


def _eye_of(
    cameras: Mapping[int, Camera], baseline: float, convergence: float | None, side: int, number: int
) -> Camera:
    return cameras[number].stereo(baseline, convergence)[side]
