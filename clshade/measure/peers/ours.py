"""clshade itself, drawn as its peers are."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from ...pipeline.renderer import Renderer
from ...scene.model import Scene
from .drawing import NO_DEPTH, Picture

# As `render` draws it: a pixel's samples of one triangle share their light, unless each is lit.
OPTIONS: dict[str, dict[str, Any]] = {
    "clshade": {},
    "clshade-float64": {"precision": "float64"},
    "clshade-shaded": {"sample_shading": True},
}


class Ours:
    """A scene that stays on the device."""

    def __init__(self, name: str, scene: Scene, samples: int) -> None:
        self._deep = samples == 1
        self._renderer = Renderer(scene, samples=samples, layers=("Z",) if self._deep else (), **OPTIONS[name])
        precision, device = self._renderer.settings.precision, self._renderer.device.title
        self.title = f"clshade {metadata.version('clshade')}, {precision}, {device}"

    def draw(self) -> Picture:
        frame = self._renderer.render()
        return Picture(frame.rgb, frame["Z"] if self._deep else NO_DEPTH, frame.alpha)


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Ours:
    return Ours(name, scene, samples)
