"""The lists of triangles per tile: counted, scanned and written on the device."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import DeviceError
from .buffers import Buffer, TriangleBuffers
from .frame_state import FrameInFlight
from .launches import Chunks, Stages
from .triangle_source import SceneFaces, Triangles

_LEAST_CHUNK = 16  # triangles: few may cover many tiles
_LARGE_CHUNK = 1 << 14  # each chunk counts all tiles: more than two per compute unit are at least so large
_MOST_CHUNKS = 16  # or two per compute unit
_COUNTS_BUDGET = 1 << 22  # chunks * tiles of the counters: 16 MiB
_SCAN_RUN = 1 << 13  # fewest counters per work-item of the scan
_MOST_PARTS = 64
_MOST_ENTRIES = (1 << 31) - 1  # kernels count them in an int32; 32 GiB


class TileLists:
    """The tile lists, whose memory is kept from frame to frame.

    A frame calls `count` and `fill` for triangles in a given order, or `set_up` and `fill_unsorted` for faces in theirs;
    the pixel stage follows.

    starts: (tiles + 1,) where each tile's list begins. entries: the lists, concatenated.
    Filling does nothing, and the pixel stage gives no pixel an owner, if there is no room for all entries. Then, and only
    then, the counters show more entries than `room`, and the caller makes room and calls again.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._usual_chunks = 2 * stages.device.compute_units if stages.device.is_cpu else _MOST_CHUNKS
        self._most_chunks = max(self._usual_chunks, _MOST_CHUNKS)
        self.starts = self._empty(0, np.uint32)
        self._sums, self.entries = self._empty(0, np.uint64), self._empty(0, stages.structs.Entry)
        self._chunks = Chunks(0, 0, 0, self._empty(0, np.uint32), self._empty(self._most_chunks, np.uint32))

    def _empty(self, count: int, dtype: Any) -> Buffer:
        return Buffer.empty(self._stages.device, count, dtype)

    @property
    def room(self) -> int:
        """Number of entries that fit."""
        return len(self.entries.array)

    def _split(self, count: int, tiles: int, multiple: int = 1) -> Chunks:
        """Split so many triangles into chunks of a multiple of triangles, with memory for the counts of the tiles."""
        chunks = self._chunks
        most = min(max(self._usual_chunks, count // _LARGE_CHUNK), self._most_chunks, max(2, _COUNTS_BUDGET // tiles))
        number = max(1, min(count // _LEAST_CHUNK, most))
        chunks.count, chunks.size = count, -(-count // (number * multiple)) * multiple
        chunks.number = -(-count // chunks.size)
        if len(chunks.counts.array) < chunks.number * (tiles + 1):
            chunks.counts = self._empty(chunks.number * (tiles + 1), np.uint32)
        parts = min(-(-chunks.number * tiles // _SCAN_RUN), _MOST_PARTS)
        if len(self._sums.array) != parts:
            self._sums = self._empty(parts, np.uint64)
        return chunks

    def _make_starts(self, tiles: int) -> None:
        if len(self.starts.array) != tiles + 1:
            self.starts = self._empty(tiles + 1, np.uint32)

    def _scan(self, frame: FrameInFlight, *, stops_to_clip: bool) -> None:
        """Find where each tile's list begins, and each chunk's part of it."""
        chunks, events = self._chunks, frame.events
        if len(self._sums.array) > 1:
            events["bin_sums"] = self._stages.bin_sums(frame.image, chunks, self._sums)
        arguments = (frame.image, self._sums, chunks, self.starts, frame.counted, stops_to_clip)
        events["bin_scan"] = self._stages.bin_scan(*arguments)

    def count(self, order: Buffer, triangles: Triangles, frame: FrameInFlight) -> None:
        """Count the entries of each tile, of the triangles in an order, and find where its list begins."""
        self._make_starts(frame.tiles)
        if not triangles.visible:
            with self.starts.writing() as rows:
                rows[:] = 0
            return
        chunks = self._split(triangles.visible, frame.tiles)
        frame.events["bin_count"] = self._stages.bin_count(order, triangles.made, frame.image, chunks)
        self._scan(frame, stops_to_clip=False)

    def fill(self, order: Buffer, triangles: Triangles, frame: FrameInFlight) -> None:
        """Write the lists."""
        if triangles.visible:
            arguments = (order, triangles.made, frame.image, self._chunks, self.entries, frame.counted)
            frame.events["bin_fill"] = self._stages.bin_fill(*arguments)

    def set_up(self, source: SceneFaces, frame: FrameInFlight) -> None:
        """Set up the triangles of faces, count the entries of each tile, and find where its list begins. If there are
        faces to clip, the counters show more entries than any list has room for."""
        self._make_starts(frame.tiles)
        chunks = self._split(source.room, frame.tiles, multiple=self._stages.lanes)
        arguments = (source.faces, source.vertices, frame.image, source.made, frame.counted, chunks, source.sides)
        frame.events["setup"] = self._stages.setup_count(*arguments)
        self._scan(frame, stops_to_clip=True)

    def fill_unsorted(self, made: TriangleBuffers, frame: FrameInFlight) -> None:
        """Write the lists after `set_up`."""
        arguments = (made, frame.image, self._chunks, self.entries, frame.counted)
        frame.events["bin_fill"] = self._stages.fill_lists(*arguments)

    def make_room_for(self, entries: int, frame: FrameInFlight) -> None:
        """Make room for the entries of a frame, whose lists are to be filled again. Raises DeviceError."""
        self.make_room(entries)
        with frame.image.writing() as table:
            table["list_capacity"] = self.room
        with frame.counted.writing() as table:
            table["next_tile"] = table["saturated"] = 0

    def make_room(self, entries: int) -> None:
        """Make room for so many entries, with a margin for the next camera if memory allows it. Raises DeviceError."""
        kind, device = self._stages.structs.Entry, self._stages.device
        if entries > _MOST_ENTRIES:
            limit = f"the lists of all tiles need {entries} entries, {_MOST_ENTRIES} are allowed"
            raise DeviceError(f"{device.name}: {limit}: draw fewer triangles, or a smaller image")
        most = min(device.max_allocation // kind.itemsize, _MOST_ENTRIES)
        self.entries = self._empty(max(entries, min(entries + entries // 2, most)), kind)
