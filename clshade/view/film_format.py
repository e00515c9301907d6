"""The formats of films: what each can hold, its rates, and how long each frame is shown."""

from __future__ import annotations

import importlib.util
import math
import os
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from numbers import Real
from typing import Any

from ..base.atomic_files import Path, shown
from ..base.extras import how_to_install
from ..base.input_files import quoted
from ..base.spelling import hint
from ..errors import InputError

SLOWEST = Fraction(1, 10)  # frames per second


@dataclass(frozen=True)
class FilmFormat:
    """A format.

    ending: of file names. depths: bits per channel. fastest: most frames per second: GIF's delays are centiseconds, those
    of APNG and WebP milliseconds, and browsers show a frame of 10 ms or less for 100 ms. ticks: units of a frame's
    duration in a second, 0 for any. side: most pixels. video: it is encoded by PyAV, else by Pillow. alpha: it
    keeps that of frames over nothing.
    """

    ending: str
    depths: tuple[int, ...]
    fastest: int
    ticks: int
    side: int
    video: bool
    alpha: bool = False


FORMATS = {
    each.ending: each
    for each in (
        FilmFormat(".mp4", (8, 10), 240, 0, 16384, video=True),
        FilmFormat(".webm", (8,), 240, 0, 16384, video=True),
        FilmFormat(".gif", (8,), 50, 100, 65535, video=False),
        FilmFormat(".apng", (8,), 90, 1000, 16384, video=False, alpha=True),
        FilmFormat(".webp", (8,), 90, 1000, 16383, video=False, alpha=True),
    )
}
ENDINGS = tuple(FORMATS)
_WORDS = {  # endings of formats that are not written -> one that is
    **dict.fromkeys((".mov", ".m4v", ".avi", ".mpg", ".mpeg", ".mpeg4", ".h264", ".hevc", ".wmv", ".flv"), ".mp4"),
    **dict.fromkeys((".mkv", ".ogv", ".vp9"), ".webm"),
    ".mng": ".apng",
}
FRAME_ENDINGS = ("", ".exr", ".png")  # of names of numbered frames


def is_film(name: str) -> bool:
    """Return whether an output is a film; False for frames. Raises InputError for another kind of film, or if the name
    has a number."""
    stem, ending = os.path.splitext(os.path.basename(name))
    ending = ending.lower()
    if ending in FORMATS:
        if "#" in stem:
            raise InputError(f"--output: expected a film's name without #, found {quoted(name)}")
        return True
    near = "" if ending in FRAME_ENDINGS or "#" in ending else hint(ending, ENDINGS, _suffixed())
    if near and "#" not in stem:
        expected = f"a film, {', '.join(ENDINGS)}, or frames such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(name)}{near}")
    return False


def _suffixed() -> dict[str, str]:
    return {ending.replace("-", "_"): meant for ending, meant in _WORDS.items()}


def format_of(path: Path) -> FilmFormat:
    """Return the format that a film's name asks for. Raises InputError for another name, or if its encoder is missing."""
    ending = os.path.splitext(os.fspath(path))[1].lower()
    if ending not in FORMATS:
        near = hint(ending, ENDINGS, _suffixed()) if ending else ""
        raise InputError(f"film: path: expected a name that ends in {', '.join(ENDINGS)}, found {shown(path)}{near}")
    found = FORMATS[ending]
    if found.video and importlib.util.find_spec("av") is None:
        without = "; .gif, .apng and .webp need nothing more"
        raise InputError(f"{shown(path)}: needs PyAV: `{how_to_install('film')}`{without}")
    return found


def checked_depth(kind: FilmFormat, bits: int) -> int:
    """Return the bits per channel. Raises InputError if the format has no such depth."""
    if bits not in kind.depths:
        expected = " or ".join(map(str, kind.depths))
        others = [each.ending for each in FORMATS.values() if bits in each.depths]
        near = f": {' and '.join(others)} can have {bits}" if others else ""
        raise InputError(f"--bit-depth: expected {expected} for {kind.ending}, found {bits}{near}")
    return bits


def checked_rate(kind: FilmFormat, fps: Any) -> Fraction:
    """Return frames per second, a number or text such as 24, 29.97 or 30000/1001, as a fraction. Raises InputError."""
    expected = f"frames per second, {float(SLOWEST):g} to {kind.fastest} for {kind.ending}, such as 24 or 30000/1001"
    try:
        rate = _as_float(fps)
    except (ValueError, ZeroDivisionError, OverflowError):
        rate = math.nan
    if not float(SLOWEST) <= rate <= kind.fastest:
        raise InputError(f"--fps: expected {expected}, found {quoted(str(fps))}")
    return Fraction(rate).limit_denominator(1001)


def _as_float(fps: Any) -> float:
    """Return a rate as a float, from which `limit_denominator` recovers the fraction: a Fraction of the text 1e999999999
    would take all memory."""
    if isinstance(fps, bool) or not isinstance(fps, str | Real):
        return math.nan
    return float(Fraction(fps) if isinstance(fps, str) and "/" in fps else fps)


def durations(count: int, rate: Fraction, ticks: int) -> list[int]:
    """Return how long each frame is shown, in units of 1/ticks s: whole numbers whose sums are right to half a unit.

    Thirty frames per second of a GIF are shown for 3, 4, 3, 3, 4, 3, ... centiseconds.
    """
    ends = [math.floor(ticks * k / rate + Fraction(1, 2)) for k in range(count + 1)]
    return [end - start for start, end in pairwise(ends)]
