"""The renderer of `bench` in whole NumPy arrays. Its depth is the reciprocal of what it compares."""

from __future__ import annotations

from ...scene.model import Scene
from ..bench.peers.numpy_arrays import Vectorized
from .drawing import Picture


class WholeArrays:
    def __init__(self, scene: Scene) -> None:
        self._drawer, self._camera = Vectorized(scene), scene.camera
        self.title = self._drawer.title

    def draw(self) -> Picture:
        image = self._drawer.draw(self._camera)
        return Picture(image[..., :3], self._drawer.depth(), image[..., 3])


def open_for(name: str, scene: Scene, samples: int, threads: int) -> WholeArrays:
    return WholeArrays(scene)
