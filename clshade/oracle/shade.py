"""Interpolation weights, the Phong reflection model, and how well conditioned the model is at a point.

Every function broadcasts over leading axes: points, directions and colors are (..., 3).
"""

from __future__ import annotations

import numpy as np

from .vectors import Array, dot, length, unit

GATE = 1e-6  # |N.L| or |R.V| below this: float32 may decide the highlight's gate otherwise


def barycentrics(edges: Array, z: Array, interpolation: str) -> Array:
    """Weights (..., 3) of a triangle's corners at a point, from edge functions and corner depths, both (..., 3).

    `affine`: linear in the image. `perspective`: linear in space. They sum to 1.
    """
    share = np.asarray(edges, dtype=np.float64)
    if interpolation == "perspective":
        share = share / z
    return share / (share[..., 0] + share[..., 1] + share[..., 2])[..., None]


def barycentric_steps(edges: Array, steps: Array, z: Array, interpolation: str) -> Array:
    """By how much the weights of `barycentrics` change (..., 3) where the edge functions change by steps (..., 3): their
    derivative, by the quotient rule."""
    share, step = np.asarray(edges, np.float64), np.asarray(steps, np.float64)
    if interpolation == "perspective":
        share, step = share / z, step / z
    total, total_step = share.sum(axis=-1, keepdims=True), step.sum(axis=-1, keepdims=True)
    return (step * total - share * total_step) / (total * total)


def depth(edges: Array, z: Array, orthographic: bool = False) -> Array:
    """Depth (...) at a point of a triangle: 1/z is linear in the image; in parallel projection z is."""
    edges = np.asarray(edges, dtype=np.float64)
    if orthographic:
        share = edges * z
        return (share[..., 0] + share[..., 1] + share[..., 2]) / (edges[..., 0] + edges[..., 1] + edges[..., 2])
    inverse = edges / z
    return (edges[..., 0] + edges[..., 1] + edges[..., 2]) / (inverse[..., 0] + inverse[..., 1] + inverse[..., 2])


def angles(point: Array, normal: Array, eye: Array, light_position: Array) -> tuple[Array, Array, Array]:
    """N.L, R.V and |R-V|^2, each (...), with N, L and V normalized (0 stays 0) and R = 2N(N.L) - L."""
    n, towards_light, view = unit(normal), unit(light_position - point), unit(eye - point)
    n_l = dot(n, towards_light)
    mirrored = 2.0 * n * n_l[..., None] - towards_light
    difference = mirrored - view
    return n_l, dot(mirrored, view), dot(difference, difference)


def highlight(r_v: Array, distance2: Array, n: Array) -> Array:
    """(R.V)^n where R.V > 0, else 0, from R.V and |R-V|^2; 0^0 does not occur.

    Near 1 the power is taken of 1 - |R-V|^2/2, which is R.V without the cancellation: with n = 1e9 the rounding of
    R.V itself would cost seven digits.
    """
    base = np.where(r_v > 0.0, r_v, 1.0)
    logarithm = np.where(distance2 < 1.0, np.log1p(-0.5 * np.minimum(distance2, 1.0)), np.log(base))
    return np.where(r_v > 0.0, np.exp(n * logarithm), 0.0)


def reflected(
    point: Array,
    normal: Array,
    eye: Array,
    kd: Array,
    ks: Array,
    n: Array,
    light_positions: Array,
    light_intensities: Array,
) -> Array:
    """What the lights give a white surface: sum of Ip*(kd*max(0, N.L) + ks*(R.V)^n), (..., 3).

    light_positions and light_intensities: (L, 3), rows are lights. No highlight where N.L <= 0 or R.V <= 0.
    """
    point, normal = np.asarray(point, np.float64), np.asarray(normal, np.float64)
    total = np.zeros(np.broadcast_shapes(point.shape, normal.shape, np.shape(kd), np.shape(ks)))
    for position, intensity in zip(light_positions, light_intensities, strict=True):
        n_l, r_v, distance2 = angles(point, normal, eye, position)
        diffuse = np.maximum(n_l, 0.0)[..., None]
        specular = np.where(n_l > 0.0, highlight(r_v, distance2, n), 0.0)[..., None]
        total = total + intensity * (kd * diffuse + ks * specular)
    return total


