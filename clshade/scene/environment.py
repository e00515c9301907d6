"""Environments: light from all around a scene, as an image in latitude and longitude."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Array, Converted, Floats, Floats32, Vector
from ..base.declare import checked, record, required
from ..base.validation import floats, number, read_only, text, value_error, vector

MAX_SIDE = 32768  # pixels
MAX_RADIANCE = 1e30  # sums over all pixels stay within float32's range


def _image(owner: str, name: str, value: Any) -> Floats32:
    expected = "an array of shape (h, w, 3)"
    image = floats(owner, name, value, expected)
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape or max(image.shape) > MAX_SIDE:
        raise value_error(owner, name, f"{expected} with h and w from 1 to {MAX_SIDE}", image)
    if image.dtype.kind in "iu":
        image = image / np.float32(np.iinfo(image.dtype).max)
    image = image.astype(np.promote_types(image.dtype, np.float32), copy=False)  # half floats do not reach 1e30
    if bad := bad_radiance(image):
        raise value_error(owner, name, "numbers from 0 to 1e30", bad)
    return read_only(np.ascontiguousarray(image, np.float32).view())


def _up(owner: str, name: str, value: Any) -> Floats:
    up = vector(owner, name, value)
    if not up.any():
        raise value_error(owner, name, "a direction other than 0", value)
    up = up / float(np.abs(up).max())  # squares of it are in range
    return read_only(up / math.sqrt(float(up @ up)))


@record
class Environment:
    """Light that comes from infinitely far away, from every direction: an image-based light.

    Attributes
    ----------
    image : array_like, (h, w, 3)
        Linear RGB radiance in latitude and longitude, from 0 to 1e30; row 0 is the top. Integers
        are divided by their type's maximum. Kept as float32.
    rotation : float, default 0
        Degrees by which the environment is turned about `up`, counterclockwise seen from above.
    intensity : float, default 1
        Factor of the radiance, from 0 to 1e30.
    up : array_like, (3,), default (0, 1, 0)
        Direction that the top row shows, world space. Kept as a unit vector.
    name : str, default ""
        Name of the environment.

    Notes
    -----
    The convention is that of OpenEXR (ImfEnvmap.h): with `up` +y and no rotation the center of the
    image is +z, and +x is halfway between the center and the left edge, so that from the inside
    nothing is mirrored. For other directions of `up` the whole is turned by the smallest rotation
    from +y to `up`: with +z the center is -y. Every pixel is of constant radiance. Images with NaN,
    infinite or negative pixels are refused; `scene.formats.environment` replaces those of files.
    """

    image: Converted[ArrayLike, Floats32] = required(check=_image)
    rotation: float = checked(0.0, number)
    intensity: float = checked(1.0, partial(number, least=0.0, most=MAX_RADIANCE, expected="a number from 0 to 1e30"))
    up: Vector = checked((0.0, 1.0, 0.0), _up)
    name: str = checked("", text)

    @property
    def axes(self) -> Floats:
        """The directions, rows, of the image's center, of a quarter to its left, and of its top; rotation included."""
        turn = _smallest_rotation(self.up)
        front, left = turn @ (0.0, 0.0, 1.0), turn @ (1.0, 0.0, 0.0)
        angle = math.radians(math.fmod(self.rotation, 360.0))
        cosine, sine = math.cos(angle), math.sin(angle)
        return np.stack([cosine * front + sine * left, cosine * left - sine * front, self.up])

    def __repr__(self) -> str:
        rows, columns, _ = self.image.shape
        return f"<Environment {self.name or 'unnamed'}: {columns}x{rows}>"


def nearest_axis(direction: Floats) -> tuple[float, float, float]:
    """Return the axis, one of +-x, +-y, +-z, that is nearest to a direction (3,)."""
    axis = [0.0, 0.0, 0.0]
    largest = int(np.abs(direction).argmax())
    axis[largest] = math.copysign(1.0, direction[largest])
    return axis[0], axis[1], axis[2]


def bad_radiance(image: Array) -> str:
    """Return a few words about the first kind of pixels that is no radiance, "" if there are none. image: (h, w, 3) of
    float32 or wider."""
    if 0.0 <= image.min() <= image.max() <= MAX_RADIANCE:  # false for NaN
        return ""
    for wrong, what in ((np.isnan(image), "NaN"), (image > MAX_RADIANCE, "beyond 1e30"), (image < 0.0, "negative")):
        if pixels := int(wrong.any(axis=2).sum()):
            return f"{pixels} {'pixel' if pixels == 1 else 'pixels'} that {'is' if pixels == 1 else 'are'} {what}"
    return ""


def _smallest_rotation(up: Floats) -> Floats:
    """Return the (3, 3) rotation from +y to the unit vector `up`; half a turn about z for -y."""
    x, y, z = (float(c) for c in up)
    square = x * x + z * z
    if y < 0.0 and square == 0.0:
        return np.diag([-1.0, -1.0, 1.0])
    # Rodrigues' formula with the axis (z, 0, -x), whose length is the sine: k = (1 - cos)/sin^2.
    k = 1.0 / (1.0 + y) if y > 0.0 else (1.0 - y) / square
    return np.array([[1.0 - k * x * x, x, -k * x * z], [-x, y, -z], [-k * x * z, z, 1.0 - k * z * z]])
