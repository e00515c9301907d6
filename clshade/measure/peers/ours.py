"""clshade itself, drawn as its peers are: `clshade` in float32, `clshade-float64`."""

from __future__ import annotations

from importlib import metadata

from ...pipeline.renderer import Renderer
from ...scene.model import Scene
from .drawing import Picture


class Ours:
    """A resident scene; `samples` of each pixel, of which a triangle's share one light, as `render` does."""

    def __init__(self, name: str, scene: Scene, samples: int) -> None:
        precision = "float64" if name.endswith("float64") else "float32"
        self._renderer = Renderer(scene, samples=samples, precision=precision, layers=("Z",))  # type: ignore[arg-type]
        self.title = f"clshade {metadata.version('clshade')}, {precision}, {self._renderer.device.title}"

    def draw(self) -> Picture:
        frame = self._renderer.render()
        return Picture(frame.rgb, frame["Z"], frame.alpha)


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Ours:
    return Ours(name, scene, samples)
