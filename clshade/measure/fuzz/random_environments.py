"""Random environments: of any size and direction, with suns and black pixels, never all black."""

from __future__ import annotations

from ...scene.environment import Environment
from .random_shapes import Random


def random_environment(rng: Random) -> Environment:
    """Return an environment, up to 16 x 32 pixels, that shines."""
    shape = int(rng.integers(1, 17)), int(rng.integers(1, 33)), 3
    image = rng.uniform(0.0, 1.0, shape) ** rng.choice((1, 6))
    if rng.random() < 0.3:
        image[rng.random(shape[:2]) < 0.5] = 0.0
    image[rng.integers(shape[0]), rng.integers(shape[1])] = rng.choice((1.0, 1.0, 1e3, 1e6))
    if rng.random() < 0.15:
        image *= 10.0 ** rng.uniform(-30, 24)
    up = rng.normal(size=3) if rng.random() < 0.5 else (0.0, 1.0, 0.0)
    return Environment(image, rotation=rng.uniform(-400.0, 400.0), intensity=rng.uniform(0.1, 3.0), up=up)
