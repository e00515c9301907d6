"""The minimum cost of a float image in NumPy: writing its background."""

from __future__ import annotations

import numpy as np

from ....base.arrays import Array
from ....scene.camera import Camera
from ....scene.model import Scene


class Write:
    """Writer of the background's linear RGB and coverage 0."""

    title, once = f"NumPy {np.__version__}, writing the background", False

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        columns, rows = scene.camera.resolution
        background = np.zeros(3) if scene.background is None else scene.background
        # Write a pixel's 16 bytes as one number: broadcasting four channels takes five times as long.
        self._pixel = np.array([*background, 0.0], np.float32).view(np.complex128)[0]
        self._image = np.zeros((rows, columns, 4), np.float32)

    def draw(self, camera: Camera) -> Array:
        self._image.view(np.complex128).fill(self._pixel)
        return self._image

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


def open_for(name: str, scene: Scene) -> Write:
    return Write(scene)
