"""Frame numbers such as 1..120, names of files such as out.####.exr, and cameras frame by frame: of a turn, of two eyes."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Integral

from ..base.input_files import quoted
from ..base.validation import arguments, items, number, value_error
from ..base.validation import text as checked_text
from ..errors import InputError
from ..pipeline.frame_files import ENDINGS, FILES, KINDS, FileKind, output_paths
from ..scene.adjust_camera import adjusted
from ..scene.camera import Camera
from ..scene.pose import PerFrame

MAX_FRAMES = 1_000_000  # of one run
_RANGE = r"([0-9]{1,18})(?:\.\.([0-9]{1,18})(?:\.\.([0-9]{1,18}))?)?"
_FORM = "1..120, 5, 1..120..2 (every second) or a list such as 1..10,20"


@dataclass(frozen=True)
class Frames:
    """Frame numbers, ascending and distinct. first, last: the ends of the range, whether a step reaches them or not."""

    numbers: tuple[int, ...]
    first: int
    last: int

    @property
    def span(self) -> int:
        """Number of frames from `first` to `last`."""
        return self.last - self.first + 1


@arguments(text=checked_text, option=checked_text)
def parse_frames(text: str, option: str = "--frames") -> Frames:
    """Parse frame numbers as users write them.

    Parameters
    ----------
    text : str
        ``"1..120"``, ``"5"``, ``"1..120..2"`` (every second) or a list such as ``"1..10,20"``; at
        most 1,000,000 frames. Any other text is refused.
    option : str, default "--frames"
        Name to use in errors.

    Examples
    --------
    >>> from clshade import farm
    >>> farm.parse_frames("1..7..2,20").numbers
    (1, 3, 5, 7, 20)
    """
    numbers: set[int] = set()
    ends: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(_RANGE, part.strip())
        if match is None:
            raise InputError(f"{option}: expected {_FORM}, found {quoted(text)}")
        start = int(match[1])
        end = int(match[2] or start)
        step = int(match[3] or 1)
        if end < start or step < 1:
            expected = f"a last frame that is not before the first, and a step above 0, such as {_FORM}"
            raise InputError(f"{option}: expected {expected}, found {quoted(part.strip())}")
        chosen = range(start, end + 1, step)
        if len(numbers) + len(chosen) > MAX_FRAMES:
            raise InputError(f"{option}: expected at most {MAX_FRAMES} frames, found {quoted(text)}")
        numbers.update(chosen)
        ends += [start, end]
    return Frames(tuple(sorted(numbers)), min(ends), max(ends))


# Names of files


@dataclass(frozen=True)
class Pattern:
    """File names without extension; `width` digits between `before` and `after` are the frame number, 0: none."""

    before: str
    width: int
    after: str

    def names(self, number: int, files: Sequence[FileKind] = FILES) -> tuple[str, ...]:
        """Return the names of a frame's files, as str: a million Path objects take twenty seconds."""
        digits = f"{number:0{self.width}d}" if self.width else ""
        return tuple(f"{self.before}{digits}{self.after}{ENDINGS[kind]}" for kind in KINDS if kind in files)


def parse_pattern(text: str, count: int) -> Pattern:
    """Parse the output option for `count` frames: a run of # stands for the number; without any it names the only frame."""
    image = output_paths(text, ("draw_frames", "--output"))[0]  # refuses text that names no file
    name = os.path.split(text)[1]
    runs = re.findall("#+", name)
    if not name or len(runs) > 1 or (not runs and count > 1):
        expected = "one run of # for the number of the frame, such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(text)}")
    before, run, after = image.stem.partition(runs[0] if runs else "#")
    return Pattern(str(image).removesuffix(image.name) + before, len(run), after)


def pattern_of_eye(text: str, eye: str) -> str:
    """Return the name of the images of an eye, as `left`: out.left.####.exr for out.####.exr, out.left.mp4 for out.mp4."""
    folder, name = os.path.split(text)
    run = re.search("#+", name)
    before, after = (name[: run.start()], name[run.start() :]) if run else os.path.splitext(name)
    stem = before.rstrip("._-")
    separator = before[len(stem) :] or ("." if run else "")
    return os.path.join(folder, f"{stem}{'.' if stem else ''}{eye}{separator}{after}")


# Cameras


@arguments(camera=Camera, numbers=items, turn=Frames, degrees=number)
def orbit(camera: Camera, numbers: Iterable[int], turn: Frames, degrees: float = 360.0) -> Mapping[int, Camera]:
    """Return cameras on a circle about `up` through the point the camera looks at, each made when it is looked up.

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
    """
    if not all(isinstance(number, Integral) for number in numbers):
        raise value_error("orbit", "numbers", "whole numbers", numbers)
    return PerFrame(numbers, partial(_on_circle, camera, turn, degrees))


def _on_circle(camera: Camera, turn: Frames, degrees: float, number: int) -> Camera:
    return adjusted(camera, azimuth=math.fmod(degrees * (number - turn.first) / turn.span, 360.0))


def stereo_cameras(
    cameras: Mapping[int, Camera], baseline: float, convergence: float | None = None
) -> tuple[Mapping[int, Camera], Mapping[int, Camera]]:
    """Return the cameras of left and of right eyes by frame number, each made when it is looked up.

    Parameters
    ----------
    cameras : mapping of int to Camera
        Camera between the eyes, by frame number.
    baseline, convergence
        See `Camera.stereo`.
    """
    left, right = (PerFrame(cameras, partial(_eye, cameras, (baseline, convergence), side)) for side in (0, 1))
    return left, right


def _eye(cameras: Mapping[int, Camera], stereo: tuple[float, float | None], side: int, number: int) -> Camera:
    return cameras[number].stereo(*stereo)[side]
