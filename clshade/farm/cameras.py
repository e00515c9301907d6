"""The camera of each frame: on a circle around the point it looks at, or one of two eyes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from ..scene.adjust_camera import adjusted
from ..scene.camera import Camera
from .frames import Frames


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
    return _Orbit(camera, dict.fromkeys(numbers), turn, degrees)


@dataclass(frozen=True, eq=False)
class _Orbit(Mapping[int, Camera]):
    """The mapping that `orbit` returns. numbers: the keys, in order."""

    camera: Camera
    numbers: Mapping[int, None]
    turn: Frames
    degrees: float

    def __getitem__(self, number: int) -> Camera:
        if number not in self.numbers:
            raise KeyError(number)
        angle = math.fmod(self.degrees * (number - self.turn.first) / self.turn.span, 360.0)
        return adjusted(self.camera, azimuth=angle)

    def __iter__(self) -> Iterator[int]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)


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
    left, right = (_Eye(cameras, baseline, convergence, side) for side in (0, 1))
    return left, right


@dataclass(frozen=True, eq=False)
class _Eye(Mapping[int, Camera]):
    """One of the mappings that `stereo_cameras` returns. side: 0 for left, 1 for right."""

    cameras: Mapping[int, Camera]
    baseline: float
    convergence: float | None
    side: int

    def __getitem__(self, number: int) -> Camera:
        return self.cameras[number].stereo(self.baseline, self.convergence)[self.side]

    def __contains__(self, number: object) -> bool:
        return number in self.cameras

    def __iter__(self) -> Iterator[int]:
        return iter(self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)
