"""Transparent surfaces: which lie before a pixel's owner, in which order, and what they make of its color."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Scene, Settings
from . import coverage, shade
from .clip import Pieces
from .corners import Corners, interpolated, lookup_of, textured
from .shadows import Passed
from .texture import bilerp, brightest, spread

EQUAL = 2.0**-40  # relative difference of depths that count as equal: the later face is nearer
SURELY_EQUAL, SURELY_APART = 2.0**-41, 2.0**-38  # the renderer may take what lies between for either
DOUBT = 1e-5  # an interpolated alpha so close to that of layers may be on either side
# A fragment's share of light takes a rounding for each fragment before it, one for its product, and each fragment after it
# rounds the sum: 2 n + 2 of n fragments, of the 32 that the unit of errors allows.
ROUNDINGS = 1.0 / 32.0


@dataclass(frozen=True, eq=False)
class Fragments:
    """Transparent pieces that show at pixels, by pixel and nearest first. pixel, piece, place: (N,), place: from 0 in each
    pixel. unsure: (K,) bool, pixels where rounding may change the order."""

    pixel: Integers
    piece: Integers
    place: Integers
    unsure: Bools


def transparent_faces(scene: Scene, corners: Corners) -> Bools:
    """Return (F,) bool: the faces that are composited by alpha."""
    return np.array([mesh.blends for mesh in scene.meshes], bool)[corners.mesh]


def alphas(scene: Scene, corners: Corners, face: Integers, weights: Floats) -> tuple[Floats, Floats, Bools]:
    """Return the alpha of faces (K,) at corner weights (K, 3), the largest that enters it, and whether it is interpolated,
    (K,) each."""
    alpha = interpolated(weights, corners.alphas[face][..., None])[:, 0]  # of a constant it is exact
    most = np.abs(corners.alphas[face]).max(axis=1)
    varies: Bools = np.asarray((corners.alphas[face] < 1.0).any(axis=1))
    for index in np.unique(corners.mesh[face]):
        mesh, mine = scene.meshes[index], np.flatnonzero(corners.mesh[face] == index)
        texture = mesh.material.texture
        if textured(mesh) and texture.image.shape[2] == 4:
            uv = interpolated(weights[mine], corners.uvs_for(texture)[face[mine]])
            looked_up = uv, texture.image[..., 3:], lookup_of(texture), texture.wrap
            alpha[mine] *= bilerp(*looked_up)[:, 0]
            most[mine] *= brightest(*looked_up)[:, 0]
            varies[mine] = True
        alpha[mine] *= mesh.material.opacity
        most[mine] *= mesh.material.opacity
    return alpha, most, varies


def veiling_faces(scene: Scene, corners: Corners) -> Bools:
    """Return (F,) bool: the faces that may let light pass."""
    return np.array([mesh.blends or mesh.tests_alpha for mesh in scene.meshes], bool)[corners.mesh]


def veil_factors(scene: Scene, corners: Corners, face: Integers, weights: Floats, off: Floats) -> Passed:
    """Return what share of light faces (K,) let pass at weights (K, 3) of their corners, which are `off` (K,) and a rounding
    of float32 from the device's."""
    alpha, _, _ = alphas(scene, corners, face, weights)
    moved = off + 2.0**-22
    change = 2.0**-20 + 3.0 * moved * np.ptp(corners.alphas[face], axis=1)
    tested, blends, cutoff = *np.zeros((2, len(face)), bool), np.zeros(len(face))
    for index in np.unique(corners.mesh[face]):
        mesh, mine = scene.meshes[index], np.flatnonzero(corners.mesh[face] == index)
        texture = mesh.material.texture
        if textured(mesh) and texture.image.shape[2] == 4:
            uv = corners.uvs_for(texture)[face[mine]]
            slack = moved[mine] * np.abs(uv).sum(axis=1).max(axis=1)
            if texture.filter == "nearest":
                at, both = interpolated(weights[mine], uv), np.stack([slack, slack], axis=1)
                change[mine] += spread(at, texture.image[..., 3:], texture.wrap, both)[:, 0]
            else:  # between the centers of texels alpha changes by at most their difference, along both axes
                change[mine] += sum(texture.image.shape[:2]) * slack * np.ptp(texture.image[..., 3])
        if mesh.tests_alpha:
            tested[mine], blends[mine], cutoff[mine] = True, mesh.material.blend, mesh.material.alpha_cutoff
    doubt = tested & (np.abs(alpha - cutoff) <= change)
    low, high = np.clip(alpha - change, 0.0, 1.0), np.clip(alpha + change, 0.0, 1.0)
    alpha = np.clip(alpha, 0.0, 1.0)
    low, alpha, high = (
        np.where(tested, np.where(each >= cutoff, np.where(blends, each, 1.0), 0.0), each)
        for each in (low, alpha, high)
    )
    slip = 2.0**-19 * (1.0 - alpha)  # of the logarithm in steps
    return Passed(1.0 - alpha, np.maximum(1.0 - high - slip, 0.0), np.minimum(1.0 - low + slip, 1.0), doubt)


