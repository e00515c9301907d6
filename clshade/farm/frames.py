"""Which frames are meant, such as 1..120, and what their files are called, such as out.####.exr."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from ..base.input_files import quoted
from ..errors import InputError
from ..pipeline.frame import output_paths

MOST = 1_000_000  # frames of one run
_RANGE = r"([0-9]{1,18})(?:\.\.([0-9]{1,18})(?:\.\.([0-9]{1,18}))?)?"
FORM = "1..120, 5, 1..120..2 (every second) or a list such as 1..10,20"


@dataclass(frozen=True)
class Frames:
    """numbers: ascending, none twice. first, last: the lowest and the highest number written, reached by a step or not."""

    numbers: tuple[int, ...]
    first: int
    last: int

    @property
    def span(self) -> int:
        return self.last - self.first + 1


def parse_frames(text: str, option: str = "--frames") -> Frames:
    """Frames as a user writes them, see FORM. Raises InputError, which names `option`, for anything else."""
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
    """File names without their extension in which a run of # stands for the frame's number, with zeros in front to as
    many digits; width 0: for no number."""

    before: str
    width: int
    after: str

    def names(self, number: int) -> tuple[str, str]:
        """The EXR and the PNG of a frame. (A million of Path take twenty seconds.)"""
        digits = f"{number:0{self.width}d}" if self.width else ""
        stem = f"{self.before}{digits}{self.after}"
        return f"{stem}.exr", f"{stem}.png"


def parse_pattern(text: str, count: int) -> Pattern:
    """The pattern of an output option for `count` frames; without any # it names the one frame. Raises InputError."""
    image = output_paths(text, ("draw_frames", "--output"))[0]  # refuses what names no file
    name = os.path.split(text)[1]
    runs = re.findall("#+", name)
    if not name or len(runs) > 1 or (not runs and count > 1):
        expected = "one run of # for the number of the frame, such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(text)}")
    before, run, after = image.stem.partition(runs[0] if runs else "#")
    return Pattern(str(image).removesuffix(image.name) + before, len(run), after)
