"""What surfaces of shader pbr reflect, by quadrature over directions: the truth that the oracle's sums stand for."""

from __future__ import annotations

import numpy as np

from clshade.base.arrays import Array, Floats
from clshade.oracle.microfacet import Facets, alpha_of, passing, schlick
from clshade.oracle.transform import unit
from clshade.scene.environment import Environment
from clshade.scene.image_light import radiance


def lost_energy(alpha: float, n_v: Array, steps: int = 400) -> Floats:
    """Return the share of light that single scattering of a perfect reflector (F = 1) loses, (...), by quadrature: 1 minus
    the integral of its BRDF times N.L over directions to the light.

    Half vectors are taken with equal shares of D (N.H): tan^2 of their angle to N is alpha^2 u/(1 - u), u uniform.
    """
    u = (np.arange(steps) + 0.5) / steps
    phi = (np.arange(steps) + 0.5) / steps * np.pi
    cosine = 1.0 / np.sqrt(1.0 + alpha * alpha * u / (1.0 - u))
    sine = np.sqrt(1.0 - cosine * cosine)
    kept = []
    for c in np.ravel(n_v):
        s = np.sqrt(1.0 - c * c)
        v_h = cosine[:, None] * c + (sine[:, None] * s) * np.cos(phi)
        n_l = 2.0 * v_h * cosine[:, None] - c
        mirrored = (v_h > 0.0) & (n_l > 0.0)
        visible = 4.0 * passing(np.where(mirrored, n_l, 0.0), np.asarray(c), np.asarray(alpha))
        kept.append(np.where(mirrored, visible * v_h / cosine[:, None], 0.0).mean())
    lost: Floats = 1.0 - np.reshape(kept, np.shape(n_v))
    return lost


def true_reflection(
    environment: Environment, normals: Floats, views: Floats, facets: Facets, points: int = 128
) -> Floats:
    """Return what white surfaces reflect of an environment, (K, 3), with unit normals and directions to the eye (K, 3):
    integrals with points^2 directions each, in equal shares of the cosine for the diffuse term and of GGX's normals for the
    lobe. Slow; rough where the environment has small bright spots."""
    share = (np.arange(points) + 0.5) / points
    turn = 2.0 * np.pi * share
    total = np.zeros(normals.shape)
    for k, (n, v) in enumerate(zip(normals, views, strict=True)):
        one = facets[k]
        alpha = float(alpha_of(one.roughness))
        side = unit(np.cross(n, np.eye(3)[np.abs(n).argmin()]))
        frame = np.stack([side, np.cross(n, side), n])
        dielectric = 1.0 - one.metallic
        # Diffuse: cos^2 of the angle to the normal is uniform.
        light = _around(np.sqrt(share), turn) @ frame
        v_h = np.sqrt((1.0 + light @ v) / 2.0)
        below = 1.0 - schlick(np.full(3, one.f0.max()), one.f90, v_h)
        total[k] = dielectric * one.diffuse * (radiance(environment, light) * below).mean(axis=(0, 1))
        # The lobe: normals in equal shares of D N.H.
        half = _around(1.0 / np.sqrt(1.0 + alpha * alpha * share / (1.0 - share)), turn) @ frame
        v_h, n_h = half @ v, half @ n
        light = 2.0 * v_h[..., None] * half - v
        n_l = light @ n
        lit = (v_h > 0.0) & (n_l > 0.0)
        visible = passing(np.where(lit, n_l, 0.0), np.asarray(max(n @ v, 0.0)), np.asarray(alpha))
        weight = np.where(lit, 4.0 * visible * v_h / n_h, 0.0)[..., None] * radiance(environment, light)
        grazing = ((1.0 - np.clip(v_h, 0.0, 1.0)) ** 5)[..., None]
        total[k] += one.metallic * (weight * (1.0 - grazing)).mean(axis=(0, 1))
        edge = dielectric * one.f90 + one.metallic
        total[k] += (weight * (dielectric * one.f0 * (1.0 - grazing) + edge * grazing)).mean(axis=(0, 1))
    return total


def _around(cosine: Floats, turn: Floats) -> Floats:
    """Return the directions (C, T, 3) at angles to z with these cosines, and at angles `turn` about it."""
    sine = np.sqrt(1.0 - cosine * cosine)[:, None]
    upward = np.broadcast_to(cosine[:, None], (len(cosine), len(turn)))
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), upward], axis=-1)
