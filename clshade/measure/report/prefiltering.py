"""How far image-based light is from the true integral over the environment: the split sum, blurred levels and their
interpolation, against quadrature, as a function of roughness."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...base.arrays import Floats
from ...oracle import environment as oracle
from ...oracle.microfacet import facets_of
from ...scene.environment import Environment
from ...scene.metallic_roughness import MetallicRoughness
from ...scene.model import Material

ROUGHNESSES = (0.05, 0.125, 0.2, 0.3, 0.5, 0.75, 1.0)
PLACES = 24  # normals, each seen at one angle
POINTS = 96  # of the quadrature along each angle


class Prefiltering(NamedTuple):
    """Errors at one roughness: RMSE over places and channels of white metal and of a white dielectric, and what the metal
    sends on average."""

    roughness: float
    metal: float
    dielectric: float
    mean: float

    def stats(self) -> dict[str, Any]:
        return self._asdict()


def prefiltering(environment: Environment) -> tuple[Prefiltering, ...]:
    """Measure the error at PLACES normals, spread evenly, seen at angles whose cosines are spread from 0.1 to 1."""
    normal, view = _places()
    found = []
    for roughness in ROUGHNESSES:
        errors, mean = [], 0.0
        for metallic in (0.0, 1.0):
            facets = facets_of([Material(pbr=MetallicRoughness(metallic, roughness))] * PLACES)
            at = oracle.Around(normal, view, facets, np.ones((PLACES, 3)), np.full(PLACES, 2.0**-24))
            near, true = oracle.reflected(environment, at), oracle.true_reflection(environment, at, POINTS)
            expected = true.tinted + true.plain
            errors.append(float(np.sqrt(np.mean((near.tinted + near.plain - expected) ** 2))))
            mean = float(expected.mean())
        found.append(Prefiltering(roughness, errors[1], errors[0], mean))
    return tuple(found)


def _places() -> tuple[Floats, Floats]:
    """Return unit normals and unit directions to the eye, (PLACES, 3): a Fibonacci spiral, and views turned from it."""
    k = (np.arange(PLACES) + 0.5) / PLACES
    turn = np.arange(PLACES) * (np.pi * (3.0 - np.sqrt(5.0)))
    height = 1.0 - 2.0 * k
    ring = np.sqrt(1.0 - height * height)
    normal = np.stack([ring * np.cos(turn), height, ring * np.sin(turn)], axis=1)
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    cosine = 0.1 + 0.9 * ((np.arange(PLACES) * 7 % PLACES) + 0.5)[:, None] / PLACES
    return normal, cosine * normal + np.sqrt(1.0 - cosine * cosine) * side
