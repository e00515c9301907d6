"""The least that a frame of a float image costs in NumPy: writing its background."""

from __future__ import annotations

import numpy as np

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.model import Scene


class Write:
    """Writes linear RGB of the background and coverage 0."""

    title, once = f"NumPy {np.__version__}, writing the background", False

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        columns, rows = scene.camera.resolution
        background = np.zeros(3) if scene.background is None else scene.background
        # A pixel of 16 bytes at a time, as one number: broadcasting four channels takes five times as long.
        self._pixel = np.array([*background, 0.0], np.float32).view(np.complex128)[0]
        self._image = np.zeros((rows, columns, 4), np.float32)

    def draw(self, camera: Camera) -> Array:
        self._image.view(np.complex128).fill(self._pixel)
        return self._image

    def close(self) -> None:
        """It holds nothing but its image."""


def open_for(name: str, scene: Scene) -> Write:
    return Write(scene)
