"""Lights of a glTF file (KHR_lights_punctual), exposed for an image whose white is 1."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...base.arrays import Array, Floats
from ..lights import Attenuation, DirectionalLight, PlacedLight, PointLight, SpotLight
from ..model import Light
from .gltf_json import Item

_MOST = float(np.finfo(np.float32).max)
_HALF_PI = 1.5707964  # the float32 next to it is larger
_ATTENUATION: Attenuation = "inverse-square"


def lights_of(
    placed: list[tuple[Item, Array]], sphere: tuple[Array, float], ignored: list[str], scale: float | None = None
) -> tuple[tuple[Light, ...], float]:
    """Return the lights of the scene, and what their intensities, in candela and lux, were multiplied by.

    placed: each light and its matrix in the world. sphere: center and radius of the meshes. ignored: gets lights of an
    unknown type. scale: what to multiply them by instead, as in another pose.

    A file says how bright lights are, not how a picture of them is exposed. So all intensities are multiplied by one
    factor, with which the strongest light has the illuminance 1 at the center (for lights nearer than the radius: at that
    distance), its cone and range aside. Ratios are the file's. Without a light that shines there are none.
    """
    center, radius = sphere
    found, illuminances = [], []
    for item, matrix in placed:
        light = _light(item, matrix, ignored)
        if light is not None:
            brightest = float(np.abs(light.intensity).max())
            if isinstance(light, PlacedLight):
                away = max(math.dist(light.position, center), radius)
                brightest = brightest / away / away
            illuminances.append(brightest)
            found.append(light)
    if scale is not None:
        return tuple(_brighter(light, scale) for light in found), scale
    strongest = max(illuminances, default=0.0)
    if not 0.0 < strongest < math.inf or not math.isfinite(1.0 / strongest):
        return (), 1.0
    return tuple(_brighter(light, 1.0 / strongest) for light in found), 1.0 / strongest


def _brighter(light: Light, factor: float) -> Light:
    with np.errstate(over="ignore"):
        intensity: Floats = np.clip(light.intensity * factor, -_MOST, _MOST)
    return replace(light, intensity=intensity)


def _light(item: Item, matrix: Array, ignored: list[str]) -> Light | None:
    """Return a light in the file's units; None for one that has no direction, or whose type is unknown."""
    kind = item.text("type")
    if kind not in ("directional", "point", "spot"):
        ignored.append("lights of an unknown type")
        return None
    color = item.numbers("color", 3, (1.0, 1.0, 1.0)) * item.number("intensity", 1.0, least=0.0)
    color = np.clip(color, -_MOST, _MOST)
    position, direction = matrix[:3, 3], -matrix[:3, 2]
    if kind != "point" and not direction.any():
        return None
    if kind == "directional":
        return DirectionalLight(direction, color)
    limit = item.number("range") if "range" in item.value else None
    if limit is not None and limit <= 0.0:
        raise item.error("range", "a number above 0", f"{limit:g}")
    if kind == "point":
        return PointLight(position, color, _ATTENUATION, limit)
    inner, outer = _cone(item)
    return SpotLight(position, direction, color, inner, outer, _ATTENUATION, limit)


def _cone(item: Item) -> tuple[float, float]:
    """Return the angles of a spot light, degrees."""
    cone = item.item("spot") or Item({}, item.where, item.root, item.owner)
    inner, outer = cone.number("innerConeAngle", 0.0, least=0.0), cone.number("outerConeAngle", math.pi / 4, least=0.0)
    if outer > _HALF_PI:
        raise cone.error("outerConeAngle", "radians from 0 to pi/2", f"{outer:g}")
    if inner > outer:
        raise cone.error("innerConeAngle", f"at most outerConeAngle, {outer:g}", f"{inner:g}")
    degrees = math.degrees(min(inner, math.pi / 2)), math.degrees(min(outer, math.pi / 2))
    return min(degrees[0], 90.0), min(degrees[1], 90.0)
