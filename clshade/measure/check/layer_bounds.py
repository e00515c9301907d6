"""Comparison of a frame's layers, except Z and id, with the float64 oracle's; see `oracle_bounds`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ...base.arrays import Array, Floats
from ...images.layers import LAYER_TABLE
from ...oracle import OracleLayers
from ...scene.model import Scene, Settings
from ...scene.scalar_colors import scalar_range
from .oracle_bounds import FLOAT32_MAX, FLOAT32_TINY, HALF_ULP, allowed, real_of

# Barycentric coordinates, in units of 2^-24 (2^-53 in float64): an edge function is accurate to 2; 1/z and the product
# with it round once each: 4. The sum rounds twice more, its reciprocal and the product with that once: 4 + 6 + 2 = 12
# units of a weight, hence of all weights together. Weights of a clipped piece's corners are rounded, and so are their
# differences: 3; two fma: 2. The first corner's weight is 1 minus the two others: 2 * (12 + 3 + 2) + 2 = 36.
WEIGHT_UNITS = 36.0
# Means of corners by the last two weights, relative to the largest corner: the weights' 2 * 17, the rounding of the
# corners and of their differences, which may be twice as large, 3, and two fma: 2 * (34 + 3) + 2.
MEAN_UNITS = 76.0
NORMAL_UNITS = MEAN_UNITS + 6.0  # the length and its reciprocal add 6
# Texture coordinates are double-single, accurate to 2^-42 of the largest corner's, rounded once. In float64 they are means
# like the others, and the oracle's own 8 units count as well.
UV_UNITS = {"float32": 1.0, "float64": MEAN_UNITS}

# The share of rays is a quotient of whole numbers, rounded once; products and sums of transmittances are rounded as those of
# lights, 32 times, and more in all as `AmbientVisibility.rounding` says.
OPEN_UNITS = 32.0


def half_ulp(settings: Settings) -> float:
    """Return the largest relative rounding error of one kernel operation."""
    return 2.0**-53 if settings.precision == "float64" else 2.0**-24


def layer_bounds(oracle: OracleLayers, scene: Scene, settings: Settings) -> dict[str, Array]:
    """Return the largest absolute error allowed in each layer except albedo, (...)."""
    unit = np.maximum(half_ulp(settings), 2.0**-53 * oracle.weight_condition)  # positions are float64 on both sides
    eye = float(np.abs(scene.camera.eye).max())
    with np.errstate(divide="ignore", over="ignore"):
        normal = (NORMAL_UNITS * unit + oracle.normal_error) / oracle.normal_length
        # World positions are float64: the eye, the point and the corners that it interpolates are rounded to it.
        position = MEAN_UNITS * unit * oracle.reach + 8.0 * 2.0**-53 * (oracle.reach + eye)
    return {
        "N": normal,
        "P": position,
        "uv": UV_UNITS[settings.precision] * unit * oracle.most_uv,
        "barycentrics": WEIGHT_UNITS * unit,
        "scalar": np.maximum(MEAN_UNITS * unit * oracle.most_scalar, _least_scalar(scene, settings)),
        "AO": oracle.open_spread + OPEN_UNITS * half_ulp(settings) * oracle.open_rounding,
    }


def _least_scalar(scene: Scene, settings: Settings) -> float:
    """Return the size below which a scalar may become 0: as a real on a device, where all are divided by up to 2^28 (2^924)
    if the largest exceeds 2^100."""
    if settings.scalars is None:
        return 0.0
    ends = scalar_range(scene, settings.scalars.name) or (0.0, 0.0)
    info = np.finfo(real_of(settings))
    excess = max(int(np.frexp(max(map(abs, ends)))[1]) - 100, 0)
    return float(np.ldexp(info.tiny, min(excess, info.maxexp - 100)))


def layer_errors(
    layers: Mapping[str, Array], oracle: OracleLayers, scene: Scene, settings: Settings
) -> dict[str, Array]:
    """Return the error (...) of each of these layers, (..., K) or (...), relative to the bound: 1 is the most allowed.

    Infinite where numbers of objects, materials or instances differ; infinite or NaN where a value is not finite.
    """
    bounds, real = layer_bounds(oracle, scene, settings), real_of(settings)
    errors: dict[str, Array] = {}
    for name, value in layers.items():
        expected, row = getattr(oracle, name), LAYER_TABLE[name]  # type: ignore[index]
        if row.kind == "uint32":
            errors[name] = np.where(value == expected, 0.0, np.inf)
        elif name == "scalar":
            errors[name] = _scalar_errors(value, expected, bounds[name])
        elif name == "albedo":
            errors[name] = _albedo_errors(value, oracle, scene, settings)
        else:
            error = np.abs(value.astype(np.float64) - expected)
            error = error.max(axis=-1) if row.components else error
            with np.errstate(divide="ignore", invalid="ignore"):
                errors[name] = np.where(error <= np.finfo(real).tiny, 0.0, error / bounds[name])
    return errors


def _scalar_errors(scalar: Array, expected: Array, bound: Array) -> Array:
    """Return the errors of scalars; infinite where only one is NaN."""
    largest = float(np.finfo(scalar.dtype).max)
    missing = np.isnan(expected)
    with np.errstate(invalid="ignore"):
        errors = np.abs(scalar.astype(np.float64) - np.clip(expected, -largest, largest)) / bound
    return np.where(missing | np.isnan(scalar), np.where(missing & np.isnan(scalar), 0.0, np.inf), errors)


def _albedo_errors(albedo: Array, oracle: OracleLayers, scene: Scene, settings: Settings) -> Array:
    """Return the errors of albedo; its bounds are those of the image with shader nolight and one sample."""
    exact = settings.precision == "float64"
    bound = allowed(scene, replace(settings, samples=1)) * (1e-12 if exact else HALF_ULP) * oracle.budget
    limit = np.inf if exact else FLOAT32_MAX
    error = np.maximum(np.abs(albedo.astype(np.float64) - np.clip(oracle.albedo, -limit, limit)) - oracle.jump, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors: Floats = np.where(error <= FLOAT32_TINY, 0.0, error / bound).max(axis=-1)
        return errors
