"""Interpolation weights, the Phong reflection model, and its condition number at a point.

Every function broadcasts over leading axes: points, directions and colors are (..., 3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Array, Floats
from . import lights
from .lights import Shape
from .vectors import dot, length, unit

# |N.L| or |R.V| below this times kappa: float32 may decide the highlight's gate otherwise. Both are accurate to 16
# roundings if kappa is 1. If it is larger, the directions that they are products of are off by kappa times as much: an
# error 2^-24 s of P turns L by 2^-24 s/|P-L| and V by 2^-24 s/|P-eye|, one 2^-24 of the mean normal turns N by 2^-24/|N|.
GATE = 1e-6
# With precision `fast` lengths are accurate to 4.7e-6 only (kernels/numerics.clh). Those of L and V scale N.L and R.V and
# leave their signs alone; that of N counts twice in the first of the terms 2(N.L)(N.V) - L.V, which are at most 1 and equal
# where R.V is 0: 9.4e-6 more.
FAST_GATE = 1.1e-5


def barycentrics(edges: Array, z: Floats, interpolation: str) -> Floats:
    """Return barycentric coordinates (..., 3) of a point in a triangle from edge functions and corner depths, both (..., 3).

    `affine`: linear in the image. `perspective`: linear in space. They sum to 1.
    """
    share = np.asarray(edges, dtype=np.float64)
    if interpolation == "perspective":
        share = share / z
    return share / (share[..., 0] + share[..., 1] + share[..., 2])[..., None]


def barycentric_steps(edges: Array, steps: Array, z: Floats, interpolation: str) -> Floats:
    """Return the derivative (..., 3) of `barycentrics` if the edge functions change by steps (..., 3), by the quotient
    rule."""
    share, step = np.asarray(edges, np.float64), np.asarray(steps, np.float64)
    if interpolation == "perspective":
        share, step = share / z, step / z
    total, total_step = share.sum(axis=-1, keepdims=True), step.sum(axis=-1, keepdims=True)
    derivative: Floats = (step * total - share * total_step) / (total * total)
    return derivative


def depth(edges: Array, z: Floats, orthographic: bool = False) -> Floats:
    """Return the depth (...) at a point of a triangle: 1/z is linear in the image; in parallel projection z is."""
    e = np.asarray(edges, dtype=np.float64)
    if orthographic:
        share = e * z
        return (share[..., 0] + share[..., 1] + share[..., 2]) / (e[..., 0] + e[..., 1] + e[..., 2])
    inverse = e / z
    return (e[..., 0] + e[..., 1] + e[..., 2]) / (inverse[..., 0] + inverse[..., 1] + inverse[..., 2])


def angles(point: Floats, normal: Floats, eye: Floats, light_position: Floats) -> tuple[Floats, Floats, Floats]:
    """Return N.L, R.V and |R-V|^2, each (...), with N, L and V normalized (0 stays 0) and R = 2N(N.L) - L."""
    n, towards_light, view = unit(normal), unit(light_position - point), unit(eye - point)
    n_l = dot(n, towards_light)
    mirrored = 2.0 * n * n_l[..., None] - towards_light
    difference = mirrored - view
    return n_l, dot(mirrored, view), dot(difference, difference)


def highlight(r_v: Floats, distance2: Floats, n: Floats) -> Floats:
    """Return (R.V)^n where R.V > 0, else 0, from R.V and |R-V|^2; 0^0 does not occur.

    Near 1 the power is taken of 1 - |R-V|^2/2, which is R.V without the cancellation: with n = 1e9 the rounding of
    R.V itself would cost seven digits.
    """
    base = np.where(r_v > 0.0, r_v, 1.0)
    logarithm = np.where(distance2 < 1.0, np.log1p(-0.5 * np.minimum(distance2, 1.0)), np.log(base))
    return np.where(r_v > 0.0, np.exp(n * logarithm), 0.0)


def reflected(
    point: Floats,
    normal: Floats,
    eye: Floats,
    kd: Floats,
    ks: Floats,
    n: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    shapes: Sequence[Shape] = (),
) -> Floats:
    """Return the light that a white surface reflects: sum of Ip*(kd*max(0, N.L) + ks*(R.V)^n), (..., 3).

    light_positions and light_intensities: (L, 3), rows are lights. No highlight where N.L <= 0 or R.V <= 0. shapes: see
    `lights.each`, here and below; Ip is the intensity times `lights.share`.
    """
    point, normal = np.asarray(point, np.float64), np.asarray(normal, np.float64)
    total = np.zeros(np.broadcast_shapes(point.shape, normal.shape, np.shape(kd), np.shape(ks)))
    for position, intensity, shape in lights.each(light_positions, light_intensities, shapes):
        n_l, r_v, distance2 = angles(point, normal, eye, lights.place(point, position, shape))
        diffuse = np.maximum(n_l, 0.0)[..., None]
        specular = np.where(n_l > 0.0, highlight(r_v, distance2, n), 0.0)[..., None]
        arriving = intensity * lights.share(point, position, shape)[..., None]
        total = total + arriving * (kd * diffuse + ks * specular)
    return total


def light(
    point: Floats,
    normal: Floats,
    color: Floats,
    eye: Floats,
    ka_Ia: Floats,
    kd: Floats,
    ks: Floats,
    n: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    tinted: bool = False,
) -> Floats:
    """Evaluate the Phong model: ka*Ia + sum_l Ip*color*(kd*max(0, N.L) + [N.L > 0 and R.V > 0]*ks*(R.V)^n), (..., 3).

    ka_Ia: ambient coefficient times ambient intensity; `tinted` multiplies it by the color too. n: (...) or a number;
    the others (..., 3). Directions are normalized here; a zero normal, a light at the point and an eye at the point
    contribute 0.
    """
    lit = reflected(point, normal, eye, kd, ks, n, light_positions, light_intensities)
    return color * (ka_Ia + lit) if tinted else ka_Ia + color * lit


def budget(
    color: Floats, ka_Ia: Floats, kd: Floats, ks: Floats, light_intensities: Floats, tinted: bool = False
) -> Floats:
    """Return the most light that a point can send, B = ka*Ia + sum_l Ip*(kd+ks)*max(color, 1), of absolute values.

    light_intensities: (L, 3), or (L, ..., 3) as `most_arriving` gives them. `tinted` ambient light counts times
    max(color, 1) too: B must not be less than the light itself.
    """
    given = np.asarray(light_intensities, np.float64)
    total = np.abs(given if given.ndim > 2 else given.reshape(-1, 3)).sum(axis=0)
    most = np.maximum(np.abs(color), 1.0)
    bound: Floats = np.abs(ka_Ia) * (most if tinted else 1.0) + total * (np.abs(kd) + np.abs(ks)) * most
    return bound


def most_arriving(
    point: Floats,
    extent: Floats,
    eye: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    shapes: Sequence[Shape],
    parallel: bool = False,
    gate: float = GATE,
) -> Floats:
    """Return the intensities of the lights as they arrive at most, see `lights.most_share`: (L, 3), or (L, ..., 3) if any
    is attenuated. Other arguments as of `jumps`."""
    if not any(shape.attenuates for shape in shapes):
        return light_intensities
    found = []
    for position, intensity, shape in lights.each(light_positions, light_intensities, shapes):
        size = _size(extent, eye, position, parallel)
        found.append(intensity * lights.most_share(point, position, shape, size, gate)[..., None])
    return np.stack(found)


def conditioning(
    point: Floats, extent: Floats, normal_length: Floats, eye: Floats, light_positions: Floats, parallel: bool = False
) -> Floats:
    """Return kappa (...), the condition number: how much float32 rounding of the inputs can be amplified, at least 1, by the
    worst light.

    kappa = max(1, s/|P-L|, s/|P-eye|, 1/|N before normalizing|). extent (...): the largest camera-relative coordinate
    that P is interpolated from; s is that, and for a light also that light's own largest one. parallel: the directions to
    the eye are the same everywhere, hence exact; coordinates are relative to the origin.
    """
    return condition_number(conditions(point, extent, normal_length, eye, light_positions, parallel))


CONDITIONS = ("normals", "eye", "light", "steepness")  # the last axis of `conditions`


def conditions(
    point: Floats,
    extent: Floats,
    normal_length: Floats,
    eye: Floats,
    light_positions: Floats,
    parallel: bool = False,
    steepness: Floats | float = 1.0,
    shapes: Sequence[Shape] = (),
    gate: float = GATE,
) -> Floats:
    """Return the terms of kappa, (..., 4): 1/|N|, s/|P-eye|, s/|P-L| of the worst light (0 without lights), and
    `steepness`. Arguments as of `conditioning` and `jumps`. The term of a light with a cone or attenuation is at least 1,
    times `lights.sensitivity`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        of_normal = 1.0 / np.asarray(normal_length, np.float64)
        of_eye = np.zeros(()) if parallel else extent / length(eye - point)
    of_light = np.zeros(np.shape(point)[:-1])
    for position, _, shape in lights.each(light_positions, light_positions, shapes):
        amplified = _light_condition(point, extent, eye, position, parallel, shape)
        if shape.axis is not None or shape.attenuates:
            amplified = np.fmax(amplified, 1.0)
            amplified = amplified * lights.sensitivity(point, position, shape, gate * amplified)
        of_light = np.fmax(of_light, amplified)
    return np.stack(np.broadcast_arrays(of_normal, of_eye, of_light, steepness), axis=-1)


