"""How far a frame's colors, depths and owners may be from the float64 oracle's, and by how much of that they are."""

from __future__ import annotations

import numpy as np

from ...base.arrays import Array, Bools, Floats, Reals
from ...oracle import OracleFrame, depth_at, nearest_depths
from ...oracle.corners import usable_uvs
from ...scene.material import MAPS
from ...scene.model import Mesh, Scene, Settings

HALF_ULP = 2.0**-24  # largest relative rounding error of one float32 operation
FLOAT32_MAX = float(np.finfo(np.float32).max)
FLOAT32_TINY = float(np.finfo(np.float32).tiny)  # a device may flush smaller values to zero
# Either of two faces may own the pixel if their relative difference in depth is at most this. The kernels treat
# 1/depths within 2^-40 as equal, as double-single values, which are accurate to 2^-43: an owner is at most 1.25 * 2^-40
# behind the nearest face. 2^-38 allows for chains of three such ties.
DEPTH_TIE = 2.0**-38
# Z = 1/(sum(E_i * 1/z_i) * 1/area), whose terms are positive: of E_i (kernels/edge.clh) 2 roundings, of 1/z_i, the product
# and two sums 4, of the area, its reciprocal and the product 3, of Z 1. Of the oracle's mean ratio of depths 9, of Z 3.
DEPTH_ROUNDINGS = 10
DEPTH_ROUNDINGS_FLOAT64 = 10 + 12
ALLOWED = {"float32": 32.0, "float64": 1.0}  # largest color error in units of `color_bound`, by precision
# In float32, texture coordinates are double-single: some eight roundings, each 2^-48 of the largest coordinate, times the
# texels across the image, add up to one bound when coordinates span this many texels. The 32 include one such bound.
TEXELS_PER_BOUND = 2.0**-24 / (8.0 * 2.0**-48)
# float64 interpolates them in float64, as the oracle does: some four roundings on either side, each 2^-53 of the
# largest coordinate, times the texels.
FLOAT64_PER_TEXEL = 8.0 * 2.0**-53 / 1e-12


def tied(first: Floats, second: Floats) -> Bools:
    """Return where two float64 depths are finite and within DEPTH_TIE of the larger."""
    with np.errstate(invalid="ignore"):
        close = np.abs(first - second) <= DEPTH_TIE * np.maximum(np.abs(first), np.abs(second))
        both: Bools = np.isfinite(first) & np.isfinite(second) & close
        return both


def different_ids(
    ids: Array,
    oracle: OracleFrame,
    scene: Scene,
    settings: Settings,
    where: tuple[Array, Array] | None = None,
) -> tuple[Array, Array]:
    """Return where ids (M, N) differ from the oracle's, and where no depth tie excuses that, both (M, N) bool.

    With visibility `depth` the owner may differ where both faces cover the pixel at depths within DEPTH_TIE.
    where: rows and columns of the pixels in `ids` and `oracle`, unless they are the whole image.
    """
    different = ids != oracle.id
    if not different.any() or settings.visibility != "depth":
        return different, different
    at = np.nonzero(different)
    # Background becomes face -1, which covers nothing: depth_at returns +inf, so it never ties.
    faces = [side[at].astype(np.int64) - 1 for side in (ids, oracle.id)]
    pixels = at if where is None else tuple(index[at] for index in where)
    depths = [depth_at(scene, settings, face, *pixels) for face in faces]
    unproven = np.zeros_like(different)
    unproven[at] = ~tied(depths[0], depths[1])
    unproven &= ~oracle.unsure
    return different, unproven


def alpha_differs(alpha: Array, oracle: OracleFrame, factor: float, precision: str) -> Array:
    """Return where alphas (M, N) are not the oracle's: exactly, but where transparent surfaces show. factor: the bounds
    allowed. Of surfaces whose order is unsure the alpha is the same."""
    exact: Array = alpha != oracle.alpha.astype(alpha.dtype)
    unit = 1e-12 if precision == "float64" else HALF_ULP
    tolerance = np.minimum(factor * unit * oracle.alpha_error, 1.0)
    return exact & ~(np.abs(alpha.astype(np.float64) - oracle.alpha) <= tolerance)


def depth_ties(scene: Scene, settings: Settings, suspects: Array, where: tuple[Array, Array] | None = None) -> Array:
    """Return which of the pixels `suspects`, bool, have a sample whose two nearest faces are within DEPTH_TIE; same
    shape.

    where: rows and columns of the pixels, unless they are the whole image.
    """
    ties = np.zeros_like(suspects)
    at = np.nonzero(suspects)
    if settings.visibility == "depth" and len(at[0]):
        pixels = at if where is None else tuple(index[at] for index in where)
        depths = nearest_depths(scene, settings, *pixels)
        ties[at] = tied(depths[:, 0], depths[:, 1]).any(axis=0)
    return ties


def real_of(settings: Settings) -> type[np.floating]:
    """Return the type of a frame's image and depths."""
    return np.float64 if settings.precision == "float64" else np.float32


