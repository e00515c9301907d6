"""Cases 24c to 24h: lights with attenuation, range and cone where these are steep, as far away as they may be, tiny and
huge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....scene.lights import ATTENUATIONS
from ....scene.model import DirectionalLight, Light, PointLight, RectangleLight, SpotLight
from . import lit
from .bench import Bench, Case, Outcomes, all_against_oracle
from .light import unit

FAR = 1e30
_COLOR, _DIM = (1.0, 0.5, 0.2), (0.3, 0.2, 0.1)
_ABOVE = np.array([0.1, 0.2, 1.0])
_SHEET = lit.patch()
_CORNERS = _SHEET.verts[_SHEET.faces[30]]
_VERTEX = _SHEET.verts[24]


def _under(bench: Bench, lights: Sequence[Light]) -> Outcomes:
    """Compare a sheet under each of these lights and a plain one with the oracle."""
    scenes = [lit.scene_of(_SHEET, lights=(light, lit.LIGHTS[1])) for light in lights]
    return all_against_oracle(bench, scenes)


def attenuation(bench: Bench) -> Outcomes:
    """Inverse-square lights at a vertex, in a face, 1e-9 to 1 before it, and at the eye."""
    inside = np.array([0.3, 0.3, 0.4]) @ _CORNERS
    normal = unit(np.cross(_CORNERS[1] - _CORNERS[0], _CORNERS[2] - _CORNERS[0]))
    places = [_VERTEX, inside, lit.CAMERA.eye, *(inside + normal * 10.0**power for power in range(-9, 1))]
    return _under(bench, [PointLight(place, _DIM, "inverse-square") for place in places])


def cone_edge(bench: Bench) -> Outcomes:
    """Spots whose edge crosses the sheet: inner and outer angle equal or nearly, 0 and 90 degrees, an edge along the
    surface."""
    cones = ((20.0, 20.0), (19.99, 20.0), (0.0, 20.0), (0.0, 1.0), (0.0, 1e-4), (0.0, 0.0), (90.0, 90.0), (0.0, 90.0))
    above, beside = np.array([0.1, 0.2, 1.5]), np.array([-1.5, 0.0, 0.2])
    lights = [SpotLight(above, (0.05, -0.1, -1.0), (1, 1, 1), *cone) for cone in cones]
    lights += [SpotLight(beside, (0.0, 0.0, 1.0), (1, 1, 1), *cone, "inverse-square") for cone in cones[-2:]]
    return _under(bench, lights)


def range_edge(bench: Bench) -> Outcomes:
    """Lights that end within the sheet, just before it, and at once."""
    ends = (0.85, 0.85 * (1 - 1e-6), 0.85 * (1 + 1e-6), 1.1, 1e-3, 1e-30, 1e30)
    return _under(bench, [PointLight(_ABOVE, _COLOR, "inverse-square", end) for end in ends])


def far_away(bench: Bench) -> Outcomes:
    """Lights 1e19 and 1e30 away, as bright as float32 allows, with and without a cone, and from infinitely far."""
    toward = np.array([0.3, 0.4, 1.2]) / 1.3
    bright = np.full(3, 3e38)
    lights: list[Light] = [
        DirectionalLight(-toward),
        DirectionalLight(-toward * 1e-300),
        PointLight(toward * FAR, bright, "inverse-square"),
        SpotLight(toward * FAR, -toward, bright, 0.0, 60.0, "inverse-square", 2.0 * FAR),
        PointLight(toward * 1e19, bright, "inverse-square"),
        SpotLight(toward * FAR, -toward, (1, 1, 1), 30.0, 60.0),
    ]
    return _under(bench, lights)


def spheres(bench: Bench) -> Outcomes:
    """Spheres 1e-7 to 1e20 in radius, around a vertex of the sheet and around the whole of it, and one whose disc faces a
    vertex that is where its mirror plane is not defined."""
    lights = [
        PointLight(_ABOVE, _COLOR, attenuation, radius=radius)
        for radius in (1e-7, 0.3, 3.0, 1e6, 1e17, 1e20)
        for attenuation in ATTENUATIONS
    ]
    bright = 1e38 * np.array(_COLOR)  # so that something arrives
    lights += [PointLight(_ABOVE, bright, "inverse-square", radius=radius) for radius in (1e17, 1e20)]
    lights += [PointLight(_VERTEX, _DIM, "inverse-square", radius=radius) for radius in (1e-7, 0.5)]
    lights.append(PointLight(_VERTEX - np.array([2.0, 3.0, 5.0]) / 4.0, radius=0.5))
    return _under(bench, lights)


def rectangles(bench: Bench) -> Outcomes:
    """Rectangles 1e-7 to 1e6 wide, in the plane of a face, edge-on, through the sheet, and nearly folded to a line."""
    first, second = _CORNERS[1] - _CORNERS[0], _CORNERS[2] - _CORNERS[0]
    across, along, upright = np.eye(3)
    lights = [
        RectangleLight(_ABOVE, size * across, -size * along, _COLOR, attenuation)
        for size in (1e-7, 0.3, 1e6)
        for attenuation in ATTENUATIONS
    ]
    lights += [
        RectangleLight(_CORNERS.mean(axis=0), first, second),
        RectangleLight(_CORNERS.mean(axis=0), second, first, _DIM, "inverse-square"),
        RectangleLight(_ABOVE - 0.8 * upright, 0.5 * across, 0.5 * upright),
        RectangleLight((0.0, 0.0, 0.1), 0.5 * across, 0.3 * upright, _DIM, "inverse-square"),
        RectangleLight(_ABOVE, across, -across + 2e-6 * along),
    ]
    return _under(bench, lights)


CASES = (
    Case("24c", "attenuation", "inverse-square lights in the surface", "within the bound", attenuation),
    Case("24d", "cone-edge", "edges of cones, 0 and 90 degrees", "within the bound", cone_edge),
    Case("24e", "range-edge", "lights that end in the surface", "within the bound", range_edge),
    Case("24f", "far-lights", "lights 1e30 away", "within the bound", far_away),
    Case("24g", "spheres", "spheres: tiny, huge, around what they light", "within the bound", spheres, True),
    Case("24h", "rectangles", "rectangles: tiny, huge, edge-on", "within the bound", rectangles),
)
