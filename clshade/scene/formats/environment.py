"""Environments from image files: EXR, Radiance HDR and PNG."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...base.atomic_files import Path, shown
from ...base.input_files import file_error, first_bytes, read_file
from ...base.validation import arguments
from ...base.validation import path as checked_path
from ...images import radiance
from ...images.image_file import SIGNATURES, read_picture
from ..environment import MAX_RADIANCE, MAX_SIDE, Environment, bad_radiance

MAX_BYTES = 1 << 30  # of a Radiance file
MAX_PIXELS = 1 << 27  # 16384 x 8192


@arguments(path=checked_path)
def load_environment(path: Path, **fields: Any) -> Environment:
    """Load an environment from an image in latitude and longitude, of any size.

    Parameters
    ----------
    path : str or path-like
        An EXR (linear), a Radiance HDR image, or a PNG, which is decoded from sRGB; recognized by
        its content. Gray is allowed, alpha is left out.
    **fields
        Other fields of `Environment`; `name` is by default the file's.

    Raises
    ------
    InputError
        The file cannot be read or holds no color; one line that names it.

    Warns
    -----
    UserWarning
        Some pixels are no radiance: NaN and negative values count as 0, values beyond 1e30 and
        infinity as 1e30 or the largest other value, whichever is less. Or the image is not twice as
        wide as high, and is stretched over the sphere.
    """
    owner = shown(path)
    image = _image(path, owner)
    rows, columns, _ = image.shape
    if abs(columns - 2 * rows) > 1:
        warnings.warn(
            f"{owner}: image: expected one twice as wide as high, found {columns} x {rows}: stretched", stacklevel=3
        )
    bad = bad_radiance(image)
    if bad:
        warnings.warn(f"{owner}: image: {bad}: replaced by the nearest radiance", stacklevel=3)
        image = np.where(image > 0.0, image, 0.0)  # NaN is not above 0
        within = image <= MAX_RADIANCE
        largest = float(image[within].max(initial=0.0))
        image = np.where(within, image, largest or MAX_RADIANCE)
    return Environment(image, **{"name": owner, **fields})


def _image(path: Path, owner: str) -> Array:
    """Return (h, w, 3) linear floats, float32 or float64."""
    begin = first_bytes(path, max(map(len, SIGNATURES)))
    if begin.startswith(radiance.SIGNATURE):
        return radiance.decode(read_file(path, MAX_BYTES), owner, max_side=MAX_SIDE, max_pixels=MAX_PIXELS)
    if not begin.startswith(SIGNATURES):
        raise file_error(owner, "file", "an EXR, Radiance HDR or PNG image", "something else")
    picture = read_picture(path)
    rows, columns = picture.shape
    if max(rows, columns) > MAX_SIDE or rows * columns > MAX_PIXELS:
        expected = f"at most {MAX_SIDE} pixels a side and {MAX_PIXELS} in all"
        raise file_error(owner, "image", expected, f"{columns} x {rows}")
    color = picture.color()
    if color is None:
        raise file_error(owner, "channels", "a color: R, G, B or Y", ", ".join(picture.channels)[:60])
    return color[1].astype(np.promote_types(color[1].dtype, np.float32), copy=False)
