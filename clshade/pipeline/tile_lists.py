"""From triangles that are set up to pixels: the order of their depths, the lists of triangles per tile, the pixel stage."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..base.arrays import Array, Bools, UInt32s
from ..errors import DeviceError
from .buffers import LEAST_INDEX_BITS, Buffer, TriangleBuffers
from .features import needs
from .frame_state import FrameInFlight
from .launches import Stages
from .opencl.device import Device
from .programs import running_time
from .triangle_source import SceneFaces, Triangles, TriangleSource


def front_to_back(
    keys: Array, exact: Callable[[Array], tuple[Array, Array]] | None = None, bits: int = LEAST_INDEX_BITS
) -> UInt32s:
    """Return the indices of triangles, nearest first; of equal depths the later face first.

    keys: (T,) uint64 of setup.cl, sorted in place: the depth's top bits over the complement of the index.
    exact: returns the float64 depths and the faces of the triangles given by index; used where the top bits are equal.
        None: triangles with equal top bits may come in any order.
    bits: of the index, at most 32.
    Returns (T,) uint32.
    """
    keys.sort()
    low_words = keys.view(np.uint32)[0 if sys.byteorder == "little" else 1 :: 2]
    order: UInt32s = ~low_words & np.uint32((1 << bits) - 1)
    if exact is None or len(keys) < 2:
        return order
    depth_bits = keys >> np.uint64(bits)
    same = depth_bits[1:] == depth_bits[:-1]
    if same.any():
        tied = np.zeros(len(keys), bool)
        tied[1:] |= same
        tied[:-1] |= same
        rows = np.flatnonzero(tied)
        depth, face = exact(order[rows])
        order[rows] = order[rows][np.lexsort((-face, depth, depth_bits[rows]))]
    return order


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


_LEAST_CHUNK = 16  # triangles: few may cover many tiles
_LARGE_CHUNK = 1 << 14  # each chunk counts all tiles: more than two per compute unit are at least so large
_MOST_CHUNKS = 16  # or two per compute unit
_COUNTS_BUDGET = 1 << 22  # chunks * tiles of the counters: 16 MiB
_SCAN_RUN = 1 << 13  # fewest counters per work-item of the scan
_MOST_PARTS = 64
_MOST_ENTRIES = (1 << 31) - 1  # kernels count them in an int32; 32 GiB


class TileLists:
    """The tile lists and the pixels lit from them, in memory that is kept from frame to frame.

    A frame calls `count` and `fill` for triangles in a given order, or `set_up` and `fill_unsorted` for faces in theirs;
    `shade` follows.

    starts: (tiles + 1,) where each tile's list begins. entries: the lists, concatenated.
    Filling does nothing, and the pixel stage gives no pixel an owner, if there is no room for all entries. Then, and only
    then, the counters show more entries than `room`, and the caller makes room and calls again.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._corner_light: Buffer | None = None  # of Gouraud's shading
        self._usual_chunks = 2 * stages.device.compute_units if stages.device.is_cpu else _MOST_CHUNKS
        self._most_chunks = max(self._usual_chunks, _MOST_CHUNKS)
        self.starts = self._empty(0, np.uint32)
        self._sums, self.entries = self._empty(0, np.uint64), self._empty(0, stages.structs.Entry)
        self._counts, self._made = self._empty(0, np.uint32), self._empty(self._most_chunks, np.uint32)
        self._values: dict[str, Any] = {}  # arguments of kernels: chunks, each of which a work-item counts and writes

    def _empty(self, count: int, dtype: Any) -> Buffer:
        return Buffer.empty(self._stages.device, count, dtype)

    @property
    def room(self) -> int:
        """Number of entries that fit."""
        return len(self.entries.array)

    def _split(self, count: int, tiles: int, multiple: int = 1) -> None:
        """Split so many triangles into chunks of a multiple of triangles, with memory for the counts of the tiles."""
        most = min(max(self._usual_chunks, count // _LARGE_CHUNK), self._most_chunks, max(2, _COUNTS_BUDGET // tiles))
        number = max(1, min(count // _LEAST_CHUNK, most))
        size = -(-count // (number * multiple)) * multiple
        number = -(-count // size)
        if len(self._counts.array) < number * (tiles + 1):
            self._counts = self._empty(number * (tiles + 1), np.uint32)
        parts = min(-(-number * tiles // _SCAN_RUN), _MOST_PARTS)
        if len(self._sums.array) != parts:
            self._sums = self._empty(parts, np.uint64)
        self._values = {"count": count, "chunk_size": size, "chunks": number, "made": self._made, "sums": self._sums}
        self._values |= {"counts": self._counts, "cursors": self._counts, "starts": self.starts}

    def _make_starts(self, tiles: int) -> None:
        if len(self.starts.array) != tiles + 1:
            self.starts = self._empty(tiles + 1, np.uint32)

    def _scan(self, frame: FrameInFlight, *, stops_to_clip: bool) -> None:
        """Find where each tile's list begins, and each chunk's part of it."""
        parts, values = len(self._sums.array), {"stops_to_clip": stops_to_clip}
        for kernel in ("bin_sums", "bin_scan") if parts > 1 else ("bin_scan",):
            frame.events[kernel] = self._run(kernel, frame, values, parts)

    def count(self, order: Buffer, triangles: Triangles, frame: FrameInFlight) -> None:
        """Count the entries of each tile, of the triangles in an order, and find where its list begins."""
        self._make_starts(frame.tiles)
        if not triangles.visible:
            with self.starts.writing() as rows:
                rows[:] = 0
            return
        self._split(triangles.visible, frame.tiles)
        values = {**triangles.made.values, "order": order, "sorted": triangles.made.sorted_bounds}
        frame.events["bin_count"] = self._run("bin_count", frame, values)
        self._scan(frame, stops_to_clip=False)

    def fill(self, order: Buffer, triangles: Triangles, frame: FrameInFlight) -> None:
        """Write the lists."""
        if triangles.visible:
            made = triangles.made
            values = {**made.values, "order": order, "sorted": made.sorted_bounds, "lists": self.entries}
            frame.events["bin_fill"] = self._run("bin_fill", frame, values)

    def set_up(self, source: SceneFaces, frame: FrameInFlight) -> None:
        """Set up the triangles of faces, count the entries of each tile, and find where its list begins. If there are
        faces to clip, the counters show more entries than any list has room for."""
        self._make_starts(frame.tiles)
        self._split(source.room, frame.tiles, multiple=self._stages.lanes)
        values = {**source.made.values, **source.sides, "faces": source.faces, "vertices": source.vertices.projected}
        frame.events["setup"] = self._run("setup_count", frame, values)
        self._scan(frame, stops_to_clip=True)

    def fill_unsorted(self, made: TriangleBuffers, frame: FrameInFlight) -> None:
        """Write the lists after `set_up`."""
        values = {**made.values, "sorted": made.bounds, "order": None, "count": 0, "lists": self.entries}
        frame.events["bin_fill"] = self._run("bin_fill", frame, values)

    def _run(self, kernel: str, frame: FrameInFlight, values: Mapping[str, Any], items: int | None = None) -> Any:
        """Enqueue a kernel, each work-item in a work-group of its own; by default there is one for each chunk."""
        size = items or self._values["chunks"], 1
        return self._stages.run(kernel, size, {**frame.values, **self._values, **values})

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

    def shade(
        self,
        inputs: dict[str, Any],
        frame: FrameInFlight,
        *,
        order: Buffer | None = None,
        visible: int = 0,
        shown: Buffer | None = None,
    ) -> None:
        """Enqueue the pixel stage. order: (T,) the triangles whose corners Gouraud's shading lights first, of which there
        are `visible`. shown: the samples that show lines."""
        stages, features, events = self._stages, self._stages.pixel_features, frame.events
        name = "phong" if features["PHONG"] else "pbr" if features["PBR"] else "gouraud"
        if name == "gouraud" and order is not None and visible and needs(frame.image.array[0]["needs"], "LIT"):
            corners, light = 3 * len(inputs["triangles"].array), self._corner_light
            if light is None or len(light.array) < corners:
                light = self._corner_light = Buffer.empty(stages.device, (corners, 4), stages.structs.real)
            inputs = {**inputs, "corner_light": light}
            corner = {"order": order, "to_light": light, "count": visible}
            size = stages.vectors(visible)
            events["gouraud_corners"] = stages.run("gouraud_corners", size, inputs, **corner)
        values = {**inputs, **frame.values, "lists": self.entries, "starts": self.starts, "shown": shown}
        values |= {"rgba": frame.rgba, "owners": frame.owners}
        events[name] = stages.run(name, stages.pixels(name, frame.tiles), values)
        frame.inputs = inputs


def draw_sorted(
    depths: DepthOrder,
    lists: TileLists,
    triangles: Triangles,
    inputs: dict[str, Any],
    frame: FrameInFlight,
    shown: Buffer | None = None,
) -> None:
    """Draw the visible triangles in the order of their depths, and read the frame's counters. inputs: of the pixel stage.
    shown: the samples that show lines."""
    order = depths.sort(triangles, frame)
    inputs = {**inputs, "ranks": depths.ranks}
    lists.count(order, triangles, frame)
    if not lists.room and triangles.visible:
        lists.make_room_for(int(frame.read_counters()["entries"]), frame)
    while True:
        lists.fill(order, triangles, frame)
        lists.shade(inputs, frame, order=order, visible=triangles.visible, shown=shown)
        frame.counters = frame.read_counters()
        entries = int(frame.counters["entries"])
        if entries <= lists.room:
            return
        lists.make_room_for(entries, frame)
