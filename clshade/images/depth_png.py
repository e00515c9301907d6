"""Depth as a 16-bit gray PNG: code times scale is the depth, code 0 the background. Through Pillow."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from ..base.arrays import Array, Floats
from ..base.atomic_files import Path, shown
from ..base.input_files import file_error
from ..base.validation import number, value_error

SCALE = 1e-3  # scene units of a step: millimeters where the unit is the meter
MAX_CODE = (1 << 16) - 1  # the largest code
_KEY = "depthScale"  # of the text chunk with the scale
_ARGUMENT = ("Frame.save", "depth_scale")  # that errors name


def codes(depth: Array, scale: float = SCALE) -> np.ndarray:
    """Return the uint16 codes of depths of any shape: depth / scale, rounded; 0 where the depth is infinite.

    depth: reals, along the viewing direction, infinite in the background. scale: scene units of a step.
    Raises InputError if a depth would have no code from 1 to 65535.
    """
    scale = number(*_ARGUMENT, scale, above=0.0)
    is_finite = np.isfinite(depth)
    steps = np.zeros(depth.shape)
    with np.errstate(over="ignore"):
        np.divide(depth, scale, out=steps, where=is_finite)
    np.rint(steps, out=steps)
    finite = steps[is_finite]
    if finite.size and finite.max() > MAX_CODE:
        farthest = float(depth[is_finite].max())
        minimum = float(f"{farthest / MAX_CODE * 1.05:.1e}")  # two digits, which round by 5 % at most
        expected = f"{minimum:g} or more, as {MAX_CODE} steps have to reach depths of {farthest:.6g}"
        raise value_error(*_ARGUMENT, expected, scale)
    if finite.size and finite.min() < 1:
        nearest = float(depth[is_finite].min())
        raise value_error(*_ARGUMENT, f"steps of which depths of {nearest:.6g} have one at least", scale)
    return steps.astype(np.uint16)


def encode(file: BinaryIO, depth: Array, scale: float = SCALE) -> None:
    """Encode depths (M, N) as a 16-bit gray PNG into an open file, its scale in a text chunk; see `codes`.

    The same depths give the same bytes.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    gray = codes(depth, scale)
    about = PngInfo()
    about.add_text(_KEY, repr(float(scale)))
    about.add_text("Description", f"depth along the viewing direction: code * {float(scale)!r}; 0 is the background")
    Image.fromarray(gray).save(file, "PNG", pnginfo=about, compress_level=1)


def read(path: Path) -> tuple[Floats, float]:
    """Read a depth PNG that `encode` wrote.

    Returns (depth, scale): float64 (M, N), infinite in the background, row 0 at the top; scene units of a step.
    Raises InputError, one line naming the file, if it is missing, damaged, or no 16-bit PNG with a scale.
    """
    from .decode import read_png

    owner = shown(path)
    gray, header = read_png(path)
    is_gray = gray.dtype == np.uint16 and gray.shape[2] == 1
    if not is_gray or _KEY not in header:
        channels = "none" if is_gray else f"channels: {gray.shape[2]} of {8 * gray.itemsize} bits"
        raise file_error(owner, "file", f"a 16-bit gray PNG with a text {_KEY}", channels)
    try:
        scale = number(owner, _KEY, float(header[_KEY]), above=0.0)
    except ValueError:
        raise file_error(owner, _KEY, "a number above 0", repr(header[_KEY])) from None
    depth: Floats = np.where(gray == 0, np.inf, gray * scale)[:, :, 0]
    return depth, scale
