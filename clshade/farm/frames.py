"""Frame numbers, such as 1..120, and the names of their files, such as out.####.exr."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..base.input_files import quoted
from ..base.validation import arguments
from ..base.validation import text as checked_text
from ..errors import InputError
from ..pipeline.frame_files import ENDINGS, FILES, KINDS, FileKind, output_paths

MOST = 1_000_000  # frames of one run
_RANGE = r"([0-9]{1,18})(?:\.\.([0-9]{1,18})(?:\.\.([0-9]{1,18}))?)?"
FORM = "1..120, 5, 1..120..2 (every second) or a list such as 1..10,20"


@dataclass(frozen=True)
class Frames:
    """Frame numbers.

    Attributes
    ----------
    numbers : tuple of int
        Numbers in ascending order, without duplicates.
    first, last : int
        Lowest and highest number written, whether a step reaches it or not.
    """

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
        most 1,000,000 frames.
    option : str, default "--frames"
        Name to use in errors.

    Returns
    -------
    Frames
        The numbers, ascending, and the ends of their range.

    Raises
    ------
    InputError
        For any other text.

    Examples
    --------
    >>> from clshade import farm
    >>> farm.parse_frames("1..7..2,20").numbers
    (1, 3, 5, 7, 20)
    """
    numbers: set[int] = set()
    ends: list[int] = []
    for part in text.split(","):
        found = re.fullmatch(_RANGE, part.strip())
        if found is None:
            raise InputError(f"{option}: expected {FORM}, found {quoted(text)}")
        start = int(found[1])
        end = int(found[2] or start)
        step = int(found[3] or 1)
        if end < start or step < 1:
            expected = f"a last frame that is not before the first, and a step above 0, such as {FORM}"
            raise InputError(f"{option}: expected {expected}, found {quoted(part.strip())}")
        chosen = range(start, end + 1, step)
        if len(numbers) + len(chosen) > MOST:
            raise InputError(f"{option}: expected at most {MOST} frames, found {quoted(text)}")
        numbers.update(chosen)
        ends += [start, end]
    return Frames(tuple(sorted(numbers)), min(ends), max(ends))


@dataclass(frozen=True)
class Pattern:
    """File names without extension in which a run of # stands for the frame number, zero-padded to that many digits.
    width 0: no number."""

    before: str
    width: int
    after: str

    def names(self, number: int, files: Sequence[FileKind] = FILES) -> tuple[str, ...]:
        """Return the names of a frame's files, as str: a million Path objects take twenty seconds."""
        digits = f"{number:0{self.width}d}" if self.width else ""
        stem = f"{self.before}{digits}{self.after}"
        return tuple(f"{stem}{ENDINGS[kind]}" for kind in KINDS if kind in files)


def pattern_of_eye(text: str, eye: str) -> str:
    """Return the name of the images of an eye, as `left`: out.left.####.exr for out.####.exr, out.left.mp4 for out.mp4."""
    folder, name = os.path.split(text)
    run = re.search("#+", name)
    before, rest = (name[: run.start()], name[run.start() :]) if run else os.path.splitext(name)
    stem = before.rstrip("._-")
    separator = before[len(stem) :] or ("." if run else "")
    return os.path.join(folder, f"{stem}{'.' if stem else ''}{eye}{separator}{rest}")


def parse_pattern(text: str, count: int) -> Pattern:
    """Parse the output option for `count` frames; without any # it names the only frame. Raises InputError."""
    image = output_paths(text, ("draw_frames", "--output"))[0]  # refuses text that names no file
    name = os.path.split(text)[1]
    runs = re.findall("#+", name)
    if not name or len(runs) > 1 or (not runs and count > 1):
        expected = "one run of # for the number of the frame, such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(text)}")
    before, run, after = image.stem.partition(runs[0] if runs else "#")
    return Pattern(str(image).removesuffix(image.name) + before, len(run), after)
