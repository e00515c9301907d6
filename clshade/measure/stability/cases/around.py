"""Cases 24i to 24k: environments whose pixels are as bright, as dark, as few or as extreme as can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ....errors import InputError
from ....pipeline.features import OPTIONAL
from ....scene.camera import Camera
from ....scene.environment import Environment
from ....scene.metallic_roughness import MetallicRoughness
from ....scene.model import Scene
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, worst

ROUGHNESSES = (0.0, 1e-4, 0.125, 0.6, 1.0)
_IMAGE = np.random.default_rng(8).uniform(0.0, 1.0, (16, 32, 3))


def scene_in(environment: Environment, roughness: float, metallic: float) -> Scene:
    """Return a bent sheet in an environment, without any other light."""
    material = replace(lit.MATERIAL, pbr=MetallicRoughness(metallic, roughness))
    return lit.scene_of(lit.patch(material=material), lights=(), ambient=0.0, environment=environment, preset="pbr")


def _drawn(bench: Bench, environments: tuple[Environment, ...], detail: str) -> Outcome:
    """Compare frames in environments with the oracle. All features are on: one program serves for all."""
    outcomes = []
    for number, environment in enumerate(environments):
        for k, roughness in enumerate(ROUGHNESSES):
            frame = bench.draw(scene_in(environment, roughness, (number + k) % 3 / 2.0), forced=OPTIONAL)
            outcomes.append(against_oracle(frame))
    return worst(outcomes, detail)


def suns(bench: Bench) -> Outcome:
    """One pixel of 1e6, where a mirror shows it and where it is blurred."""
    image = np.concatenate([_IMAGE, _IMAGE])
    image[11, 16] = 1e6
    return _drawn(bench, (Environment(image), Environment(image, rotation=180.0)), "10 frames")


def extreme_environments(bench: Bench) -> Outcome:
    """A single pixel, black, radiance up to 1e60 and down to 1e-42; NaN, negative and infinite pixels are refused."""
    environments = (
        Environment(np.full((1, 1, 3), 0.5)),
        Environment(np.zeros((2, 4, 3))),
        Environment(_IMAGE * 1e30, intensity=1e30),
        Environment(_IMAGE * 1e-30, intensity=1e-12),
    )
    outcome = _drawn(bench, environments, "20 frames; NaN, -1, inf refused")
    wrong = 0
    for bad in (np.nan, -1.0, np.inf):
        try:
            Environment(np.full((1, 1, 3), bad))
        except InputError:
            continue
        wrong += 1
    return replace(outcome, wrong=outcome.wrong + wrong)


def sun_behind(bench: Bench) -> Outcome:
    """One pixel of 1e6 at the seam, and at a pole, of an environment that is the background; from far and near."""
    outcomes = []
    for row, column, lookat in ((8, 0, (0.0, 0.0, -1.0)), (8, 31, (0.0, 0.0, -1.0)), (0, 9, (1e-9, 1.0, 1e-9))):
        image = _IMAGE.copy()
        image[row, column] = 1e6
        for focal in (0.1, 30.0):
            around = Camera((0.0, 0.0, 0.0), lookat, (0.3, 0.1, 0.2), focal, (1.0, 1.0), (61, 61))
            scene = lit.scene_of(camera=around, environment=Environment(image))
            outcomes.append(against_oracle(bench.draw(scene, background="environment", forced=OPTIONAL)))
    return worst(outcomes, "6 frames")


CASES = (
    Case("24i", "sun-pixel", "a pixel of 1e6 in an environment", "within the bound", suns, True),
    Case("24j", "environments", "one pixel, black, 1e60, 1e-42", "within the bound", extreme_environments, True),
    Case(
        "24k", "sun-behind", "a pixel of 1e6 in the background, at seam and pole", "within the bound", sun_behind, True
    ),
)
