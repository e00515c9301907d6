"""A light of each kind, in which every field has another value than its default."""

from dataclasses import MISSING, fields

import numpy as np

from clshade.scene.lights import DirectionalLight, Light, PointLight, RectangleLight, SpotLight

EVERY: tuple[Light, ...] = (
    PointLight((1, 2, 3), 0.1 * np.ones(3), "inverse-square", 9.5, 0.25),
    DirectionalLight((0, -3, 1), (1, 2, -1)),
    SpotLight((1, 2, 3), (0, 0, -2), (3, 2, 1), 10.0, 30.0, "inverse-square", 5.0),
    RectangleLight((0, 2, 1), (1, 0, 0), (0, 0, 1), (2, 2, 2), "inverse-square", 7.0),
)


def default_of(light: Light) -> Light:
    """Return a light of the same kind with defaults, other values where there are none."""
    needed = [field.name for field in fields(light) if field.default is MISSING and field.default_factory is MISSING]
    return type(light)(**{name: getattr(light, name)[::-1] for name in needed})
