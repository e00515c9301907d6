"""The points that stand for lights of finite size, and how far each pixel shifts them.

Coordinates in the unit square are whole numbers of 2^-32, modulo 2^32: what kernels and oracle have in common. Where a point
is, as seen from a receiver, is computed here from these.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Floats, Integers
from .transform import SAMPLE_STEPS
from .vectors import cross, dot, length, unit

WHOLE = 2**32
GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0
# The real solution of g^5 = g + 1: its powers 1/g to 1/g^4 are the steps of the R4 sequence (M. Roberts, The unreasonable
# effectiveness of quasirandom sequences, 2018).
GENERALIZED_RATIO = 1.1673039782614187
POLE = -np.array([2.0, 3.0, 5.0]) / np.sqrt(38.0)  # normal of a sphere's disc before it is mirrored


def coordinates(points: int) -> Integers:
    """Return (N, 2) int64: u = (i + 1/2)/N and v = 1/2 + (i - (N - 1)/2)/phi, each step rounded."""
    i = np.arange(points)
    step = round(WHOLE / GOLDEN_RATIO)
    u = WHOLE // (2 * points) + i * (WHOLE // points)
    v = WHOLE // 2 - (points - 1) * step // 2 + i * step
    return np.asarray(np.stack([u, v], axis=1) % WHOLE)


def shifts(place: Integers) -> Integers:
    """Return by how much the pixels shift u and v, (K, 2). place: (K, 2) where they are lit, 1/256 px from the lower left
    corner of the image."""
    pixel, part = np.divmod(np.asarray(place, np.int64), SAMPLE_STEPS)
    step = [2**8 * round(2**24 / GENERALIZED_RATIO**power) for power in (1, 2, 3, 4)]
    u = pixel[:, 0] * step[0] + pixel[:, 1] * step[3] + part[:, 1] * (WHOLE // SAMPLE_STEPS)
    v = pixel[:, 0] * step[2] + pixel[:, 1] * step[1] + part[:, 0] * (WHOLE // SAMPLE_STEPS)
    return np.asarray(np.stack([u, v], axis=1) % WHOLE)


def fractions(wholes: Integers) -> Floats:
    """Return numbers between 0 and 1: odd multiples of 2^-24."""
    return np.asarray((wholes // 2**8 // 2 * 2 + 1) / 2.0**24)


def on_rectangle(uv: Integers, sides: Floats) -> Floats:
    """Return points (..., 3) from a rectangle's center. uv: (..., 2). sides: (2, 3), halves of them."""
    along = 2.0 * fractions(uv) - 1.0
    return np.asarray(along[..., :1] * sides[0] + along[..., 1:] * sides[1])


def on_disc(uv: Integers, radius: float, to_receiver: Floats) -> Floats:
    """Return points (..., 3) from a sphere's center, on its disc at right angles to vectors to_receiver (..., 3): u is the
    square of the distance over the radius, v the angle, in steps of 2^-26 of a turn.

    The disc lies at right angles to `POLE`, and is mirrored in the plane halfway to to_receiver.
    """
    distance, angle = radius * np.sqrt(fractions(uv[..., 0])), 2.0 * np.pi * (uv[..., 1] // 2**6) / 2.0**26
    first = np.array([3.0, -2.0, 0.0]) / np.sqrt(13.0)
    flat = (distance * np.cos(angle))[..., None] * first + (distance * np.sin(angle))[..., None] * cross(POLE, first)
    normal = halfway(to_receiver)
    return np.asarray(flat - 2.0 * dot(flat, normal)[..., None] * normal)


def halfway(to_receiver: Floats) -> Floats:
    """Return the normal (..., 3) of the plane in which a disc is mirrored: unit, 0 where none is needed."""
    return unit(POLE + unit(to_receiver))


def amplified(to_receiver: Floats, size: Array) -> Floats:
    """Return how far rounding may move the points of a sphere's disc, (...), over its radius, in units of which one is an
    error 2^-24. size: (...) the largest coordinate that to_receiver is a difference of.

    A direction w to the receiver that is off by d turns the sum of `POLE` and w by d over its length, and mirrored vectors
    by twice that, on either side.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        direction = np.fmax(size / length(to_receiver), 1.0)
        found: Floats = 1.0 + 4.0 * direction / length(POLE + unit(to_receiver))
        return found