def condition_number(terms: Floats) -> Floats:
    """Return kappa (...) of its terms (..., 4): the largest of 1 and the first three, times the last."""
    worst: Floats = np.fmax.reduce(terms[..., :3], axis=-1, initial=1.0) * terms[..., 3]
    return worst


def _size(extent: Floats, eye: Floats, position: Floats, parallel: bool) -> Floats:
    """Return the largest coordinate (...) that a point's direction to a light comes from."""
    size: Floats = np.maximum(extent, np.abs(position if parallel else position - eye).max())
    return size


def _light_condition(
    point: Floats, extent: Floats, eye: Floats, position: Floats, parallel: bool, shape: Shape = lights.POINT
) -> Floats:
    """Return the term of kappa that depends on the direction to a light: 0 if that is the same everywhere."""
    if shape.parallel:
        return np.zeros(np.shape(point)[:-1])
    s = _size(extent, eye, position, parallel)
    with np.errstate(divide="ignore", invalid="ignore"):
        amplified: Floats = s / length(position - point)
        return amplified


def steepness(
    point: Floats,
    normal: Floats,
    n: Floats,
    eye: Floats,
    light_positions: Floats,
    shapes: Sequence[Shape] = (),
) -> Floats:
    """Return how much a highlight x^n with 0 < n < 1 amplifies an error of x = R.V, at least 1: its slope n*x^(n-1),
    which is unbounded as x goes to 0. For n >= 1 the slope is at most n, and where it is n, x is as accurate as sqrt(n)
    requires."""
    steepest = np.ones(np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1])
    n = np.asarray(n, np.float64)
    if not ((n > 0.0) & (n < 1.0)).any():
        return steepest
    for position, _, shape in lights.each(light_positions, light_positions, shapes):
        n_l, r_v, _ = angles(point, normal, eye, lights.place(point, position, shape))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope = np.where((n_l > 0.0) & (r_v > 0.0) & (n > 0.0) & (n < 1.0), n * r_v ** (n - 1.0), 1.0)
        steepest = np.fmax(steepest, slope)
    return steepest


