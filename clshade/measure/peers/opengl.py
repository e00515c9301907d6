"""Mesa's llvmpipe by the OpenGL renderer of `bench`. Its depth is that of the depth buffer."""

from __future__ import annotations

from ...scene.model import Scene
from ..bench.peers import opengl
from .drawing import Picture


class DepthToo:
    def __init__(self, name: str, scene: Scene) -> None:
        self._drawer, self._camera = opengl.open_for(name, scene), scene.camera
        self.title = self._drawer.title

    def draw(self) -> Picture:
        image = self._drawer.draw(self._camera)
        return Picture(image[..., :3], self._drawer.depth(), image[..., 3])


def open_for(name: str, scene: Scene, samples: int, threads: int) -> DepthToo:
    return DepthToo(name, scene)
