"""A floor with a coarse grid of its own, seen from above, below lights. Its middle is the center of a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle_asserts

from clshade import oracle
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Light, Material, Mesh, Scene

CAMERA = Camera((0.0, 0.0, 6.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, (1.0, 1.0), (41, 41))
MATTE = Material(ka=0.0, kd=1.0, ks=0.0)
GLOSSY = Material(ka=0.1, kd=0.7, ks=0.4, n=30.0)


def floor(material: Material, cells: int = 4) -> Mesh:
    line = np.linspace(-2.5, 2.5, cells + 1)
    x, y = (each.ravel() for each in np.meshgrid(line, line))
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    faces = [
        np.stack([first, first + 1, first + cells + 2], 1),
        np.stack([first, first + cells + 2, first + cells + 1], 1),
    ]
    return Mesh(np.stack([x, y, 0.0 * x], 1), np.concatenate(faces), material=material)


def lit_by(*lights: Light, material: Material = GLOSSY) -> Scene:
    return Scene(floor(material), CAMERA, lights)


def draw(device: Device, scene: Scene, **options: Any) -> Frame:
    with Renderer(scene, device=device, **{"layers": ("Z", "id"), "shader": "phong", **options}) as renderer:
        return renderer.render()


def bounds_of(frame: Frame, **options: Any) -> float:
    """Return the largest error over its bound, and assert that it is at most 1. options: of `assert_frame`."""
    expected = oracle.render(frame.scene, frame.settings)
    return oracle_asserts.assert_frame(frame, expected, frame.scene, frame.settings, **options).bounds
