"""Cases 24i to 24k: environments whose pixels are as bright, as dark, as few or as extreme as can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....pipeline.features import OPTIONAL
from ....scene.camera import Camera
from ....scene.environment import Environment
from ....scene.metallic_roughness import MetallicRoughness
from ....scene.model import Scene
from . import lit
from .bench import Bench, Case, Outcomes, all_against_oracle

ROUGHNESSES = (0.0, 1e-4, 0.125, 0.6, 1.0)
_IMAGE = np.random.default_rng(8).uniform(0.0, 1.0, (16, 32, 3))


def scene_in(environment: Environment, roughness: float, metallic: float) -> Scene:
    """Return a bent sheet in an environment, without any other light."""
    material = replace(lit.MATERIAL, pbr=MetallicRoughness(metallic, roughness))
    return lit.scene_of(lit.patch(material=material), lights=(), ambient=0.0, environment=environment, preset="pbr")


def _drawn(bench: Bench, environments: tuple[Environment, ...]) -> Outcomes:
    """Compare frames in environments with the oracle. All features are on: one program serves for all."""
    scenes = [
        scene_in(environment, roughness, (number + k) % 3 / 2.0)
        for number, environment in enumerate(environments)
        for k, roughness in enumerate(ROUGHNESSES)
    ]
    return all_against_oracle(bench, scenes, forced=OPTIONAL)


def suns(bench: Bench) -> Outcomes:
    """One pixel of 1e6, where a mirror shows it and where it is blurred."""
    image = np.concatenate([_IMAGE, _IMAGE])
    image[11, 16] = 1e6
    return _drawn(bench, (Environment(image), Environment(image, rotation=180.0)))


def extreme_environments(bench: Bench) -> Outcomes:
    """A single pixel, black, radiance up to 1e60 and down to 1e-42."""
    environments = (
        Environment(np.full((1, 1, 3), 0.5)),
        Environment(np.zeros((2, 4, 3))),
        Environment(_IMAGE * 1e30, intensity=1e30),
        Environment(_IMAGE * 1e-30, intensity=1e-12),
    )
    return _drawn(bench, environments)


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
    Case("24i", "sun-pixel", "a pixel of 1e6 in an environment", "within the bound", suns, True),
    Case("24j", "environments", "one pixel, black, 1e60, 1e-42", "within the bound", extreme_environments, True),
    Case("24k", "sun-behind", "a pixel of 1e6 at seam and pole behind all", "within the bound", sun_behind, True),
)
