"""Interpolation weights, the Phong reflection model of terms.py, and its condition number at a point.

Every function broadcasts over leading axes: points, directions and colors are (..., 3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Array, Floats
from . import lights
from .lights import Shape
from .terms import RIGHT, TERMS, Directions, Steps, Surface
from .vectors import length

# |N.L| or |R.V| below this times kappa: float32 may decide the highlight's gate otherwise. Both are accurate to 16
# roundings if kappa is 1. If it is larger, the directions that they are products of are off by kappa times as much: an
# error 2^-24 s of P turns L by 2^-24 s/|P-L| and V by 2^-24 s/|P-eye|, one 2^-24 of the mean normal turns N by 2^-24/|N|.
GATE = 1e-6


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
    # A face parallel to the image has its corners' very depth, and no term is negative.
    first = np.min(z, axis=-1, keepdims=True) if orthographic else np.max(z, axis=-1, keepdims=True)
    share = e * (z - first if orthographic else first / z - 1.0)
    mean = (share[..., 0] + share[..., 1] + share[..., 2]) / (e[..., 0] + e[..., 1] + e[..., 2])
    return np.asarray(first[..., 0] + mean if orthographic else first[..., 0] / (1.0 + mean))


def reflected(
    point: Floats,
    normal: Floats,
    eye: Floats,
    surface: Surface,
    light_positions: Floats,
    light_intensities: Floats,
    shapes: Sequence[Shape] = (),
    reaching: Floats | None = None,
    steps: Steps = RIGHT,
) -> Floats:
    """Return the light that a white surface reflects: of each light Ip times the sum of its terms, (..., 3).

    light_positions and light_intensities: (L, 3), rows are lights. shapes: see `lights.each`, here and below; Ip is the
    intensity times `lights.share`. reaching: (L, ...) factors of the lights. steps: how a light is computed.
    """
    point, normal = np.asarray(point, np.float64), np.asarray(normal, np.float64)
    total = np.zeros(np.broadcast_shapes(point.shape, normal.shape, *(k.shape for k in surface.k.values())))
    each = lights.each(light_positions, light_intensities, shapes, point)
    for k, (position, intensity, shape) in enumerate(each):
        at = steps.directions(point, normal, eye, lights.place(point, position, shape))
        share = lights.share(point, position, shape) * (1.0 if reaching is None else reaching[k])
        arriving = intensity * share[..., None]
        white = [factor * steps.terms[name](at, surface.n)[..., None] for name, factor in surface.k.items()]
        total = total + arriving * sum(white)
    return steps.total(total)


def budget(color: Floats, surface: Surface, light_intensities: Floats, tinted: bool = False) -> Floats:
    """Return the most light that a point can send, B = ka*Ia + sum_l Ip_l * (sum of coefficients) * max(color, 1), of
    absolute values: no term is more than its coefficient.

    light_intensities: (L, 3), or (L, ..., 3) as `most_arriving` gives them. `tinted` ambient light counts times
    max(color, 1) too: B must not be less than the light itself.
    """
    given = np.asarray(light_intensities, np.float64)
    total = np.abs(given if given.ndim > 2 else given.reshape(-1, 3)).sum(axis=0)
    most, positive = np.maximum(np.abs(color), 1.0), surface.magnitudes()
    bound: Floats = positive.ka_Ia * (most if tinted else 1.0) + total * sum(positive.k.values(), np.zeros(3)) * most
    return bound


def most_arriving(
    point: Floats,
    extent: Floats,
    eye: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    shapes: Sequence[Shape],
    parallel: bool = False,
) -> Floats:
    """Return the intensities of the lights as they arrive at most, see `lights.most_share`: (L, 3), or (L, ..., 3) if any
    is attenuated or of finite size; of such a light there are as many rows as points. Other arguments as of `jumps`."""
    if not any(shape.attenuates or shape.points for shape in shapes):
        return light_intensities
    sums = [lights.rounding_of_sums(shape) for shape in shapes]
    intensities = np.asarray(light_intensities) * np.array(sums)[:, None]
    found = []
    for position, intensity, shape in lights.each(light_positions, intensities, shapes, point, extent):
        size = _size(extent, eye, position, parallel) + shape.blur
        found.append(intensity * lights.most_share(point, position, shape, size, GATE)[..., None])
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
) -> Floats:
    """Return the terms of kappa, (..., 4): 1/|N|, s/|P-eye|, s/|P-L| of the worst light (0 without lights), and
    `steepness`. Arguments as of `conditioning` and `jumps`. The term of a light with a cone or attenuation is at least 1,
    times `lights.sensitivity`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        of_normal = 1.0 / np.asarray(normal_length, np.float64)
        of_eye = np.zeros(()) if parallel else extent / length(eye - point)
    of_light = np.zeros(np.shape(point)[:-1])
    for position, _, shape in lights.each(light_positions, light_positions, shapes, point, extent):
        amplified = light_condition(point, extent, eye, position, parallel, shape)
        if shape.varies:
            amplified = np.fmax(amplified, 1.0)
            amplified = amplified * lights.sensitivity(point, position, shape, GATE * amplified)
        of_light = np.fmax(of_light, amplified)
    return np.stack(np.broadcast_arrays(of_normal, of_eye, of_light, steepness), axis=-1)


