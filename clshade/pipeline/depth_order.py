"""The order in which a frame's triangles are listed: nearest first, transparent ones last."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..base.arrays import Array, Bools
from .buffers import Buffer
from .depth_sort import front_to_back
from .frame_state import FrameInFlight
from .opencl.device import Device
from .programs import running_time
from .triangle_source import Triangles, TriangleSource


class DepthOrder:
    """Sorts the triangles of a frame on the host, in memory that is kept from frame to frame.

    source: of the triangles; None for those of no scene, of which none are transparent. painter: whether painter's order
    decides, which takes exact depths. transparent: (F,) by face, None if none is.

    ranks: (T,) uint32, the place of each triangle in painter's order; None unless transparent ones need it.
    """

    def __init__(
        self,
        device: Device,
        source: TriangleSource | None = None,
        *,
        painter: bool = False,
        transparent: Bools | None = None,
    ) -> None:
        self._device, self._source, self._painter, self._transparent = device, source, painter, transparent
        self._order = Buffer.empty(device, 0, np.uint32)
        self.ranks: Buffer | None = None

    def sort(self, triangles: Triangles, frame: FrameInFlight) -> Buffer:
        """Return the visible triangles, nearest first; if some are transparent, these after the others."""
        start = running_time()
        visible, made, source = triangles.visible, triangles.made, self._source
        if len(self._order.array) < visible:
            self._order = Buffer.empty(self._device, visible + visible // 2, np.uint32)
        exact = partial(source.painter_depths, triangles) if source is not None and self._painter else None
        order = front_to_back(made.keys.to_host(visible), exact, made.index_bits)
        if source is not None and self._transparent is not None:
            if self._painter:
                self._write_ranks(order, len(made.triangles.array))
            late = self._transparent[source.faces_of(triangles, order)]
            order = np.concatenate([order[~late], order[late]])
        with self._order.writing(visible) as rows:
            rows[:] = order
        frame.is_sorted = visible > 0
        frame.host_ms["sort"] = (running_time() - start) * 1e3
        return self._order

    def _write_ranks(self, order: Array, room: int) -> None:
        if self.ranks is None or len(self.ranks.array) < room:
            self.ranks = Buffer.empty(self._device, room, np.uint32)
        with self.ranks.writing() as rows:
            rows[order] = np.arange(len(order), dtype=np.uint32)
