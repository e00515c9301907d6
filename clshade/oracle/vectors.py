"""Vector arithmetic of the oracle: float64, three components in the last axis, safe at any scale."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Floats


def dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar product, summed as (a0*b0 + a1*b1) + a2*b2."""
    return (a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]) + a[..., 2] * b[..., 2]


def cross(a: Floats, b: Floats) -> Floats:
    """Return the vector product; cross(b, a) is exactly -cross(a, b)."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def power_of_two(v: Floats) -> Floats:
    """Return a power of two of the size of the largest component of v, 1 where v is 0. Dividing by it is exact."""
    largest = np.maximum(np.maximum(np.abs(v[..., 0]), np.abs(v[..., 1])), np.abs(v[..., 2]))
    _, exponent = np.frexp(largest)
    power: Floats = np.ldexp(1.0, np.clip(exponent, -1000, 1000))
    return power


def length(v: Floats) -> Floats:
    """Return the Euclidean length; no intermediate result of 1e-200 or 1e200 under- or overflows."""
    scale = power_of_two(v)
    w = v / scale[..., None]
    return np.sqrt(dot(w, w)) * scale


def unit(v: Floats) -> Floats:
    """Return v divided by its length; the zero vector stays zero."""
    w = v / power_of_two(v)[..., None]
    size = np.sqrt(dot(w, w))
    return w / np.where(size > 0.0, size, 1.0)[..., None]
