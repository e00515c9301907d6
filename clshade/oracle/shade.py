"""Interpolation weights, Phong's reflection model, its terms with the effects of rounding on them, and its condition number
at a point.

Every function broadcasts over leading axes: points, directions and colors are (..., 3), exponents (...). Terms are of a
white surface with a coefficient of 1, lit by a light of intensity 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.model import Material
from .lights import GATE, Directions, Interaction
from .transform import dot

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


@dataclass(frozen=True, eq=False)
class Surface:
    """Materials at points."""

    n: Floats  # (...), the exponent
    ka_Ia: Floats = field(default_factory=lambda: np.zeros(3))  # (..., 3), ka*Ia
    k: dict[str, Floats] = field(default_factory=dict)  # (..., 3), coefficients of TERMS; others are 0

    @classmethod
    def of(cls, materials: Sequence[Material], ambient: Floats) -> Surface:
        """Return materials in a row."""
        k = {name: np.array([getattr(material, name) for material in materials]) for name in TERMS}
        ambients = np.array([material.ka * ambient for material in materials])
        return cls(np.array([material.n for material in materials]), ambients, k)

    def __getitem__(self, index: Any) -> Surface:
        return Surface(self.n[index], self.ka_Ia[index], {name: k[index] for name, k in self.k.items()})

    def magnitudes(self) -> Surface:
        """Return the surface with the magnitudes of its coefficients."""
        return Surface(self.n, np.abs(self.ka_Ia), {name: np.abs(k) for name, k in self.k.items()})


# Functions, not lambdas: workers that grade take terms from their parent.
def _lambert(at: Directions, n: Floats) -> Floats:
    return np.maximum(at.n_l, 0.0)


def _no_jump(at: Directions, n: Floats, reach: Floats) -> Floats:
    return np.zeros(())


def _not_steep(at: Directions, n: Floats) -> Floats:
    return np.ones(())


class Term(NamedTuple):
    """A term of the model, from directions and exponent, (...)."""

    value: Callable[[Directions, Floats], Floats]  # at most 1
    # By how much rounding may change it where it decides whether there is anything at all, if cosines are right to `reach`.
    jump: Callable[[Directions, Floats, Floats], Floats] = _no_jump
    # How much it amplifies an error of directions, at least 1, beyond what the exponent's square root stands for.
    steepness: Callable[[Directions, Floats], Floats] = _not_steep


def mirrored(at: Directions) -> tuple[Floats, Floats]:
    """Return R.V and |R-V|^2, each (...), with R = 2N(N.L) - L."""
    mirror = 2.0 * at.normal * at.n_l[..., None] - at.to_light
    difference = mirror - at.to_eye
    return dot(mirror, at.to_eye), dot(difference, difference)


def power(cosine: Floats, distance2: Floats, n: Floats) -> Floats:
    """Return cosine^n where the cosine is above 0, else 0, from it and the squared distance of its two unit vectors; 0^0
    does not occur.

    Near 1 the power is taken of 1 - distance2/2, which is the cosine without the cancellation: with n = 1e9 the rounding
    of the cosine itself would cost seven digits.
    """
    base = np.where(cosine > 0.0, cosine, 1.0)
    logarithm = np.where(distance2 < 1.0, np.log1p(-0.5 * np.minimum(distance2, 1.0)), np.log(base))
    return np.where(cosine > 0.0, np.exp(n * logarithm), 0.0)


def specular(at: Directions, n: Floats) -> Floats:
    """Return (R.V)^n. No highlight where N.L <= 0 or R.V <= 0."""
    return np.where(at.n_l > 0.0, power(*mirrored(at), n), 0.0)


def _specular_jump(at: Directions, n: Floats, reach: Floats) -> Floats:
    """Return the highlight behind N.L = 0 or R.V = 0: the largest power of an R.V that is right to reach."""
    r_v, distance2 = mirrored(at)
    near = (at.n_l > -reach) & ((at.n_l < reach) | (np.abs(r_v) < reach))
    largest = np.clip(r_v + reach, 0.0, 1.0)
    highlight = np.where(r_v >= reach, power(r_v, distance2, n), np.where(largest > 0.0, largest**n, 0.0))
    return np.where(near, highlight, 0.0)


def _specular_steepness(at: Directions, n: Floats) -> Floats:
    """Return the slope n*x^(n-1) of x^n with 0 < n < 1, which is unbounded as x goes to 0, else 1: for n >= 1 it is at most
    n, and where it is n, x is as accurate as sqrt(n) requires."""
    steep = (n > 0.0) & (n < 1.0)
    if not steep.any():
        return np.ones(())
    cosine, _ = mirrored(at)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where((at.n_l > 0.0) & (cosine > 0.0) & steep, n * cosine ** (n - 1.0), 1.0)


TERMS = {  # by coefficient
    "kd": Term(_lambert),
    "ks": Term(specular, _specular_jump, _specular_steepness),
}
_VALUES = {name: term.value for name, term in TERMS.items()}


class Steps(NamedTuple):
    """The steps of the light that `measure.grade` replaces by wrong ones: from point, normal, eye and light to directions,
    the values of TERMS by coefficient, and from the sum over the lights (..., 3) to what the color is multiplied by."""

    directions: Callable[[Floats, Floats, Floats, Floats], Directions] = Directions.at
    terms: Mapping[str, Callable[[Directions, Floats], Floats]] = _VALUES
    total: Callable[[Floats], Floats] = np.asarray


RIGHT = Steps()


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
    """Return the maximum of the light that a point can send, B = ka*Ia + sum_l Ip_l * (sum of coefficients) * max(color, 1),
    of absolute values: no term is more than its coefficient.

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
            amplified = TERMS[name].steepness(sample.directions, np.asarray(surface.n))
            steepest = np.fmax(steepest, np.where(k.any(axis=-1), amplified, 1.0))
    return steepest


def jumps(at: Interaction, surface: Surface) -> Floats:
    """Return how much the light of a white surface can change if rounding decides whether a term sends anything, (..., 3):
    for each light `Term.jump`, where cosines are right to `GATE` times that light's own kappa; 0 for a zero normal."""
    total = np.zeros((*at.shape, 3))
    for sample in at.samples:
        for name, k in surface.k.items():
            jump = TERMS[name].jump(sample.directions, surface.n, GATE * sample.kappa)
            total = total + np.where(at.has_normal, jump, 0.0)[..., None] * np.abs(sample.max_arriving * k)
    return total