def jumps(
    point: Floats,
    normal: Floats,
    extent: Floats,
    normal_length: Floats,
    n: Floats,
    eye: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    parallel: bool = False,
    gate: float = GATE,
    shapes: Sequence[Shape] = (),
) -> Floats:
    """Return how much highlights of a white surface with ks = 1 can change if rounding opens or closes their gates,
    (..., 3).

    For each light so near to N.L = 0 or R.V = 0 that rounding may decide, within `gate` times its own kappa: the
    highlight behind that gate, at the largest R.V within rounding. Arguments as of `conditioning`; 0 for a zero normal.
    """
    found = np.zeros((*np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1], 3))
    has_normal = (np.asarray(normal) != 0.0).any(axis=-1)
    common = conditioning(point, extent, normal_length, eye, np.zeros((0, 3)), parallel)
    most = most_arriving(point, extent, eye, light_positions, light_intensities, shapes, parallel, gate)
    for position, intensity, shape in lights.each(light_positions, most, shapes):
        reach = gate * np.fmax(common, _light_condition(point, extent, eye, position, parallel, shape))
        n_l, r_v, distance2 = angles(point, normal, eye, lights.place(point, position, shape))
        near = has_normal & (n_l > -reach) & ((n_l < reach) | (np.abs(r_v) < reach))
        largest = np.clip(r_v + reach, 0.0, 1.0)
        behind = np.where(r_v >= reach, highlight(r_v, distance2, n), np.where(largest > 0.0, largest**n, 0.0))
        found += np.where(near, behind, 0.0)[..., None] * np.abs(intensity)
    return found
