"""The course's renderer in plain Python, `clshade.measure.bench.scanline`."""

from __future__ import annotations

import platform
from dataclasses import replace

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.model import Scene
from .. import scanline


class Plain:
    """Draws with the preset `course`, as clshade does for the comparison."""

    title, once = f"Python {platform.python_version()}, a loop over scanlines", True

    def __init__(self, scene: Scene) -> None:
        self.scene = replace(scene, preset="course")

    def draw(self, camera: Camera) -> Array:
        return scanline.render(replace(self.scene, camera=camera))[::-1]

    def close(self) -> None:
        """It holds nothing."""


def open_for(name: str, scene: Scene) -> Plain:
    return Plain(scene)
