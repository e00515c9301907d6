"""The course's renderer in plain Python (`clshade.measure.bench.scanline`) as a peer."""

from __future__ import annotations

import platform
from dataclasses import replace

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.model import Scene
from .. import scanline


class Plain:
    """Renderer with the preset `course`, which clshade uses for the comparison too."""

    title, once = f"Python {platform.python_version()}, a loop over scanlines", True

    def __init__(self, scene: Scene) -> None:
        self.scene = replace(scene, preset="course")

    def draw(self, camera: Camera) -> Array:
        return scanline.render(replace(self.scene, camera=camera))[::-1]

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def open_for(name: str, scene: Scene) -> Plain:
    return Plain(scene)
