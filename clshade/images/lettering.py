"""Lines of text for pictures, in matplotlib's default font, without importing the rest of matplotlib."""

from __future__ import annotations

from bisect import bisect_right
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Array, Bytes

DPI = 100
LINE = 1.8  # line spacing in pixels per point of text size

Color = tuple[int, int, int]


def prepare() -> None:
    """Import modules that are slow to import."""
    import matplotlib.ft2font  # noqa: F401


@cache
def _font() -> Any:
    """Return matplotlib's default font without importing the rest of it, which takes as long as the figures."""
    from matplotlib import get_data_path
    from matplotlib.ft2font import FT2Font

    return FT2Font(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"))


@lru_cache(maxsize=256)
def line(text: str, size: float) -> tuple[Bytes, int]:
    """Render a line of text, of `size` points, as (height, width) uint8, 255 for ink; and return its rows below the
    baseline."""
    from matplotlib import ft2font

    font, module = _font(), vars(ft2font)
    font.set_size(size, DPI)
    unhinted = module["LoadFlags"].NO_HINTING if "LoadFlags" in module else module["LOAD_NO_HINTING"]  # by version
    font.set_text(text, 0.0, flags=unhinted)
    font.draw_glyphs_to_bitmap(antialiased=True)
    return np.array(font.get_image()), font.get_descent() // 64  # from 1/64 pixel


def width_of(text: str, size: float) -> int:
    """Return the width of a line of text in pixels."""
    return int(line(text, size)[0].shape[1])


def drawable(text: str) -> str:
    """Return the text with `?` for characters that the font lacks or that are not printable."""
    glyph = _font().get_char_index
    return "".join(letter if letter.isprintable() and glyph(ord(letter)) else "?" for letter in text)


def fitted(text: str, size: float, width: float) -> str:
    """Return the text, drawable, its end replaced by dots if it is wider than `width` pixels; "" if nothing fits."""
    text = drawable(text)
    if not text or width_of(text, size) <= width:
        return text
    shortened = [text[:kept].rstrip() + "..." for kept in range(len(text))]
    count = bisect_right(shortened, width, key=lambda short: width_of(short, size))  # how many fit
    return shortened[count - 1] if count else ""


def put(picture: Array, x: float, y: float, size: float, text: str, color: Color = (0, 0, 0)) -> None:
    """Draw a line of text on a picture (height, width, 3) uint8, its left end at column x, its baseline at row y.

    What lies outside the picture is clipped.
    """
    ink, descent = line(text, size)
    left, top = round(x), round(y) + descent - len(ink)
    ink = ink[max(-top, 0) : max(len(picture) - top, 0), max(-left, 0) : max(picture.shape[1] - left, 0)]
    place = picture[max(top, 0) :, max(left, 0) :][: len(ink), : ink.shape[1]]
    share = ink[:, :, None] / 255.0
    place[:] = np.rint(place * (1.0 - share) + np.array(color) * share)
