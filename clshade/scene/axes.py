"""The axes of a camera in world space, from its eye, what it looks at and what points up.

Plain floats: for one camera NumPy's overhead would make it ten times as slow.
"""

from __future__ import annotations

import math

from ..base.validation import value_error


def axes_of(eye: list[float], lookat: list[float], up: list[float]) -> tuple[tuple[float, float, float], ...]:
    """Return right, up and the viewing direction, the rows of `geometry.look_at`, which says more. Raises InputError."""
    z = _unit(*(0.5 * b - 0.5 * a for a, b in zip(eye, lookat, strict=True)))
    if not any(z):
        raise value_error("look_at", "lookat", "a point other than eye", lookat)
    exponent = math.frexp(max(map(abs, up)))[1]
    u = [math.ldexp(value, -exponent) for value in up]
    along = (u[0] * z[0] + u[1] * z[1]) + u[2] * z[2]
    across = [a - along * b for a, b in zip(u, z, strict=True)]
    if max(map(abs, across)) <= 1e-12:
        raise value_error("look_at", "up", "a vector not parallel to lookat - eye", up)
    y = _unit(*across)
    x = (z[1] * y[2] - z[2] * y[1], z[2] * y[0] - z[0] * y[2], z[0] * y[1] - z[1] * y[0])
    return x, y, z


def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Normalize a vector of any finite length; the zero vector is kept."""
    exponent = math.frexp(max(abs(x), abs(y), abs(z)))[1]
    x, y, z = (math.ldexp(value, -exponent) for value in (x, y, z))
    length = math.sqrt(x * x + y * y + z * z) or 1.0
    return x / length, y / length, z / length
