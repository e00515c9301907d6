"""Transparent surfaces: the fragments before a pixel's owner, in their order, and the light that passes through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from . import coverage, shade
from .corners import Corners, interpolated
from .shot import Shot
from .texture import bilerp, brightest, color_texture, lookup_of, spread

EQUAL = 2.0**-40  # relative difference of depths that count as equal: the later face is nearer
SURELY_EQUAL, SURELY_APART = 2.0**-41, 2.0**-38  # the renderer may treat differences in between as either
DOUBT = 1e-5  # an interpolated alpha so close to that of layers may be on either side
# A fragment's share of light takes a rounding for each fragment before it, one for its product, and each fragment after it
# rounds the sum: 2 n + 2 of n fragments, of the 32 that the unit of errors allows.
ROUNDINGS = 1.0 / 32.0


@dataclass(frozen=True, eq=False)
class Fragments:
    """Transparent pieces that show at pixels, by pixel and nearest first."""

    pixel: Integers  # (N,)
    piece: Integers
    rank: Integers  # from 0 in each pixel
    unsure: Bools  # (K,) pixels where rounding may change the order


def alphas(corners: Corners, face: Integers, weights: Floats) -> tuple[Floats, Floats, Bools]:
    """Return the alpha of faces (K,) at corner weights (K, 3), the largest magnitude that enters it, and whether it is
    interpolated, (K,) each."""
    alpha = interpolated(weights, corners.alphas[face][..., None])[:, 0]  # of a constant it is exact
    magnitude = np.abs(corners.alphas[face]).max(axis=1)
    varies: Bools = np.asarray((corners.alphas[face] < 1.0).any(axis=1))
    for mesh, mine in corners.by_mesh(face):
        texture = color_texture(mesh)
        if texture is not None and texture.image.shape[2] == 4:
            uv = interpolated(weights[mine], corners.uvs_for(texture)[face[mine]])
            looked_up = uv, texture.image[..., 3:], lookup_of(texture), texture.wrap
            alpha[mine] *= bilerp(*looked_up)[:, 0]
            magnitude[mine] *= brightest(*looked_up)[:, 0]
            varies[mine] = True
        alpha[mine] *= mesh.material.opacity
        magnitude[mine] *= mesh.material.opacity
    return alpha, magnitude, varies


class Transmittance(NamedTuple):
    """The share of light that transparent occluders let pass, (...), and its bounds within rounding."""

    share: Floats
    low: Floats
    high: Floats
    jumps: Bools  # where rounding decides whether one is crossed, or its alpha test passed


def face_transmittance(corners: Corners, face: Integers, weights: Floats, off: Floats) -> Transmittance:
    """Return the transmittance of faces (K,) at weights (K, 3) of their corners, which are `off` (K,) and a rounding of
    float32 from the device's."""
    alpha, _, _ = alphas(corners, face, weights)
    moved = off + 2.0**-22
    change = 2.0**-20 + 3.0 * moved * np.ptp(corners.alphas[face], axis=1)
    tested, blends, cutoff = *np.zeros((2, len(face)), bool), np.zeros(len(face))
    for mesh, mine in corners.by_mesh(face):
        texture = color_texture(mesh)
        if texture is not None and texture.image.shape[2] == 4:
            uv = corners.uvs_for(texture)[face[mine]]
            slack = moved[mine] * np.abs(uv).sum(axis=1).max(axis=1)
            if texture.filter == "nearest":
                at, both = interpolated(weights[mine], uv), np.stack([slack, slack], axis=1)
                change[mine] += spread(at, texture.image[..., 3:], texture.wrap, both)[:, 0]
            else:  # between the centers of texels alpha changes by at magnitude their difference, along both axes
                change[mine] += sum(texture.image.shape[:2]) * slack * np.ptp(texture.image[..., 3])
        if mesh.tests_alpha:
            tested[mine], blends[mine], cutoff[mine] = True, mesh.material.blend, mesh.material.alpha_cutoff
    doubt = tested & (np.abs(alpha - cutoff) <= change)
    low, high = np.clip(alpha - change, 0.0, 1.0), np.clip(alpha + change, 0.0, 1.0)
    alpha = np.clip(alpha, 0.0, 1.0)
    low, alpha, high = (
        np.where(tested, np.where(value >= cutoff, np.where(blends, value, 1.0), 0.0), value)
        for value in (low, alpha, high)
    )
    slip = 2.0**-19 * (1.0 - alpha)  # of the logarithm in steps
    return Transmittance(1.0 - alpha, np.maximum(1.0 - high - slip, 0.0), np.minimum(1.0 - low + slip, 1.0), doubt)


