"""Visibility of lights and of the ambient light at points: shadows, ambient occlusion, and their terminator.

Ambient occlusion is the share of N rays from a point that meet a triangle, by the rule of shadows.py. Their directions lie
in the hemisphere over the visible side of the face and are distributed as the cosine to its normal: points of the unit
disc, raised to the hemisphere (P. Shirley, K. Chiu, A low distortion map between disk and square, Journal of Graphics Tools
2(3), 1997, name the method Malley's; M. Pharr, W. Jakob, G. Humphreys, Physically Based Rendering, 3rd edition, 13.6.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..base.arrays import Floats, Integers
from ..scene.geometry import bounding_box
from ..scene.model import Settings
from . import lights as light_points
from .corners import Corners
from .lights import Interaction, shining
from .shadows import OFF, Casters, Rays, Receivers, at_corners, at_pixels, met, transmittance
from .shot import Hits
from .transform import dot, length, unit

# Rays of ambient occlusion this long, of the casters' size, leave their box: longer ones meet nothing more.
LONGEST = 8.0
AO_DISTANCE = 0.2  # of the diagonal of the scene's box
MAX_BEND = 0.5  # of `Normals.bend`, which is relative to the length of the interpolated normal


@lru_cache(1)  # the parts of an image, one after another, have the same
def _casters_of(corners: Corners) -> Casters:
    return Casters.of(corners, corners.of_meshes(lambda mesh: mesh.blends or mesh.tests_alpha))


def pixel_receivers(hits: Hits) -> Receivers:
    at = at_pixels(_casters_of(hits.shot.corners), hits.shot.scene.camera, hits.face, *hits.position.T)
    return replace(at, behind=hits.behind)


def corner_receivers(hits: Hits, faces: Integers, where: Integers) -> Receivers:
    """Return the corners of faces (U,), (3 U,), on which pixels lie: pixel k on faces[where[k]]."""
    behind = np.zeros(len(faces), bool)
    behind[where] = hits.behind  # all pixels of a face see the same side of it
    return replace(at_corners(_casters_of(hits.shot.corners), faces), behind=np.repeat(behind, 3))


def light_visibility(
    receivers: Receivers, at: Interaction, smooth: Floats, bend: Floats, reach: float
) -> tuple[Floats, Floats, Floats]:
    """Return the share of light that arrives from each light, or sample point of an area light, (L, ...); by how much
    rounding may change it, over the error of a direction; and the share where rounding decides whether it arrives, else 0.

    smooth: (..., 3) normals before a map turned them. bend: (...), see `Normals`. reach: rounding of directions, see
    `microfacet.REACH`.
    """
    facing, off = receivers.facing
    normals = Normals(unit(at.normal), unit(smooth), facing, bend)
    lights, parts = shining(receivers.casters.faces.scene), []
    for sample in at.samples:
        turned = reach * np.maximum(np.nan_to_num(sample.kappa, nan=1e300, posinf=1e300), 1.0)
        to_light = unit(sample.place - at.point)
        blur = np.nan_to_num(reach * sample.blur, posinf=1e300)
        rays = Rays.to(lights[sample.number], receivers, sample.offset, blur)
        (dark, unsure), passing = met(rays), transmittance(rays)
        soft, low, high = softened(normals, to_light, turned + off)
        soft, low, high = soft * passing.share, low * passing.low, high * passing.high
        share = np.where(~dark | unsure, soft, 0.0)
        changes = np.where((~dark | unsure) & ~passing.jumps, (high - low) / turned, 0.0)
        parts.append((share, changes, np.where(unsure, high, np.where(~dark & passing.jumps, high - low, 0.0))))
    shares, changes, doubtful = np.array(parts).swapaxes(0, 1)
    return shares, changes, doubtful


# Ambient occlusion


@dataclass(frozen=True, eq=False)
class AmbientVisibility:
    """The share of the ambient light that arrives, (...), from 0 to 1."""

    share: Floats
    spread: Floats  # by how much rounding may change it where it decides whether rays meet triangles
    rounding: float  # how many times more sums of shares are rounded than a single one


def ambient_visibility(at: Receivers, settings: Settings, reach: float, place: Integers | None) -> AmbientVisibility:
    """Return the visibility of the ambient light. place: (K, 2) where the pixels are lit, 1/256 px; None for corners of
    faces, whose rays have equal directions. reach: rounding of directions, see `microfacet.REACH`."""
    casters, (normal, normal_off), count = at.casters, at.facing, settings.ambient_occlusion
    shift = 0 if place is None else light_points.shifts(place)
    corner, opposite = bounding_box(casters.faces.scene)
    distance = AO_DISTANCE * float(length(opposite - corner)) if settings.ao_distance is None else settings.ao_distance
    far = min(distance / casters.scale, LONGEST)
    # A normal that is off turns the disc by as much as directions to lights do theirs.
    off = at.off + far * np.nan_to_num(
        (reach + normal_off) * light_points.amplified(-normal, np.ones(())), posinf=1e300
    )
    share, low, high = np.zeros((3, len(at.face)))
    for uv in light_points.coordinates(count):
        shifted = (uv + shift) % light_points.TURN * np.ones((len(at.face), 1), np.int64)
        # u is the square of the sine of the angle to the normal, v the angle around it.
        height = np.sqrt(1.0 - light_points.fractions(shifted[:, 0]))
        end = at.point + far * (light_points.on_disc(shifted, 1.0, -normal) + height[:, None] * normal)
        rays = Rays(at, end, off + OFF * length(end))
        dark, unsure = met(rays)
        passing = transmittance(rays)
        share += np.where(dark, 0.0, passing.share)
        low += np.where(dark | unsure, 0.0, passing.low)
        high += np.where(dark, 0.0, passing.high)
    transparent, flat = len(casters.transparent) > 0, (normal == 0.0).all(axis=-1)
    share = np.where(flat, 1.0, share / count)
    spread = np.maximum(high / count - share, share - low / count)
    spread = np.where(flat & (not transparent), 0.0, spread)
    return AmbientVisibility(share, spread, 1.0 + count / 64.0 if transparent else 1.0)


# The terminator


@dataclass(frozen=True, eq=False)
class Normals:
    """Unit normals at points (..., 3)."""

    turned: Floats  # by a map
    smooth: Floats  # interpolated
    facing: Floats  # of the visible side of the face
    bend: Floats  # (...) sine of the angle between the interpolated normal and those of neighboring faces


def softened(normals: Normals, to_light: Floats, reach: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the share of a light that arrives at surfaces whose shading normals differ from their faces', (...), with its
    bounds within rounding. to_light: unit, (..., 3). reach: (...) how far cosines may be off.

    M. J.-Y. Chiang, Y. K. Li, B. Burley, "Taming the Shadow Terminator", SIGGRAPH Talks 2019: g + g^2 - g^3 with g =
    (Ng.L)/(|Ng.N| (N.L)), at most 1. Here g is the minimum of three: for the visible side of the face, Ng, and the
    interpolated normal N, so that it falls to 0 where the light sinks below the face; for N and the normal that a map turned
    it to; and for N and the neighboring faces, whose Ng.L is at least N.L - bend, so that it changes without steps from face
    to face. It is 1 where all these normals are equal.
    """
    facing, normal = normals.facing, normals.smooth
    flat = (facing != 0.0).any(axis=-1)
    above, along, cosine = dot(facing, to_light), np.abs(dot(facing, normal)), dot(normal, to_light)
    turned, turned_along = dot(normals.turned, to_light), np.abs(dot(normals.turned, normal))
    mapped = (normals.turned != normal).any(axis=-1)

    def rising(part: Floats, full: Floats) -> Floats:
        share = np.where(part < full, part / np.where(full > 0.0, full, 1.0), 1.0)
        return np.where(part > 0.0, share, 0.0)

    def share(off: Floats | float) -> Floats:
        """Return the share with all cosines off by this much, in the same sense."""
        lower, bend = np.maximum(cosine - off, 0.0), np.clip(normals.bend - off, 0.0, MAX_BEND)
        g = np.where(flat, rising(above + off, np.maximum(along - off, 0.0) * lower), 1.0)
        g = np.minimum(g, rising(cosine + off - bend, np.maximum(cosine + off, 0.0) * (1.0 - bend)))
        of_map = rising(cosine + off, np.maximum(turned_along - off, 0.0) * np.maximum(turned - off, 0.0))
        g = np.where(mapped, np.minimum(g, of_map), g)
        return np.asarray(g + g * g - g * g * g)

    return share(0.0), share(-reach), share(reach)