def light(
    point: Array,
    normal: Array,
    color: Array,
    eye: Array,
    ka_Ia: Array,
    kd: Array,
    ks: Array,
    n: Array,
    light_positions: Array,
    light_intensities: Array,
    tinted: bool = False,
) -> Array:
    """The Phong model: ka*Ia + sum_l Ip*color*(kd*max(0, N.L) + [N.L > 0 and R.V > 0]*ks*(R.V)^n), (..., 3).

    ka_Ia: ambient coefficient times ambient intensity; `tinted` multiplies it by the color too. n: (...) or a number;
    the others (..., 3). Directions are normalized here; a zero normal, a light at the point and an eye at the point
    contribute 0.
    """
    lit = reflected(point, normal, eye, kd, ks, n, light_positions, light_intensities)
    return color * (ka_Ia + lit) if tinted else ka_Ia + color * lit


def budget(color: Array, ka_Ia: Array, kd: Array, ks: Array, light_intensities: Array, tinted: bool = False) -> Array:
    """The light a point could at most give off, B = ka*Ia + sum_l Ip*(kd+ks)*max(color, 1), of absolute values.

    `tinted` ambient light counts times max(color, 1) too: B must not be less than the light itself.
    """
    total = np.abs(np.asarray(light_intensities, np.float64).reshape(-1, 3)).sum(axis=0)
    most = np.maximum(np.abs(color), 1.0)
    return np.abs(ka_Ia) * (most if tinted else 1.0) + total * (np.abs(kd) + np.abs(ks)) * most


def conditioning(point: Array, extent: Array, normal_length: Array, eye: Array, light_positions: Array) -> Array:
    """kappa (...): how much float32 rounding of the inputs can be amplified, at least 1.

    kappa = max(1, s/|P-L|, s/|P-eye|, 1/|N before normalizing|). extent (...): the largest camera-relative coordinate
    that P is interpolated from; s is that, and for a light also that light's own largest one.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = np.fmax(1.0, np.fmax(1.0 / normal_length, extent / length(eye - point)))
        for position in light_positions:
            s = np.maximum(extent, np.abs(position - eye).max())
            kappa = np.fmax(kappa, s / length(position - point))
    return kappa


def steepness(point: Array, normal: Array, n: Array, eye: Array, light_positions: Array) -> Array:
    """How much a highlight x^n with 0 < n < 1 amplifies an error of x = R.V, at least 1: its slope n*x^(n-1), which has no
    bound as x goes to 0. From n = 1 on the slope is n at most, and where it is that, x is as exact as sqrt(n) asks."""
    steepest = np.ones(np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1])
    n = np.asarray(n, np.float64)
    if not ((n > 0.0) & (n < 1.0)).any():
        return steepest
    for position in light_positions:
        n_l, r_v, _ = angles(point, normal, eye, position)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope = np.where((n_l > 0.0) & (r_v > 0.0) & (n > 0.0) & (n < 1.0), n * r_v ** (n - 1.0), 1.0)
        steepest = np.fmax(steepest, slope)
    return steepest


def at_gate(point: Array, normal: Array, eye: Array, light_positions: Array) -> Array:
    """(...) bool: is some light so near to N.L = 0 or R.V = 0 that its highlight may jump? Not for a zero normal."""
    found = np.zeros(np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1], dtype=bool)
    has_normal = (np.asarray(normal) != 0.0).any(axis=-1)
    for position in light_positions:
        n_l, r_v, _ = angles(point, normal, eye, position)
        found |= has_normal & ((np.abs(n_l) < GATE) | ((n_l > 0.0) & (np.abs(r_v) < GATE)))
    return found
