"""The pixel stage of a frame, or of a single triangle."""

from __future__ import annotations

from .buffers import Buffer
from .features import needs
from .frame_state import FrameInFlight
from .launches import Stages
from .surface_inputs import SurfaceInputs
from .tile_lists import TileLists


class PixelPass:
    """Lights the pixels of tile lists, with Gouraud's shading after the corners of triangles, for which it keeps memory."""

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._corner_light: Buffer | None = None

    def draw(
        self,
        inputs: SurfaceInputs,
        lists: TileLists,
        frame: FrameInFlight,
        *,
        order: Buffer | None = None,
        visible: int = 0,
        shown: Buffer | None = None,
    ) -> None:
        """Enqueue the pixel stage. order: (T,) the triangles whose corners Gouraud's shading lights, of which there are
        `visible`. shown: the samples that show lines."""
        stages, features, events = self._stages, self._stages.pixel_features, frame.events
        tile = (lists.entries, lists.starts, frame.rgba, frame.owners, frame.counted, shown)
        name = "phong" if features["PHONG"] else "pbr" if features["PBR"] else "gouraud"
        if name == "gouraud" and order is not None and visible and needs(inputs.image.array[0]["needs"], "LIT"):
            corners, light = 3 * len(inputs.triangles.array), self._corner_light
            if light is None or len(light.array) < corners:
                light = self._corner_light = Buffer.empty(stages.device, (corners, 4), stages.structs.real)
            inputs = inputs._replace(corner_light=light)
            events["gouraud_corners"] = stages.gouraud_corners(inputs, order, light, visible)
        events[name] = stages.shade(name, inputs, tile, frame.tiles)
        frame.inputs = inputs
