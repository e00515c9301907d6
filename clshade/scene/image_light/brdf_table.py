"""The second factor of the split sum: how much light of an all-white environment a surface sends to the eye.

With f = D V F of glTF 2.0 (appendix B): GGX, height-correlated Smith visibility, Schlick's F = F0 + (1 - F0) s with
s = (1 - V.H)^5, the integral of f N.L over the hemisphere is F0 A + B:

    A = integral of D V (1 - s) N.L,   B = integral of D V s N.L.

A third number belongs to the diffuse term below the specular layer, (1 - F)/pi: its integral is (1 - F0) C with
C = integral of (1 - s) N.L/pi, whatever the roughness.
"""

from __future__ import annotations

import functools

import numpy as np

from ...base.arrays import Floats

SIDE = 32  # entries along each axis
POINTS = 48  # of the quadrature along each angle


@functools.cache
def brdf_table() -> Floats:
    """Return (SIDE, SIDE, 3) float64, read-only: A, B and C, by roughness (rows) and N.V (columns) from 0 to 1."""
    steps = np.linspace(0.0, 1.0, SIDE)
    table = np.stack([np.stack(split_sum(steps, roughness), axis=-1) for roughness in steps])
    table.flags.writeable = False
    return table


def split_sum(n_v: Floats, roughness: float, points: int = POINTS) -> tuple[Floats, Floats, Floats]:
    """Return A, B and C (...) for cosines n_v (...) and a roughness, with points^2 directions each."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    share, weight = (nodes + 1.0) / 2.0, weights[:, None] / (2.0 * points)
    azimuth = np.cos((np.arange(points) + 0.5) * (np.pi / points))
    n_v = np.asarray(n_v, np.float64)[..., None, None]
    tangent = np.sqrt(1.0 - n_v * n_v)
    a2 = roughness**4
    # Half vectors of GGX's density D N.H: their share below cos is (1 - cos^2) / (1 + cos^2 (a^2 - 1)), inverted.
    cosine2 = ((1.0 - share) / (1.0 + (a2 - 1.0) * share))[:, None]
    n_h = np.sqrt(cosine2)
    v_h = np.maximum(tangent * np.sqrt(1.0 - cosine2) * azimuth + n_v * n_h, 0.0)
    n_l = np.maximum(2.0 * v_h * n_h - n_v, 0.0)
    smith = n_l * np.sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * np.sqrt(n_l * n_l * (1.0 - a2) + a2)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.where(n_l > 0.0, 2.0 * v_h * n_l / (n_h * smith), 0.0) * weight  # D V N.L over the density of l
    fresnel = (1.0 - v_h) ** 5
    a, b = ((seen * part).sum(axis=(-2, -1)) for part in (1.0 - fresnel, fresnel))
    grazing = n_v[..., 0, 0] == 0.0
    if a2 == 0.0:  # a mirror, at grazing angles too
        a, b = np.where(grazing, 0.0, a), np.where(grazing, 1.0, b)
    # The diffuse term: N.L^2 is uniform under the cosine's density.
    n_l = np.sqrt(share)[:, None]
    l_v = tangent * np.sqrt(1.0 - n_l * n_l) * azimuth + n_v * n_l
    c = ((1.0 - (1.0 - np.sqrt((1.0 + l_v) / 2.0)) ** 5) * weight).sum(axis=(-2, -1))
    return a, b, c
