"""Diffuse light of an environment, spherical harmonics up to order 2; and the directions and solid angles of its pixels.

Ramamoorthi and Hanrahan, An Efficient Representation for Irradiance Environment Maps, SIGGRAPH 2001: the cosine lobe
damps order l of the radiance by A_l/pi = 1, 2/3, 1/4, 0, -1/24, ..., so that orders 0 to 2 hold nearly all of the
irradiance. They are moments of the radiance: with M0 = sum L, M1 = sum L w, M2 = sum L w w^T over the sphere,

    E(n)/pi = M0/4pi + (2/3)(3/4pi) M1.n + (1/4)(5/4pi)(3/2 n.M2 n - 1/2 M0).
"""

from __future__ import annotations

import numpy as np

from ...base.arrays import Floats
from ..environment import Environment


def row_edges(rows: int) -> Floats:
    """Return the angles from the top, (rows + 1,), between which the rows lie."""
    return np.linspace(0.0, np.pi, rows + 1)


def column_edges(columns: int) -> Floats:
    """Return the longitudes, (columns + 1,), between which the columns lie: from pi on the left to -pi."""
    return np.linspace(np.pi, -np.pi, columns + 1)


def solid_angles(rows: int, columns: int) -> Floats:
    """Return the solid angle of the pixels of each row, (rows,), steradian."""
    edges = row_edges(rows)
    middle = (edges[1:] + edges[:-1]) / 2.0
    return np.asarray(2.0 * np.sin(middle) * np.sin(np.pi / (2.0 * rows)) * (2.0 * np.pi / columns))


def radiance(environment: Environment, directions: Floats) -> Floats:
    """Return the radiance (..., 3) from directions (..., 3) of any length but 0, each of its own pixel."""
    rows, columns, _ = environment.image.shape
    front, left, up = np.moveaxis(directions @ environment.axes.T, -1, 0)
    u = 0.5 - np.arctan2(left, front) / (2.0 * np.pi)
    v = np.arctan2(np.hypot(front, left), up) / np.pi
    row = np.minimum((v * rows).astype(np.int64), rows - 1)
    column = np.minimum((u * columns).astype(np.int64), columns - 1)
    return np.asarray(environment.image[row, column].astype(np.float64) * environment.intensity)


def moments(environment: Environment) -> tuple[Floats, Floats, Floats]:
    """Return the integrals over the sphere of L, L w and L w w^T: (3,), (3, 3) and (3, 3, 3), channels first.

    Exact for pixels of constant radiance but for rounding: each factor is integrated in closed form.
    """
    rows, columns, _ = environment.image.shape
    polar, around = row_edges(rows), column_edges(columns)
    sine, cosine = np.sin(polar), np.cos(polar)

    def over_columns(integral: Floats) -> Floats:
        return -np.diff(integral)  # longitudes fall from left to right

    longitude = np.stack(
        [
            over_columns(around),  # 1
            over_columns(np.sin(around)),  # cos
            over_columns(-np.cos(around)),  # sin
            over_columns(around / 2.0 + np.sin(2.0 * around) / 4.0),  # cos^2
            over_columns(around / 2.0 - np.sin(2.0 * around) / 4.0),  # sin^2
            over_columns(np.sin(around) ** 2 / 2.0),  # cos sin
        ],
        axis=1,
    )
    # One row at a time, so that nothing as large as the image is needed in float64.
    sums = np.stack([row.T.astype(np.float64) @ longitude for row in environment.image])  # (rows, 3, 6)
    s1, sc = np.diff(-cosine), np.diff(sine**2 / 2.0)
    s2 = np.diff(polar / 2.0 - np.sin(2.0 * polar) / 4.0)
    s2c, scc, s3 = np.diff(sine**3 / 3.0), np.diff(-(cosine**3) / 3.0), np.diff(cosine**3 / 3.0 - cosine)

    def total(part: Floats, factor: int) -> Floats:
        return np.asarray(part @ sums[:, :, factor]) * environment.intensity

    zeroth = total(s1, 0)
    first = np.stack([total(s2, 1), total(s2, 2), total(sc, 0)], axis=1)
    ff, ll, fl = total(s3, 3), total(s3, 4), total(s3, 5)
    fu, lu, uu = total(s2c, 1), total(s2c, 2), total(scc, 0)
    second = np.stack([np.stack([ff, fl, fu], 1), np.stack([fl, ll, lu], 1), np.stack([fu, lu, uu], 1)], axis=1)
    axes = environment.axes
    return zeroth, first @ axes, axes.T @ second @ axes


def irradiance_coefficients(environment: Environment) -> Floats:
    """Return (9, 3): the factors of x, y, z, xx, yy, zz, xy, yz, zx of a unit normal whose sum is E/pi per channel."""
    zeroth, first, second = moments(environment)
    linear = first / (2.0 * np.pi)
    square = (15.0 / (32.0 * np.pi)) * second
    # The constant term goes to the squares, of which the sum is 1.
    square = square + (zeroth / (4.0 * np.pi) - (5.0 / (32.0 * np.pi)) * zeroth)[:, None, None] * np.eye(3)
    xx, yy, zz = square[:, 0, 0], square[:, 1, 1], square[:, 2, 2]
    xy, yz, zx = 2.0 * square[:, 0, 1], 2.0 * square[:, 1, 2], 2.0 * square[:, 2, 0]
    return np.stack([*linear.T, xx, yy, zz, xy, yz, zx])


def irradiance_at(coefficients: Floats, normal: Floats) -> Floats:
    """Return E/pi per channel, (3,), for a unit normal (3,). coefficients: of `irradiance_coefficients`. At least 0."""
    x, y, z = normal
    return np.maximum(np.array([x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]) @ coefficients, 0.0)