def allowed(scene: Scene, settings: Settings) -> float:
    """Return the largest color error allowed in this scene, in units of `color_bound`.

    A sum over samples rounds once per sample, to 2^-24 of the partial sum, which is half of the total on average.
    """
    precision = settings.precision
    of_samples = settings.samples / 2 if settings.samples > 1 and precision != "float64" else 0.0
    of_textures = 0.0
    for mesh in scene.meshes:
        if mesh.uvs is not None and texture_side(mesh):
            reach = max(np.abs(usable_uvs(uvs)).max(initial=0.0) for uvs in (mesh.uvs, *mesh.more_uvs))
            of_textures = max(of_textures, float(texture_bounds(texture_side(mesh), reach, precision)))
    return ALLOWED[precision] + of_samples + of_textures


def texture_side(mesh: Mesh) -> int:
    """Return the texels along the larger side of a mesh's textures; 0 if none is looked up."""
    if mesh.uvs is None:
        return 0
    facets = mesh.material.microfacets
    textures = [mesh.material.texture, *(getattr(facets, name) for name in MAPS)]
    return max((max(texture.image.shape[:2]) for texture in textures if texture is not None), default=0)


def texture_bounds(side: Array | int, reach: Array | float, precision: str) -> Floats:
    """Return the bounds allowed on top of ALLOWED, (...), for textures of `side` texels and coordinates up to `reach`."""
    texels = np.asarray(side) * np.asarray(reach, np.float64)
    if precision == "float64":
        return FLOAT64_PER_TEXEL * texels
    more: Floats = np.maximum(texels / TEXELS_PER_BOUND - 1.0, 0.0)
    return more


def color_bound(oracle: OracleFrame, precision: str = "float32") -> Floats:
    """Return the unit of color errors, (M, N, 3): sqrt(max(n, 1)) * 2^-24 * kappa * B; in float64 1e-12 * kappa * B.

    sqrt(n) is the condition number of the highlight: with d = |R - V| it is nearly exp(-n d^2/2), which an error e of the
    directions changes by n d e exp(-n d^2/2), at most 0.61 sqrt(n) e. kappa is that of the geometry: how far rounding
    errors of positions and normals are amplified. The number of these units allowed is the number of roundings that may
    add up. Beyond n = 1e4 the oracle's own power is not accurate to 1e-12: float64 is allowed n/1e4 times as much.
    """
    scale = rounding(oracle, precision)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where(oracle.budget > 0.0, scale[..., None] * oracle.budget, 0.0)


def rounding(oracle: OracleFrame, precision: str = "float32") -> Floats:
    """Return `color_bound` relative to the light budget B, (M, N)."""
    unit = 1e-12 if precision == "float64" else HALF_ULP
    return exponent_condition(oracle.exponent, precision) * oracle.kappa * unit


def exponent_condition(exponent: Floats, precision: str = "float32") -> Floats:
    """Return how much specular exponents (...) amplify errors, see `color_bound`."""
    if precision == "float64":
        return np.maximum(exponent / 1e4, 1.0)
    return np.sqrt(np.maximum(exponent, 1.0))


def color_errors(rgb: Reals, oracle: OracleFrame, precision: str = "float32") -> tuple[Floats, Floats]:
    """Return the absolute errors (M, N, 3) of colors, and the largest of each pixel (M, N) in bounds.

    Beyond the range of float32 the largest finite value is expected; errors so small that a device may flush them to
    zero count as none.
    """
    limit = np.inf if precision == "float64" else FLOAT32_MAX
    error = np.abs(rgb.astype(np.float64) - np.clip(oracle.rgb, -limit, limit))
    error = np.where(error <= FLOAT32_TINY, 0.0, error)
    with np.errstate(divide="ignore", invalid="ignore"):
        return error, np.where(error > 0.0, error / color_bound(oracle, precision), 0.0).max(axis=-1)


def excepted_at_gates(rgb: Array, oracle: OracleFrame, factor: float, precision: str = "float32") -> Array:
    """Return the pixels (M, N) bool that are off by more than `factor` bounds, but by no more than `factor` bounds plus
    the highlights that rounding may open or close there."""
    error, ratio = color_errors(rgb, oracle, precision)
    within = error <= oracle.jump + factor * color_bound(oracle, precision)
    return oracle.gate & (ratio > factor) & within.all(axis=-1)


def depth_roundings(Z: Reals) -> int:
    """Return how many roundings depths of this type may be off by."""
    return DEPTH_ROUNDINGS_FLOAT64 if Z.dtype == np.float64 else DEPTH_ROUNDINGS


def depth_errors(Z: Reals, oracle: OracleFrame) -> Floats:
    """Return relative errors of depths (M, N) in roundings (2^-24, in float64 2^-53); infinite if only one is
    background."""
    empty = np.isinf(oracle.Z)
    with np.errstate(invalid="ignore"):
        error = np.abs(Z.astype(np.float64) - oracle.Z) / np.abs(oracle.Z) / (np.finfo(Z.dtype).eps / 2.0)
    return np.where(empty, np.where(np.isposinf(Z), 0.0, np.inf), error)
