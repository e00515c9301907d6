"""Depth as a 16-bit gray PNG: code times scale is the depth, code 0 the background. Through Pillow."""

from __future__ import annotations

import io
from typing import BinaryIO

import numpy as np

from ..base.arrays import Array, Floats
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error, read_file, reason_of
from ..base.validation import number, value_error

SCALE = 1e-3  # scene units of a step: millimeters where the unit is the meter
MOST = (1 << 16) - 1  # the largest code
_KEY = "depthScale"  # of the text chunk with the scale
_MAX_BYTES = 1 << 31  # size of the largest file that is read


def checked_scale(who: str, name: str, value: float) -> float:
    """Return a scale as a float. Raises InputError, naming `who` and `name`, unless it is a finite number above 0."""
    return number(who, name, value, above=0.0)


def codes(depth: Array, scale: float = SCALE, asked: tuple[str, str] = ("depth_png", "scale")) -> np.ndarray:
    """Return the codes of depths, uint16 of the same shape: depth / scale, rounded; 0 where the depth is infinite.

    depth: reals, along the viewing direction, infinite in the background. scale: scene units of a step.
    asked: function and argument that errors name.
    Raises InputError if a depth would have no code from 1 to 65535.
    """
    scale = checked_scale(*asked, scale)
    seen = np.isfinite(depth)
    steps = np.zeros(depth.shape)
    with np.errstate(over="ignore"):
        np.divide(depth, scale, out=steps, where=seen)
    np.rint(steps, out=steps)
    found = steps[seen]
    if found.size and found.max() > MOST:
        farthest = float(depth[seen].max())
        least = float(f"{farthest / MOST * 1.05:.1e}")  # two digits, which round by 5 % at most
        raise value_error(*asked, f"{least:g} or more, as {MOST} steps have to reach depths of {farthest:.6g}", scale)
    if found.size and found.min() < 1:
        nearest = float(depth[seen].min())
        raise value_error(*asked, f"steps of which depths of {nearest:.6g} have one at least", scale)
    return steps.astype(np.uint16)


def encode(file: BinaryIO, depth: Array, scale: float = SCALE, asked: tuple[str, str] = ("depth_png", "scale")) -> None:
    """Encode depths (M, N) as a 16-bit gray PNG into an open file, its scale in a text chunk; see `codes`.

    The same depths give the same bytes.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    gray = codes(depth, scale, asked)
    about = PngInfo()
    about.add_text(_KEY, repr(float(scale)))
    about.add_text("Description", f"depth along the viewing direction: code * {float(scale)!r}; 0 is the background")
    Image.fromarray(gray).save(file, "PNG", pnginfo=about, compress_level=1)


def read(path: Path) -> tuple[Floats, float]:
    """Read a depth PNG that `encode` wrote.

    Returns (depth, scale): float64 (M, N), infinite in the background, row 0 at the top; scene units of a step.
    Raises InputError, one line naming the file, if it is missing, damaged, or no 16-bit PNG with a scale.
    """
    from PIL import PngImagePlugin

    owner = shown(path)
    data = read_file(path, _MAX_BYTES)
    try:
        with PngImagePlugin.PngImageFile(io.BytesIO(data)) as image:
            mode, text = image.mode, image.text
            gray = np.asarray(image)
    except Exception as error:  # decoders raise exceptions of many types on damaged files
        raise file_error(owner, "file", "a PNG image", reason_of(error) or "damaged data") from None
    if not mode.startswith("I") or _KEY not in text:
        raise file_error(owner, "file", f"a 16-bit gray PNG with a text {_KEY}", f"mode {mode}")
    try:
        scale = checked_scale(owner, _KEY, float(text[_KEY]))
    except ValueError:
        raise file_error(owner, _KEY, "a number above 0", repr(text[_KEY])) from None
    return np.where(gray == 0, np.inf, gray * scale), scale
