"""Interpolation weights, the light of the Phong reflection model of terms.py, and its condition number.

Every function broadcasts over leading axes: points, directions and colors are (..., 3).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..base.arrays import Array, Floats
from .lights import GATE, Interaction
from .terms import RIGHT, TERMS, Steps, Surface

CONDITIONS = ("normals", "eye", "light", "steepness")  # the last axis of `conditions`


def barycentrics(edges: Array, z: Floats, interpolation: str) -> Floats:
    """Return barycentric coordinates (..., 3) of a point in a triangle from edge functions and corner depths, both (...,
    3).

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
    return np.asarray((step * total - share * total_step) / (total * total))


def depth(edges: Array, z: Floats, orthographic: bool = False) -> Floats:
    """Return the depth (...) at a point of a triangle: 1/z is linear in the image; in parallel projection z is."""
    e = np.asarray(edges, dtype=np.float64)
    # A face parallel to the image has its corners' very depth, and no term is negative.
    first = np.min(z, axis=-1, keepdims=True) if orthographic else np.max(z, axis=-1, keepdims=True)
    share = e * (z - first if orthographic else first / z - 1.0)
    mean = (share[..., 0] + share[..., 1] + share[..., 2]) / (e[..., 0] + e[..., 1] + e[..., 2])
    return np.asarray(first[..., 0] + mean if orthographic else first[..., 0] / (1.0 + mean))


def reflected(at: Interaction, surface: Surface, reaching: Floats | None = None, steps: Steps = RIGHT) -> Floats:
    """Return the light that a white surface reflects: of each light Ip times the sum of its terms, (..., 3). Ip is the
    intensity times `LightSample.share`. reaching: factors of `at.samples`, (L, ...). steps: how a light is computed."""
    total = np.zeros(
        np.broadcast_shapes(np.shape(at.point), np.shape(at.normal), *(k.shape for k in surface.k.values()))
    )
    for k, sample in enumerate(at.samples):
        directions = steps.directions(at.point, at.normal, at.eye, sample.place)
        share = sample.share * (1.0 if reaching is None else reaching[k])
        white = [factor * steps.terms[name](directions, surface.n)[..., None] for name, factor in surface.k.items()]
        total = total + sample.intensity * share[..., None] * sum(white)
    return steps.total(total)


def budget(color: Floats, surface: Surface, arriving: Iterable[Floats], tinted: bool = False) -> Floats:
    """Return the most light that a point can send, B = ka*Ia + sum_l Ip_l * (sum of coefficients) * max(color, 1), of
    absolute values: no term is more than its coefficient.

    arriving: Ip of the lights, (..., 3), see `LightSample.max_arriving`. `tinted` ambient light counts times max(color, 1)
    too: B must not be less than the light itself.
    """
    total = sum((np.abs(intensity) for intensity in arriving), np.zeros(3))
    brightest, positive = np.maximum(np.abs(color), 1.0), surface.magnitudes()
    ambient = positive.ka_Ia * (brightest if tinted else 1.0)
    return np.asarray(ambient + total * sum(positive.k.values(), np.zeros(3)) * brightest)


def conditions(at: Interaction, steepness: Floats | float = 1.0) -> Floats:
    """Return the terms of kappa, (..., 4): 1/|N before normalizing|, s/|P-eye|, s/|P-L| of the worst light (0 without
    lights), and `steepness`. s is `at.extent`, and for a light also its own largest coordinate. The term of a light with a
    cone or attenuation is at least 1, times `LightSample.sensitivity`."""
    of_light = np.zeros(np.shape(at.point)[:-1])
    for sample in at.samples:
        amplified = sample.condition
        if sample.shape.attenuates or sample.shape.axis is not None or sample.shape.front is not None:
            amplified = np.fmax(amplified, 1.0)
            amplified = amplified * sample.sensitivity(GATE * amplified)
        of_light = np.fmax(of_light, amplified)
    return np.stack(np.broadcast_arrays(at.normal_condition, at.eye_condition, of_light, steepness), axis=-1)


def condition_number(terms: Floats) -> Floats:
    """Return kappa (...) of its terms (..., 4), how much float32 rounding of the inputs can be amplified: the largest of 1
    and the first three, times the last."""
    return np.asarray(np.fmax.reduce(terms[..., :3], axis=-1, initial=1.0) * terms[..., 3])


def steepness(at: Interaction, surface: Surface) -> Floats:
    """Return how much the terms of the surface amplify errors of directions, at least 1, by the worst light."""
    steepest = np.ones(at.shape)
    for sample in at.samples:
        for name, k in surface.k.items():
            slope = TERMS[name].steepness
            if slope is not None:
                amplified = slope(sample.directions, np.asarray(surface.n))
                steepest = np.fmax(steepest, np.where(k.any(axis=-1), amplified, 1.0))
    return steepest


def jumps(at: Interaction, surface: Surface) -> Floats:
    """Return how much the light of a white surface can change if rounding decides whether a term sends anything, (..., 3):
    for each light `Term.jump`, where cosines are right to `GATE` times that light's own kappa; 0 for a zero normal."""
    total = np.zeros((*at.shape, 3))
    for sample in at.samples:
        for name, k in surface.k.items():
            jump = TERMS[name].jump
            if jump is not None:
                changed = np.where(at.has_normal, jump(sample.directions, surface.n, GATE * sample.kappa), 0.0)
                total = total + changed[..., None] * np.abs(sample.max_arriving * k)
    return total
