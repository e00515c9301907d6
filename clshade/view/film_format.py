"""The formats of films: their codecs and rates, how long each frame is shown, and names of files."""

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

MIN_RATE = Fraction(1, 10)  # frames per second


@dataclass(frozen=True)
class FilmFormat:
    """A format of film files with a depth of color.

    ending: of file names. bits: per channel. codec: its name, for people. pixels: FFmpeg's pixel format, or for people
    what an animated image holds. options: those of the encoder. encoder: FFmpeg's; "" for Pillow's. min_side, max_side:
    pixels. max_rate: frames per second: GIF's delays are centiseconds, those of APNG and WebP milliseconds, and browsers
    show a frame of 10 ms or less for 100 ms. ticks: units of a frame's duration in a second; 0: any duration. alpha:
    whether it keeps that of frames over nothing.
    """

    ending: str
    bits: int
    codec: str
    pixels: str
    options: dict[str, Any]
    encoder: str = ""
    min_side: int = 1
    max_side: int = 16384
    max_rate: int = 240
    ticks: int = 0
    alpha: bool = False


# Constant quality: FFmpeg's guide to H.264 calls 17 or 18 visually lossless.
_H264 = {"crf": "16"}
_HEVC = {"crf": "16", "preset": "fast", "x265-params": "log-level=none"}
_VP9 = {"crf": "20", "b": "0", "deadline": "good", "cpu-used": "4", "row-mt": "1"}
_GIF: dict[str, Any] = {"format": "GIF", "optimize": False}
_APNG: dict[str, Any] = {"format": "PNG", "compress_level": 6}
_WEBP: dict[str, Any] = {"format": "WEBP", "lossless": True, "quality": 20, "method": 1}  # more effort gains little
FORMATS = {  # (ending, bits) -> format
    (row.ending, row.bits): row
    for row in (
        FilmFormat(".mp4", 8, "H.264", "yuv420p", _H264, "libx264", min_side=2),
        # Apple's players take HEVC that is called hvc1, and hardly any plays H.264 of 10 bits. Between 33 and 63 pixels a
        # side x265 4.2 writes past its buffers.
        FilmFormat(".mp4", 10, "HEVC", "yuv420p10le", _HEVC, "libx265", min_side=64),
        FilmFormat(".webm", 8, "VP9", "yuv420p", _VP9, "libvpx-vp9", min_side=2),
        FilmFormat(".gif", 8, "GIF", "255 colors, dithered", _GIF, max_side=65535, max_rate=50, ticks=100),
        FilmFormat(".apng", 8, "APNG", "lossless", _APNG, max_rate=90, ticks=1000, alpha=True),
        FilmFormat(".webp", 8, "WebP", "lossless", _WEBP, max_side=16383, max_rate=90, ticks=1000, alpha=True),
    )
}
ENDINGS = tuple(dict.fromkeys(ending for ending, _ in FORMATS))
_SUBSTITUTES = {  # endings of formats that are not written -> one that is
    **dict.fromkeys((".mov", ".m4v", ".avi", ".mpg", ".mpeg", ".mpeg4", ".h264", ".hevc", ".wmv", ".flv"), ".mp4"),
    **dict.fromkeys((".mkv", ".ogv", ".vp9"), ".webm"),
    ".mng": ".apng",
}


def is_film(name: str) -> bool:
    """Return whether an output is a film; False for frames. Raises InputError for a film in a format that is not
    written, or whose name has a number."""
    stem, ending = os.path.splitext(os.path.basename(name))
    ending = ending.lower()
    if "#" in stem:
        if ending in ENDINGS:
            raise InputError(f"--output: expected a film's name without #, found {quoted(name)}")
        return False
    of_frames = ending in ("", ".exr", ".png") or "#" in ending
    near = "" if of_frames or ending in ENDINGS else hint(ending, ENDINGS, _SUBSTITUTES)
    if near:
        expected = f"a film, {', '.join(ENDINGS)}, or frames such as out.####.exr"
        raise InputError(f"--output: expected {expected}, found {quoted(name)}{near}")
    return ending in ENDINGS


def format_of(path: Path, bits: int) -> FilmFormat:
    """Return the format of a film's name with so many bits per channel. Raises InputError for another name, if the format
    has no such depth, or if its encoder is not installed."""
    ending = os.path.splitext(os.fspath(path))[1].lower()
    if ending not in ENDINGS:
        near = hint(ending, ENDINGS, _SUBSTITUTES) if ending else ""
        raise InputError(f"film: path: expected a name that ends in {', '.join(ENDINGS)}, found {shown(path)}{near}")
    if (ending, bits) not in FORMATS:
        expected = " or ".join(str(row.bits) for row in FORMATS.values() if row.ending == ending)
        endings = [row.ending for row in FORMATS.values() if row.bits == bits]
        near = f": {' and '.join(endings)} can have {bits}" if endings else ""
        raise InputError(f"--bit-depth: expected {expected} for {ending}, found {bits}{near}")
    if FORMATS[ending, bits].encoder and importlib.util.find_spec("av") is None:
        alternatives = "; .gif, .apng and .webp need nothing more"
        raise InputError(f"{shown(path)}: needs PyAV: `{how_to_install('film')}`{alternatives}")
    return FORMATS[ending, bits]


def checked_rate(kind: FilmFormat, fps: Any) -> Fraction:
    """Return frames per second, a number or text such as 24, 29.97 or 30000/1001, as a fraction. Raises InputError."""
    rate = math.nan
    if isinstance(fps, str | Real) and not isinstance(fps, bool):
        # As a float, from which `limit_denominator` recovers the fraction: that of the text 1e999999999 would take all
        # memory.
        try:
            rate = float(Fraction(fps) if isinstance(fps, str) and "/" in fps else fps)
        except (ValueError, ZeroDivisionError, OverflowError):
            rate = math.nan
    if not float(MIN_RATE) <= rate <= kind.max_rate:
        expected = (
            f"frames per second, {float(MIN_RATE):g} to {kind.max_rate} for {kind.ending}, such as 24 or 30000/1001"
        )
        raise InputError(f"--fps: expected {expected}, found {quoted(str(fps))}")
    return Fraction(rate).limit_denominator(1001)


def durations(count: int, rate: Fraction, ticks: int) -> list[int]:
    """Return how long each frame is shown, in units of 1/ticks s: whole numbers whose sums are right to half a unit.

    Thirty frames per second of a GIF are shown for 3, 4, 3, 3, 4, 3, ... centiseconds.
    """
    ends = [math.floor(ticks * k / rate + Fraction(1, 2)) for k in range(count + 1)]
    return [end - start for start, end in pairwise(ends)]
