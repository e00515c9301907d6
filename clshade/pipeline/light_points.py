"""The points that stand for lights of finite size.

Point i of N lies in the unit square at u = (i + 1/2)/N and v = 1/2 + (i - (N - 1)/2)/phi modulo 1, phi the golden ratio: the
places of the samples of a pixel (sample_pattern.py), in fractions of 2^32. Each pixel shifts all of them, modulo 1, by its
column and row times `struct_layout.LIGHT_SHIFTS`, in u by the height and in v by the distance from the left at which it is
sampled, fractions of a pixel. On a rectangle u and v are coordinates; on a disc u is the square of the distance from the
center, v the angle (H. Vogel, A better way to construct the sunflower head, Mathematical Biosciences 44, 1979).
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats
from ..scene.lights import PlacedLight
from .sample_pattern import GOLDEN

_ONE = 1 << 32
# The discs of spheres are mirrored from a plane at right angles to this to one that faces the receiver. A receiver just
# opposite is ill-conditioned: hence no axis or diagonal that scenes have.
AXIS = np.array([-2.0, -3.0, -5.0]) / 38.0**0.5


def pattern(points: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return u and v of the first point, and from point to point, fractions of 2^32."""
    step_v = round(_ONE * GOLDEN)
    first_v = (_ONE // 2 - (points - 1) * step_v // 2) % _ONE
    return (_ONE // (2 * points) % _ONE, first_v), (_ONE // points % _ONE, step_v)


def write_pattern(row: np.void, points: int) -> None:
    """Write the pattern of so many points into a row of structs.Light."""
    first, step = pattern(points)
    row["first_point"], row["point_step"] = (np.array(each, np.uint32).view(np.int32) for each in (first, step))


def sides_of(light: PlacedLight) -> Floats:
    """Return (2, 3): half the sides of a flat light, or two radii of a sphere's disc that `AXIS` is normal to; 0 of a light
    without a size."""
    return light.radius * disc_radii() if light.sides is None else light.sides


def disc_radii() -> Floats:
    """Return (2, 3): two radii at right angles of the unit disc that `AXIS` is normal to."""
    first = np.array([3.0, -2.0, 0.0]) / 13.0**0.5
    return np.stack([first, np.cross(AXIS, first)])
