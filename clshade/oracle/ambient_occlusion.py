"""Ambient occlusion: what share of the light from all around reaches a point. Every triangle of the scene is tried, in
float64.

Of N rays from a point the share that meets no triangle, by the rule of shadows (shadows.py). Their directions lie in the
hemisphere over the side of the face that is seen and are distributed as the cosine to its normal: points of the unit disc,
raised to the hemisphere (P. Shirley, K. Chiu, A low distortion map between disk and square, Journal of Graphics Tools 2(3),
1997, name the method Malley's; M. Pharr, W. Jakob, G. Humphreys, Physically Based Rendering, 3rd edition, 13.6.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Floats, Integers
from ..scene.geometry import bounding_box
from ..scene.model import Scene, Settings
from . import light_points, shadows
from .vectors import length

# Rays this long, of the casters' size, leave their box: longer ones meet nothing more.
LONGEST = 8.0
AO_DISTANCE = 0.2  # of the diagonal of the scene's box


@dataclass(frozen=True, eq=False)
class Openness:
    """The share of light from all around that arrives, (...), from 0 to 1.

    spread: (...) by how much rounding may change it where it decides whether rays meet triangles. rounding: how many times
    more sums of shares are rounded than a single one.
    """

    share: Floats
    spread: Floats
    rounding: float


def directions(uv: Integers, normal: Floats) -> Floats:
    """Return unit vectors (..., 3) in the hemispheres around unit normals (..., 3). uv: (..., 2) coordinates in the unit
    square, fractions of 2^32: u is the square of the sine of the angle to the normal, v the angle around it."""
    height = np.sqrt(1.0 - light_points.fractions(uv[..., 0]))
    return np.asarray(light_points.on_disc(uv, 1.0, -normal) + height[..., None] * normal)


def openness(
    seen: shadows.Visibility, scene: Scene, settings: Settings, reach: float, place: tuple[Integers, Integers] | None
) -> Openness:
    """Return what arrives at receivers. place: x and y (K,) where the pixels are lit, 1/256 px; None for corners of faces,
    whose rays all have the same directions. reach: rounding of directions, see `microfacet.REACH`."""
    casters, at, rays = seen.casters, seen.at, settings.ambient_occlusion
    normal, turned = seen.facing.reshape(-1, 3), seen.off.reshape(-1)
    shift = 0 if place is None else light_points.shifts(np.stack(place, axis=-1))
    low, high = bounding_box(scene)
    distance = AO_DISTANCE * float(length(high - low)) if settings.ao_distance is None else settings.ao_distance
    far = min(distance / casters.scale, LONGEST)
    # A normal that is off turns the disc by as much as directions to lights do theirs.
    off = at.off + far * np.nan_to_num((reach + turned) * light_points.amplified(-normal, np.ones(())), posinf=1e300)
    share, least, most = np.zeros((3, len(at.face)))
    for uv in light_points.coordinates(rays):
        end = at.point + far * directions(
            (uv + shift) % light_points.WHOLE * np.ones((len(at.face), 1), np.int64), normal
        )
        end_off = off + shadows.OFF * length(end)
        dark, unsure = shadows.met(casters, end, end_off, False, at)
        passed = shadows.passed_through(casters, end, end_off, False, at, seen.factors)
        share += np.where(dark, 0.0, passed.share)
        least += np.where(dark | unsure, 0.0, passed.least)
        most += np.where(dark, 0.0, passed.most)
    flat = (normal == 0.0).all(axis=-1)
    share = np.where(flat, 1.0, share / rays)
    spread = np.maximum(most / rays - share, share - least / rays)
    spread = np.where(flat, 0.0, spread) if not len(casters.veils) else spread
    shape = seen.off.shape
    return Openness(share.reshape(shape), spread.reshape(shape), 1.0 + rays / 64.0 if len(casters.veils) else 1.0)
