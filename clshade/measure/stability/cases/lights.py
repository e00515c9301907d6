"""Cases 24c to 24f: lights with attenuation, range and cone where these are steep, and as far away as they may be."""

from __future__ import annotations

import numpy as np

from ....scene.model import DirectionalLight, Light, PointLight, SpotLight
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, worst

FAR = 1e30


def _drawn(bench: Bench, *lights: Light, cells: int = 6) -> Outcome:
    """Compare a sheet under these lights and a plain one."""
    return against_oracle(bench.draw(lit.scene_of(lit.patch(cells=cells), lights=(*lights, lit.LIGHTS[1]))))


def attenuation(bench: Bench) -> Outcome:
    """Inverse-square lights at a vertex, in a face, 1e-9 to 1 before it, and at the eye."""
    mesh, outcomes = lit.patch(), []
    corners = mesh.verts[mesh.faces[30]]
    inside = np.array([0.3, 0.3, 0.4]) @ corners
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    places = [mesh.verts[24], inside, lit.CAMERA.eye, *(inside + normal * 10.0**power for power in range(-9, 1))]
    for place in places:
        outcomes.append(_drawn(bench, PointLight(place, (0.3, 0.2, 0.1), "inverse-square")))
    return worst(outcomes, f"{len(places)} places")


def cone_edge(bench: Bench) -> Outcome:
    """Spots whose edge crosses the sheet: inner and outer angle equal or nearly, 0 and 90 degrees, an edge along the
    surface."""
    cones = ((20.0, 20.0), (19.99, 20.0), (0.0, 20.0), (0.0, 1.0), (0.0, 1e-4), (0.0, 0.0), (90.0, 90.0), (0.0, 90.0))
    above, beside = np.array([0.1, 0.2, 1.5]), np.array([-1.5, 0.0, 0.2])
    lights = [SpotLight(above, (0.05, -0.1, -1.0), (1, 1, 1), *cone) for cone in cones]
    lights += [SpotLight(beside, (0.0, 0.0, 1.0), (1, 1, 1), *cone, "inverse-square") for cone in cones[-2:]]
    return worst([_drawn(bench, light) for light in lights], f"{len(lights)} cones")


def range_edge(bench: Bench) -> Outcome:
    """Lights that end within the sheet, just before it, and at once."""
    place = np.array([0.1, 0.2, 1.0])
    height = 1.0 - 0.15
    ends = (height, height * (1 - 1e-6), height * (1 + 1e-6), 1.1, 1e-3, 1e-30, 1e30)
    lights = [PointLight(place, (1.0, 0.5, 0.2), "inverse-square", end) for end in ends]
    return worst([_drawn(bench, light) for light in lights], f"{len(ends)} ranges")


def far_away(bench: Bench) -> Outcome:
    """Lights 1e19 and 1e30 away, as bright as float32 allows, with and without a cone, and from infinitely far."""
    toward = np.array([0.3, 0.4, 1.2])
    toward /= np.linalg.norm(toward)
    bright = np.full(3, 3e38)
    lights: list[Light] = [
        DirectionalLight(-toward),
        DirectionalLight(-toward * 1e-300),
        PointLight(toward * FAR, bright, "inverse-square"),
        SpotLight(toward * FAR, -toward, bright, 0.0, 60.0, "inverse-square", 2.0 * FAR),
        PointLight(toward * 1e19, bright, "inverse-square"),
        SpotLight(toward * FAR, -toward, (1, 1, 1), 30.0, 60.0),
    ]
    outcomes = [_drawn(bench, light) for light in lights]
    return worst(outcomes, f"{len(lights)} lights")


CASES = (
    Case("24c", "attenuation", "inverse-square lights in the surface", "within the bound", attenuation),
    Case("24d", "cone-edge", "edges of cones, 0 and 90 degrees", "within the bound", cone_edge),
    Case("24e", "range-edge", "lights that end in the surface", "within the bound", range_edge),
    Case("24f", "far-lights", "lights 1e30 away", "within the bound", far_away),
)
