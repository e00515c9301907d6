"""How many rays of shadows and ambient occlusion a frame needs, and what they meet: counted by kernels that draw it once
more."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .buffers import Buffer
from .features import Features
from .frame import Frame
from .launches import Stages, scene_stages
from .pixel_pass import PixelPass
from .renderer import Renderer
from .scene_drawing import SceneDrawing
from .struct_layout import SHADOW_COUNTS
from .surface_inputs import SurfaceInputs

# Why a ray is not traced; a ray with several reasons counts for the first.
SKIPPED = {
    "dark_light": "lights of intensity 0",
    "facing_away": "surfaces that face away, N.L <= 0",
    "out_of_reach": "beyond a light's range or cone",
    "no_casters": "nothing casts shadows",
    "reflects_nothing": "surfaces that reflect nothing",
    "behind_face": "lights behind the face",
    "terminator": "shadow terminator of share 0",
}
TRACED = ("traced", "hidden", "occlusion", "occluded", "packets", "lit_packets", "dark_packets", "filtered", "decided")


@dataclass(frozen=True)
class ShadowCounts:
    """The rays of a frame.

    places: how often a surface is lit, 0 without shadows: in pixels or samples, transparent ones by themselves; with
    Gouraud's shading at corners of triangles. lights: of the scene. points: of all these together, one each but for
    those of finite size. skipped: rays not traced, by the names in `SKIPPED`. traced: the others. hidden: those of them
    that an opaque triangle stops. occlusion: rays of ambient occlusion. occluded: those of them that an opaque triangle
    stops. packets: groups of rays of either kind that go through a hierarchy together, and rays of one point in
    directions too different for that, each a packet by itself. lit_packets, dark_packets: those in which no ray is
    hidden, and each is. filtered: triangles that the filter tested, once for each packet; of rays by themselves all 16 of
    a leaf. decided: how often the exact predicate tested a triangle for a packet's rays, because the filter left some
    undecided or the light is too near.
    """

    places: int
    lights: int
    points: int
    skipped: dict[str, int]
    traced: int
    hidden: int
    occlusion: int
    occluded: int
    packets: int
    lit_packets: int
    dark_packets: int
    filtered: int
    decided: int

    @property
    def possible(self) -> int:
        """Number of shadow rays from each place to each point of a light."""
        return self.places * self.points

    def stats(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {"possible": self.possible, **asdict(self)}


class _CountingPass(PixelPass):
    """A pixel stage that counts rays."""

    def __init__(self, stages: Stages) -> None:
        super().__init__(stages)
        self.counts = Buffer(stages.device, np.zeros(2 * len(SHADOW_COUNTS), np.uint32))

    def draw(self, inputs: SurfaceInputs, *arguments: Any, **more: Any) -> None:
        with self.counts.writing() as counts:  # tiles are drawn again if their lists lacked room
            counts[:] = 0
        super().draw(inputs._replace(shadow_counts=self.counts), *arguments, **more)


class _CountingDrawing(SceneDrawing):
    """A drawing whose kernels count rays."""

    def _build(self, lanes: int | None, layers: Features | None) -> Stages:
        return scene_stages(self.device, self.features, lanes, layers, counting=True)

    def _pixel_pass(self) -> PixelPass:
        self.counting = _CountingPass(self.stages)
        return self.counting


class CountingRenderer(Renderer):
    """A renderer of a scene with shadows or ambient occlusion whose kernels count the rays, which takes them longer. Its
    images have the same bits."""

    _drawing_type = _CountingDrawing
    _drawing: _CountingDrawing

    def count(self) -> tuple[Frame, ShadowCounts]:
        """Draw a frame with the scene's camera, and return it with its counts."""
        frame = self.render()
        halves = self._drawing.counting.counts.to_host().astype(np.uint64).reshape(-1, 2)
        found = {
            name.lower(): int(low + (high << np.uint64(32)))
            for name, (low, high) in zip(SHADOW_COUNTS, halves, strict=True)
        }
        lights = self.scene.lights if self.settings.shadows else ()
        points = [self.settings.light_samples if light.has_size else 1 for light in lights]
        dark = [count for count, light in zip(points, lights, strict=True) if not light.intensity.any()]
        found["dark_light"] = found["places"] * sum(dark)
        return frame, ShadowCounts(
            places=found["places"],
            lights=len(lights),
            points=sum(points),
            skipped={name: found[name] for name in SKIPPED},
            **{name: found[name] for name in TRACED},
        )
