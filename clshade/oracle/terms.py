"""The terms of Phong's reflection model, and what rounding may do to each.

All are of a white surface with a coefficient of 1, lit by a light of intensity 1. They broadcast over leading axes: points
and directions are (..., 3), exponents (...).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..scene.model import Material
from .transform import dot, unit


class Directions(NamedTuple):
    """Directions at points, unit vectors or 0: the normal, to the light, to the eye."""

    normal: Floats
    to_light: Floats
    to_eye: Floats

    @classmethod
    def at(cls, point: Floats, normal: Floats, eye: Floats, light: Floats) -> Directions:
        return cls(unit(normal), unit(light - point), unit(eye - point))

    @property
    def n_l(self) -> Floats:
        """The cosine N.L, (...)."""
        return dot(self.normal, self.to_light)


@dataclass(frozen=True, eq=False)
class Surface:
    """Materials at points: exponent (...), ka*Ia (..., 3), and the coefficients of TERMS by name, (..., 3); others are
    0."""

    n: Floats
    ka_Ia: Floats = field(default_factory=lambda: np.zeros(3))
    k: dict[str, Floats] = field(default_factory=dict)

    @classmethod
    def of(cls, materials: Sequence[Material], ambient: Floats) -> Surface:
        """Return materials in a row."""
        k = {name: np.array([getattr(material, name) for material in materials]) for name in TERMS}
        ambients = np.array([material.ka * ambient for material in materials])
        return cls(np.array([material.n for material in materials]), ambients, k)

    def __getitem__(self, index: Any) -> Surface:
        return Surface(self.n[index], self.ka_Ia[index], {name: k[index] for name, k in self.k.items()})

    def magnitudes(self) -> Surface:
        """Return the surface with coefficients of the same size that are not negative."""
        return Surface(self.n, np.abs(self.ka_Ia), {name: np.abs(k) for name, k in self.k.items()})


class Term(NamedTuple):
    """A term of the model.

    value: at most 1, from directions and exponent, (...). jump: by how much rounding may change it where it decides whether
    there is anything at all, if cosines are right to `reach` (...). steepness: how much it amplifies an error of
    directions, at least 1, beyond what the exponent's square root stands for.
    """

    value: Callable[[Directions, Floats], Floats]
    jump: Callable[[Directions, Floats, Floats], Floats] | None = None
    steepness: Callable[[Directions, Floats], Floats] | None = None


def _diffuse(at: Directions, n: Floats) -> Floats:
    return np.maximum(at.n_l, 0.0)


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


def _most_within(cosine: Floats, distance2: Floats, n: Floats, reach: Floats) -> Floats:
    """Return the largest `power` of cosines that are right to reach."""
    largest = np.clip(cosine + reach, 0.0, 1.0)
    return np.where(cosine >= reach, power(cosine, distance2, n), np.where(largest > 0.0, largest**n, 0.0))


def specular(at: Directions, n: Floats) -> Floats:
    """Return (R.V)^n. No highlight where N.L <= 0 or R.V <= 0."""
    return np.where(at.n_l > 0.0, power(*mirrored(at), n), 0.0)


def _specular_jump(at: Directions, n: Floats, reach: Floats) -> Floats:
    """Return the highlight behind N.L = 0 or R.V = 0."""
    r_v, distance2 = mirrored(at)
    near = (at.n_l > -reach) & ((at.n_l < reach) | (np.abs(r_v) < reach))
    return np.where(near, _most_within(r_v, distance2, n, reach), 0.0)


def _specular_steepness(at: Directions, n: Floats) -> Floats:
    """Return the slope n*x^(n-1) of x^n with 0 < n < 1, which is unbounded as x goes to 0, else 1: for n >= 1 it is at most
    n, and where it is n, x is as accurate as sqrt(n) requires."""
    steep = (n > 0.0) & (n < 1.0)
    if not steep.any():
        return np.ones(())
    cosine, _ = mirrored(at)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where((at.n_l > 0.0) & (cosine > 0.0) & steep, n * cosine ** (n - 1.0), 1.0)


TERMS = {"kd": Term(_diffuse), "ks": Term(specular, _specular_jump, _specular_steepness)}  # by coefficient


_VALUES = {name: term.value for name, term in TERMS.items()}


class Steps(NamedTuple):
    """The steps of the light that `measure.grade` replaces by wrong ones: from point, normal, eye and light to directions,
    the values of TERMS by coefficient, and from the sum over the lights (..., 3) to what the color is multiplied by."""

    directions: Callable[[Floats, Floats, Floats, Floats], Directions] = Directions.at
    terms: Mapping[str, Callable[[Directions, Floats], Floats]] = _VALUES
    total: Callable[[Floats], Floats] = np.asarray


RIGHT = Steps()