def passes(scene: Scene, corners: Corners, face: Integers, weights: Floats) -> Bools:
    """Return (K,) bool: where the alpha of faces (K,), at corner weights (K, 3), reaches their material's cutoff."""
    cutoffs = [m.material.alpha_cutoff if m.tests_alpha else None for m in scene.meshes]
    least = np.array([-np.inf if cutoff is None else cutoff for cutoff in cutoffs])[corners.mesh[face]]
    reached: Bools = alphas(scene, corners, face, weights)[0] >= least
    return reached


def ordered(
    settings: Settings,
    cut: Pieces,
    painter: Integers,
    owner: Integers,
    drawn: tuple[Integers, Integers, Integers],
    pixels: tuple[Integers, Integers],
    orthographic: bool,
) -> Fragments:
    """Return the fragments before the owners (K,), -1 for none, of pixels: columns and rows from the BOTTOM, (K,) each.

    painter: the pieces in painter's order. drawn: pixel, piece and edge functions of all transparent fragments.
    """
    pixel, piece, edges = drawn
    if settings.visibility == "painter":
        rank = np.full(len(cut.face) + 1, len(painter))  # the last for no owner
        rank[painter] = np.arange(len(painter))
        order = np.lexsort((rank[piece], pixel))
        kept = order[(rank[piece] < rank[owner[pixel]])[order]]
        return _placed(pixel[kept], piece[kept], np.zeros(len(owner), bool))
    z, face = shade.depth(edges, cut.z[piece], orthographic), cut.face[piece]
    behind, shown = np.full(len(owner), np.inf), np.flatnonzero(owner >= 0)
    at = coverage.edge_functions(cut.xy[owner[shown]], pixels[0][shown], pixels[1][shown])
    behind[shown] = shade.depth(at, cut.z[owner[shown]], orthographic)
    gap = _gap(z, behind[pixel])
    before = np.where(gap <= EQUAL, face > cut.face[owner[pixel]], z < behind[pixel])
    unsure = np.zeros(len(owner), bool)
    unsure[pixel[(gap > SURELY_EQUAL) & (gap <= SURELY_APART)]] = True
    order = np.lexsort((z, pixel))
    order = order[before[order]]
    pixel, piece, z, face = pixel[order], piece[order], z[order], face[order]
    same, gap = pixel[1:] == pixel[:-1], _gap(z[1:], z[:-1])
    unsure[pixel[1:][same & (gap > SURELY_EQUAL) & (gap <= SURELY_APART)]] = True
    group = np.append(0, np.cumsum(~(same & (gap <= EQUAL))))[: len(pixel)]
    order = np.lexsort((-face, group))
    return _placed(pixel[order], piece[order], unsure)


def _gap(a: Floats, b: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        gap: Floats = np.where(a == b, 0.0, np.abs(a - b) / np.maximum(np.abs(a), np.abs(b)))
    return np.where(np.isnan(gap), np.inf, gap)


def _placed(pixel: Integers, piece: Integers, unsure: Bools) -> Fragments:
    first = np.searchsorted(pixel, pixel)
    return Fragments(pixel, piece, np.arange(len(pixel)) - first, unsure)
