"""The exact sign of a determinant: float64 where its error bound allows, integers where it does not."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..base.arrays import Floats, Integers
from .vectors import cross, dot, power_of_two

# Of the sum of the magnitudes of a determinant's six products: three differences, a product and a difference of each
# minor, a product and two sums are 8 roundings of at most 2^-53 each. As much again is left for those of that sum itself.
SURE = 16.0 * 2.0**-53


def orientation(a: Floats, b: Floats, c: Floats, d: Floats) -> Integers:
    """Return the sign (K,) of the volume (b - a) x (c - a) . (d - a) of points (K, 3): 1 where d lies on the side from which
    a, b, c run counter-clockwise, 0 where the four lie in a plane.

    J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997: what the
    rounding of float64 leaves open is decided exactly.
    """
    a, b, c, d = np.broadcast_arrays(*(np.atleast_2d(np.asarray(v, np.float64)) for v in (a, b, c, d)))
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        p, q, r = b - a, c - a, d - a
        scale = power_of_two(np.maximum(np.maximum(np.abs(p), np.abs(q)), np.abs(r)))[:, None]
        p, q, r = p / scale, q / scale, r / scale
        volume, most = dot(cross(p, q), r), dot(_magnitudes(np.abs(p), np.abs(q)), np.abs(r))
        sure = np.abs(volume) > SURE * most + 1e-290
    found: Integers = np.sign(np.where(sure, volume, 0.0)).astype(np.int64)
    for k in np.flatnonzero(~sure):
        found[k] = _exact(*(tuple(point[k].tolist()) for point in (a, b, c, d)))
    return found


def _magnitudes(a: Floats, b: Floats) -> Floats:
    """Return the sums of the products whose differences are the vector product of non-negative vectors."""
    total: Floats = np.stack([a[..., (i + 1) % 3] * b[..., (i + 2) % 3] for i in range(3)], axis=-1)
    total = total + np.stack([a[..., (i + 2) % 3] * b[..., (i + 1) % 3] for i in range(3)], axis=-1)
    return total


@lru_cache(1 << 18)  # rays from a face meet the same others
def _exact(*points: tuple[float, ...]) -> int:
    ratios = [x.as_integer_ratio() for point in points for x in point]
    unit = max(below for _, below in ratios)  # all are powers of two
    whole = [above * (unit // below) for above, below in ratios]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (
        [x - y for x, y in zip(whole[k : k + 3], whole[:3], strict=True)] for k in (3, 6, 9)
    )
    volume = cx * (ay * bz - az * by) + cy * (az * bx - ax * bz) + cz * (ax * by - ay * bx)
    return (volume > 0) - (volume < 0)