def passes(shot: Shot, piece: Integers, edges: Integers) -> Bools:
    """Return (K,) bool: where pixels of pieces (K,), with edge functions (K, 3), reach their material's alpha cutoff."""
    corners, face = shot.corners, shot.pieces.face[piece]
    cutoffs = [mesh.material.alpha_cutoff if mesh.tests_alpha else -np.inf for mesh in corners.scene.meshes]
    alpha, _, _ = alphas(corners, face, shot.weights(piece, edges))
    return np.asarray(alpha >= np.array(cutoffs, np.float64)[corners.mesh[face]])


def fragments_at(shot: Shot, owner: Integers, column: Integers, row: Integers) -> Fragments:
    """Return the transparent fragments of pixels (columns, rows from the BOTTOM), (K,) each, before their owners (K,), -1
    for none."""
    cut, count = shot.pieces, len(owner)
    blended = shot.drawn[shot.corners.of_meshes(lambda mesh: mesh.blends)[cut.face[shot.drawn]]]
    fragments: list[tuple[Integers, Integers, Integers]]
    fragments = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3), np.int64))]
    for k, at, at_edges in coverage.samples_at(cut.xy[blended], shot.setup.box[blended], column, row):
        passed = passes(shot, blended[k], at_edges)
        fragments.append((at[passed], blended[k[passed]], at_edges[passed]))
    pixel, piece, edges = (np.concatenate(parts) for parts in zip(*fragments, strict=True))
    if shot.settings.visibility == "painter":
        painter = coverage.painter_order(shot.z[cut.face], ~shot.setup.culled)
        rank = np.full(len(cut.face) + 1, len(painter))  # the last for no owner
        rank[painter] = np.arange(len(painter))
        order = np.lexsort((rank[piece], pixel))
        nearer = order[(rank[piece] < rank[owner[pixel]])[order]]
        return _ranked(pixel[nearer], piece[nearer], np.zeros(count, bool))
    behind, covered = np.full(count, np.inf), np.flatnonzero(owner >= 0)
    at_owner = coverage.edge_functions(cut.xy[owner[covered]], column[covered], row[covered])
    orthographic = shot.scene.camera.orthographic
    behind[covered] = shade.depth(at_owner, cut.z[owner[covered]], orthographic)
    z, face = shade.depth(edges, cut.z[piece], orthographic), cut.face[piece]
    gap = _gap(z, behind[pixel])
    before = np.where(gap <= EQUAL, face > cut.face[owner[pixel]], z < behind[pixel])
    unsure = np.zeros(count, bool)
    unsure[pixel[(gap > SURELY_EQUAL) & (gap <= SURELY_APART)]] = True
    order = np.lexsort((z, pixel))
    order = order[before[order]]
    pixel, piece, z, face = pixel[order], piece[order], z[order], face[order]
    same, gap = pixel[1:] == pixel[:-1], _gap(z[1:], z[:-1])
    unsure[pixel[1:][same & (gap > SURELY_EQUAL) & (gap <= SURELY_APART)]] = True
    group = np.append(0, np.cumsum(~(same & (gap <= EQUAL))))[: len(pixel)]
    order = np.lexsort((-face, group))
    return _ranked(pixel[order], piece[order], unsure)


def _gap(a: Floats, b: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore"):
        gap: Floats = np.where(a == b, 0.0, np.abs(a - b) / np.maximum(np.abs(a), np.abs(b)))
    return np.where(np.isnan(gap), np.inf, gap)


def _ranked(pixel: Integers, piece: Integers, unsure: Bools) -> Fragments:
    return Fragments(pixel, piece, np.arange(len(pixel)) - np.searchsorted(pixel, pixel), unsure)
