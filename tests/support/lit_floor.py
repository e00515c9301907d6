"""A floor with a coarse grid of its own, seen from above, below lights. Its middle is the center of a pixel."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import oracle_asserts
from devices import rendered, skip_unsupported

from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.scene.camera import Camera
from clshade.scene.model import Light, Material, Mesh, PointLight, Scene

CAMERA = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (41, 41))
MATTE = Material(ka=0.0, kd=1.0, ks=0.0)
GLOSSY = Material(ka=0.1, kd=0.7, ks=0.4, n=30.0)


def floor(material: Material, cells: int = 4) -> Mesh:
    line = np.linspace(-2.5, 2.5, cells + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(line, line))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = [
        np.stack([first, first + 1, first + cells + 2], 1),
        np.stack([first, first + cells + 2, first + cells + 1], 1),
    ]
    return Mesh(np.stack([x, y, 0.0 * x], 1), np.concatenate(faces), material=material)


def lit_by(*lights: Light, material: Material = GLOSSY) -> Scene:
    return Scene(floor(material), CAMERA, lights)


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    return rendered(scene, device=device, **{"layers": ("Z", "id"), "shader": "phong", **options})


def assert_lights(device: Device, lights: Iterable[Light], **options: Any) -> None:
    """Assert that the floor below each light, and a weak point, is the oracle's."""
    skip_unsupported(device, options)
    for light in lights:
        frame = draw(device, lit_by(light, PointLight((2.0, 2.0, 3.0), 0.3 * np.ones(3))), **options)
        assert bounds_of(frame) < (3.0 if "precision" not in options else np.inf)
        assert frame.rgb.max() > 0.2


def bounds_of(frame: Frame, **options: Any) -> float:
    """Return the largest error over its bound, and assert that it is at most 1. options: of `assert_frame`."""
    return oracle_asserts.assert_drawn(frame, **options).bounds
