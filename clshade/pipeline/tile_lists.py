"""The lists of triangles per tile: counted, scanned and written on the device, nearest first."""

from __future__ import annotations

from typing import Any

import numpy as np

from .buffers import Buffer, TriangleBuffers
from .launches import Stages

_LEAST_CHUNK = 16  # triangles: few may cover many tiles
_MOST_CHUNKS = 16
_COUNTS_BUDGET = 1 << 22  # chunks * tiles of the counters: 16 MiB
_SCAN_RUN = 1 << 13  # fewest counters per work-item of the scan
_MOST_PARTS = 64


class TileLists:
    """The tile lists, whose memory is kept from frame to frame. A frame calls `count`, then `fill`; the pixel stage follows.

    starts: (tiles + 1,) where each tile's list begins. entries: the lists, concatenated.
    `fill` and the pixel stage do nothing if there is no room for all entries. Then, and only then, the counters show
    more entries than `room`, and the caller makes room and calls again.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._chunk = self._chunks = 0
        self._counts, self.starts = self._empty(0, np.uint32), self._empty(0, np.uint32)
        self._sums, self.entries = self._empty(0, np.uint64), self._empty(0, stages.structs.Entry)

    def _empty(self, count: int, dtype: Any) -> Buffer:
        return Buffer.empty(self._stages.device, count, dtype)

    @property
    def room(self) -> int:
        """Number of entries that fit."""
        return len(self.entries.array)

    def count(
        self, order: Buffer, made: TriangleBuffers, image: Buffer, visible: int, tiles: int, events: dict[str, Any]
    ) -> None:
        """Count the entries of each tile and find where its list begins."""
        if len(self.starts.array) != tiles + 1:
            self.starts = self._empty(tiles + 1, np.uint32)
        if not visible:
            with self.starts.writing() as rows:
                rows[:] = 0
            return
        chunks = max(1, min(visible // _LEAST_CHUNK, _MOST_CHUNKS, max(2, _COUNTS_BUDGET // tiles)))
        self._chunk = -(-visible // chunks)
        self._chunks = -(-visible // self._chunk)
        if len(self._counts.array) < self._chunks * tiles:
            self._counts = self._empty(self._chunks * tiles, np.uint32)
        parts = min(-(-self._chunks * tiles // _SCAN_RUN), _MOST_PARTS)
        if len(self._sums.array) != parts:
            self._sums = self._empty(parts, np.uint64)
        events["bin_count"] = self._stages.bin_count(order, made, image, self._counts, self._chunk, visible)
        if parts > 1:
            events["bin_sums"] = self._stages.bin_sums(image, self._counts, self._sums, self._chunks)
        events["bin_scan"] = self._stages.bin_scan(image, self._sums, self._counts, self.starts, made, self._chunks)

    def fill(self, order: Buffer, made: TriangleBuffers, image: Buffer, visible: int, events: dict[str, Any]) -> None:
        """Write the lists."""
        if visible:
            arguments = (order, made, image, self._counts, self.entries, self._chunk, visible)
            events["bin_fill"] = self._stages.bin_fill(*arguments)

    def make_room(self, entries: int) -> None:
        """Make room for so many entries, with a margin for the next camera if memory allows it."""
        kind = self._stages.structs.Entry
        most = self._stages.device.max_allocation // kind.itemsize
        self.entries = self._empty(max(entries, min(entries + entries // 2, most)), kind)
