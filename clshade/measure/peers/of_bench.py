"""Renderers of `bench`, which are asked for their depth too: that of the depth buffer, or the reciprocal of what they
compare."""

from __future__ import annotations

from typing import Any

from ...scene.model import Scene
from ..bench.peers import open_peer
from .drawing import NO_DEPTH, Picture


class DepthToo:
    def __init__(self, name: str, scene: Scene, samples: int) -> None:
        self._drawer: Any = open_peer(name, scene)
        self._camera, self._deep = scene.camera, samples == 1
        self.title = self._drawer.title

    def draw(self) -> Picture:
        image = self._drawer.draw(self._camera)
        return Picture(image[..., :3], self._drawer.depth() if self._deep else NO_DEPTH, image[..., 3])


def open_for(name: str, scene: Scene, samples: int, threads: int) -> DepthToo:
    return DepthToo(name, scene, samples)