def condition_number(terms: Floats) -> Floats:
    """Return kappa (...) of its terms (..., 4): the largest of 1 and the first three, times the last."""
    worst: Floats = np.fmax.reduce(terms[..., :3], axis=-1, initial=1.0) * terms[..., 3]
    return worst


def _size(extent: Floats, eye: Floats, position: Floats, parallel: bool) -> Floats:
    """Return the largest coordinate (...) that a point's direction to a light comes from."""
    size: Floats = np.maximum(extent, np.abs(position if parallel else position - eye).max(axis=-1))
    return size


def light_condition(
    point: Floats, extent: Floats, eye: Floats, position: Floats, parallel: bool, shape: Shape = lights.POINT
) -> Floats:
    """Return the term of kappa that depends on the direction to a light: 0 if that is the same everywhere."""
    if shape.parallel:
        return np.zeros(np.shape(point)[:-1])
    s = _size(extent, eye, position, parallel) + shape.blur
    with np.errstate(divide="ignore", invalid="ignore"):
        amplified: Floats = s / length(position - point)
        return amplified


def steepness(
    point: Floats, normal: Floats, surface: Surface, eye: Floats, light_positions: Floats, shapes: Sequence[Shape] = ()
) -> Floats:
    """Return how much the terms of the surface amplify errors of directions, at least 1, by the worst light."""
    steepest = np.ones(np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1])
    for position, _, shape in lights.each(light_positions, light_positions, shapes, point):
        at = Directions.at(point, normal, eye, lights.place(point, position, shape))
        for name, k in surface.k.items():
            slope = TERMS[name].steepness
            if slope is not None:
                steepest = np.fmax(steepest, np.where(k.any(axis=-1), slope(at, np.asarray(surface.n)), 1.0))
    return steepest


def jumps(
    point: Floats,
    normal: Floats,
    extent: Floats,
    normal_length: Floats,
    surface: Surface,
    eye: Floats,
    light_positions: Floats,
    light_intensities: Floats,
    parallel: bool = False,
    shapes: Sequence[Shape] = (),
) -> Floats:
    """Return how much the light of a white surface can change if rounding decides whether a term sends anything, (..., 3):
    for each light `Term.jump`, where cosines are right to `GATE` times that light's own kappa.

    Arguments as of `conditioning` and `reflected`; 0 for a zero normal.
    """
    found = np.zeros((*np.broadcast_shapes(np.shape(point), np.shape(normal))[:-1], 3))
    has_normal = (np.asarray(normal) != 0.0).any(axis=-1)
    common = conditioning(point, extent, normal_length, eye, np.zeros((0, 3)), parallel)
    most = most_arriving(point, extent, eye, light_positions, light_intensities, shapes, parallel)
    each = lights.each(light_positions, light_intensities, shapes, point, extent)
    for (position, _, shape), intensity in zip(each, most, strict=True):
        reach = GATE * np.fmax(common, light_condition(point, extent, eye, position, parallel, shape))
        at = Directions.at(point, normal, eye, lights.place(point, position, shape))
        for name, k in surface.k.items():
            jump = TERMS[name].jump
            if jump is not None:
                changed = np.where(has_normal, jump(at, surface.n, reach), 0.0)
                found = found + changed[..., None] * np.abs(intensity * k)
    return found
