"""Colors as people write them: names, #rrggbb, or three linear numbers."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from ..base.spelling import hint
from ..base.validation import sequence, value_error

Rgb = tuple[float, float, float]
_MOST = float(np.finfo(np.float32).max)
FORMS = "a name such as white, #rrggbb (sRGB), or three linear numbers R,G,B from 0 on"


def linear_rgb(owner: str, name: str, color: Any) -> Rgb:
    """Return a color as linear RGB.

    color: three linear numbers, or a text: the same with commas between them, `#rrggbb` or `#rgb`, whose codes are sRGB
    and are decoded, or one of Matplotlib's names, which stand for such codes. Numbers are at least 0 and what float32 can
    hold.
    Raises InputError for anything else.
    """
    if not isinstance(color, str):
        listed = sequence(color)
        return _of_numbers(owner, name, color, () if listed is None else listed)
    found, encoded = _of_text(owner, name, color)
    if not encoded:
        return found
    from .decode import srgb_to_linear

    return _as_rgb(srgb_to_linear(np.array(found)))


def encoded_rgb(owner: str, name: str, text: str) -> Rgb:
    """Return a color that is given as text as sRGB-encoded numbers from 0 to 1. Raises InputError as `linear_rgb`, and for
    linear numbers above 1."""
    found, encoded = _of_text(owner, name, text)
    if encoded:
        return found
    if max(found) > 1.0:
        raise value_error(owner, name, "three linear numbers R,G,B from 0 to 1", text)
    from .tonemap import srgb_curve

    return _as_rgb(srgb_curve(np.array(found)))


def _of_text(owner: str, name: str, text: str) -> tuple[Rgb, bool]:
    """Return the color of a text, and whether it is sRGB-encoded rather than linear."""
    word = text.strip()
    if "," in word:
        return _of_numbers(owner, name, text, word.split(",")), False
    codes = re.fullmatch("#([0-9a-fA-F]{6}|[0-9a-fA-F]{3})", word)
    if codes:
        digits = codes[1] if len(codes[1]) == 6 else "".join(2 * each for each in codes[1])
        return _as_rgb(int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)), True
    from matplotlib import colors

    names = colors.get_named_colors_mapping()
    if word.lower() not in names:
        raise value_error(owner, name, FORMS, text, hint(word.lower(), tuple(colors.CSS4_COLORS)))
    return _as_rgb(colors.to_rgb(names[word.lower()])), True


def _of_numbers(owner: str, name: str, given: Any, values: Any) -> Rgb:
    """Return three numbers. Raises InputError, which shows what was `given`."""
    try:
        found = [float(each) for each in values]
    except (TypeError, ValueError):
        found = []
    if len(found) != 3 or not all(0.0 <= each <= _MOST for each in found):
        raise value_error(owner, name, FORMS, given)
    return _as_rgb(found)


def _as_rgb(values: Any) -> Rgb:
    red, green, blue = (float(each) for each in values)
    return red, green, blue
