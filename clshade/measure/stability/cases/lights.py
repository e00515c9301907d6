"""Cases 24c to 24k: lights with attenuation, range and cone where these are steep, far away, tiny and huge; environments
whose pixels are as bright, as dark or as few as can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....pipeline.features import OPTIONAL
from ....scene.camera import Camera
from ....scene.environment import Environment
from ....scene.lights import ATTENUATIONS
from ....scene.material import MetallicRoughness
from ....scene.model import DirectionalLight, Light, PointLight, RectangleLight, SpotLight
from . import lit
from .bench import Bench, Case, Outcomes, against_oracle, all_against_oracle
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


ROUGHNESSES = (0.0, 1e-4, 0.125, 0.6, 1.0)
_IMAGE = np.random.default_rng(8).uniform(0.0, 1.0, (16, 32, 3))


def _within(bench: Bench, *environments: Environment) -> Outcomes:
    """Compare a bent sheet in environments, without any other light, with the oracle. All features are on: one program
    serves for all."""
    for number, environment in enumerate(environments):
        for k, roughness in enumerate(ROUGHNESSES):
            pbr = MetallicRoughness((number + k) % 3 / 2.0, roughness)
            sheet = lit.patch(material=replace(lit.MATERIAL, pbr=pbr))
            scene = lit.scene_of(sheet, lights=(), ambient=0.0, environment=environment, preset="pbr")
            yield against_oracle(bench.draw(scene, forced=OPTIONAL))


def suns(bench: Bench) -> Outcomes:
    """One pixel of 1e6, where a mirror shows it and where it is blurred."""
    image = np.concatenate([_IMAGE, _IMAGE])
    image[11, 16] = 1e6
    return _within(bench, Environment(image), Environment(image, rotation=180.0))


def extreme_environments(bench: Bench) -> Outcomes:
    """A single pixel, black, radiance up to 1e60 and down to 1e-42."""
    small, black = Environment(np.full((1, 1, 3), 0.5)), Environment(np.zeros((2, 4, 3)))
    return _within(
        bench, small, black, Environment(_IMAGE * 1e30, intensity=1e30), Environment(_IMAGE * 1e-30, intensity=1e-12)
    )


def sun_behind(bench: Bench) -> Outcomes:
    """One pixel of 1e6 at the seam, and at a pole, of an environment that is the background; from far and near."""
    scenes = []
    for row, column, lookat in ((8, 0, (0.0, 0.0, -1.0)), (8, 31, (0.0, 0.0, -1.0)), (0, 9, (1e-9, 1.0, 1e-9))):
        image = _IMAGE.copy()
        image[row, column] = 1e6
        for focal in (0.1, 30.0):
            around = Camera((0.0, 0.0, 0.0), lookat, (0.3, 0.1, 0.2), focal, (1.0, 1.0), (61, 61))
            scenes.append(lit.scene_of(camera=around, environment=Environment(image)))
    return all_against_oracle(bench, scenes, background="environment", forced=OPTIONAL)


CASES = (
    Case("24c", "attenuation", "inverse-square lights in the surface", "within the bound", attenuation),
    Case("24d", "cone-edge", "edges of cones, 0 and 90 degrees", "within the bound", cone_edge),
    Case("24e", "range-edge", "lights that end in the surface", "within the bound", range_edge),
    Case("24f", "far-lights", "lights 1e30 away", "within the bound", far_away),
    Case("24g", "spheres", "spheres: tiny, huge, around what they light", "within the bound", spheres, True),
    Case("24h", "rectangles", "rectangles: tiny, huge, edge-on", "within the bound", rectangles),
    Case("24i", "sun-pixel", "a pixel of 1e6 in an environment", "within the bound", suns, True),
    Case("24j", "environments", "one pixel, black, 1e60, 1e-42", "within the bound", extreme_environments, True),
    Case("24k", "sun-behind", "a pixel of 1e6 at seam and pole behind all", "within the bound", sun_behind, True),
)
