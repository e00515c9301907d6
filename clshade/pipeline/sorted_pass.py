"""From triangles that are set up to pixels: order, bin, shade."""

from __future__ import annotations

from dataclasses import dataclass

from .buffers import Buffer
from .depth_order import DepthOrder
from .frame_state import FrameInFlight
from .pixel_pass import PixelPass
from .surface_inputs import SurfaceInputs
from .tile_lists import TileLists
from .triangle_source import Triangles


@dataclass(frozen=True)
class SortedPass:
    """Draws triangles in the order of their depths."""

    order: DepthOrder
    lists: TileLists
    pixels: PixelPass

    def draw(
        self, triangles: Triangles, inputs: SurfaceInputs, frame: FrameInFlight, shown: Buffer | None = None
    ) -> None:
        """Draw the visible triangles, and read the frame's counters. inputs: of the pixel stage. shown: the samples that
        show lines."""
        lists = self.lists
        order = self.order.sort(triangles, frame)
        inputs = inputs._replace(ranks=self.order.ranks)
        lists.count(order, triangles, frame)
        if not lists.room and triangles.visible:
            lists.make_room_for(int(frame.read_counters()["entries"]), frame)
        while True:
            lists.fill(order, triangles, frame)
            self.pixels.draw(inputs, lists, frame, order=order, visible=triangles.visible, shown=shown)
            frame.counters = frame.read_counters()
            entries = int(frame.counters["entries"])
            if entries <= lists.room:
                return
            lists.make_room_for(entries, frame)
