"""Frames of a scene: the stages from its triangles to pixels and layers, one after the other."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..base.arrays import Array, Bools, UInt32s
from ..errors import DeviceError, InputError
from ..scene.model import MAX_FACES, Scene, Settings
from .buffers import LEAST_INDEX_BITS, Buffer, Pool, Scratch, finish
from .camera_space import CameraSpace, clip, image_positions, scaled_w, snap
from .features import Features, ignored, needs
from .launches import FrameInFlight, Stages, scene_stages
from .layers import Layers, layer_features
from .lines import Lines
from .opencl.device import Device
from .programs import running_time, this_thread
from .scene_tables import Packed, ResidentScene
from .triangle_source import Faces, TriangleSource, set_up_pieces

_LEAST_CHUNK = 16  # triangles: few may cover many tiles
_LARGE_CHUNK = 1 << 14  # each chunk counts all tiles: more than two per compute unit are at least so large
_MOST_CHUNKS = 16  # or two per compute unit
_COUNTS_BUDGET = 1 << 22  # chunks * tiles of the counters: 16 MiB
_SCAN_RUN = 1 << 13  # fewest counters per work-item of the scan
_MOST_PARTS = 64
_MOST_ENTRIES = (1 << 31) - 1  # kernels count them in an int32; 24 GiB
_COUNTS = ("visible", "behind", "off_screen", "between_samples", "zero_area", "back_facing", "saturated")
# Samples times lights, and faces, that unoptimized programs draw in less time than optimizing takes.
_MOST_LIT, _MOST_FACES = 1 << 23, 1 << 18


def compiles_longer(scene: Scene, settings: Settings) -> bool:
    """Return whether optimizing the kernels takes longer than a frame does without, as far as its size tells."""
    lit = math.prod(scene.camera.resolution) * settings.samples * (1 + len(scene.lights))
    return lit <= _MOST_LIT and scene.face_count <= _MOST_FACES


def front_to_back(
    keys: Array, exact: Callable[[Array], tuple[Array, Array]] | None = None, bits: int = LEAST_INDEX_BITS
) -> UInt32s:
    """Return the indices of triangles, (T,) uint32, nearest first; of equal depths the later face first.

    keys: (T,) uint64 of setup.cl, sorted in place: the depth's top bits over the complement of the index, of `bits`, at most
    32. exact: returns the float64 depths and the faces of triangles by index, for those whose top bits are equal; None: they
    may come in any order.
    """
    keys.sort()
    low_words = keys.view(np.uint32)[0 if sys.byteorder == "little" else 1 :: 2]
    order: UInt32s = ~low_words & np.uint32((1 << bits) - 1)
    if exact is None or len(keys) < 2:
        return order
    depth_bits = keys >> np.uint64(bits)
    same = depth_bits[1:] == depth_bits[:-1]
    if same.any():
        rows = np.flatnonzero(np.append(same, False) | np.insert(same, 0, False))
        depth, face = exact(order[rows])
        order[rows] = order[rows][np.lexsort((-face, depth, depth_bits[rows]))]
    return order


class TileLists:
    """The order of a frame's triangles, the lists of each tile, and the pixels lit from them; memory is kept between frames.

    A frame calls `draw_sorted`, or for faces in their order `set_up`, `fill` and `shade`. Without room for all entries these
    two do nothing but leave pixels without owners. Then, and only then, the counters show more entries than `room`, and the
    caller makes room and calls again.

    source: of the triangles; None for those of no scene. transparent: (F,) by face, None if none is.
    """

    def __init__(self, stages: Stages, source: TriangleSource | None = None, transparent: Bools | None = None) -> None:
        self._stages, self._source, self._transparent = stages, source, transparent
        self._usual_chunks = 2 * stages.device.compute_units if stages.device.is_cpu else _MOST_CHUNKS
        self._most_chunks = max(self._usual_chunks, _MOST_CHUNKS)
        self._memory, self._entries = Scratch(stages.device), Buffer.empty(stages.device, 0, stages.structs.Entry)

    @property
    def room(self) -> int:
        """Number of entries that fit."""
        return len(self._entries.array)

    def sort(self, frame: FrameInFlight) -> None:
        """List the visible triangles, nearest first; if some are transparent, these after the others."""
        start = running_time()
        visible, values, source = frame.visible, frame.values, self._source
        painter = not self._stages.features["DEPTH_TEST"]  # whose order takes exact depths
        exact = partial(source.painter_depths, frame) if source is not None and painter else None
        order = front_to_back(values["keys"].to_host(visible), exact, values["index_bits"])
        if source is not None and self._transparent is not None:
            if painter:  # in which transparent triangles have places
                values["ranks"] = self._memory("ranks", len(values["triangles"].array), np.uint32, exact=True)
                with values["ranks"].writing() as rows:
                    rows[order] = np.arange(len(order), dtype=np.uint32)
            late = self._transparent[source.faces_of(frame, order)]
            order = np.concatenate([order[~late], order[late]])
        values["order"] = self._memory("order", visible, np.uint32)
        with values["order"].writing(visible) as rows:
            rows[:] = order
        frame.is_sorted = visible > 0
        frame.host_ms["sort"] = (running_time() - start) * 1e3

    def _split(self, count: int, frame: FrameInFlight, multiple: int = 1) -> None:
        """Split so many triangles into chunks of a multiple of triangles, with memory for the counts of the tiles."""
        tiles, memory = frame.tiles, self._memory
        limit = min(max(self._usual_chunks, count // _LARGE_CHUNK), self._most_chunks, max(2, _COUNTS_BUDGET // tiles))
        number = max(1, min(count // _LEAST_CHUNK, limit))
        size = max(-(-count // (number * multiple)), 1) * multiple
        number = -(-count // size)
        counts, parts = memory("counts", number * tiles, np.uint32), min(-(-number * tiles // _SCAN_RUN), _MOST_PARTS)
        frame.values |= {"count": count, "chunk_size": size, "chunks": number, "counts": counts, "cursors": counts}
        frame.values["made"] = memory("made", self._most_chunks, np.uint32)
        frame.values["starts"] = memory("starts", tiles + 1, np.uint32, exact=True)
        frame.values["sums"] = memory("sums", parts, np.uint64, exact=True)

    def _scan(self, frame: FrameInFlight, *, stops_to_clip: bool) -> None:
        """Enqueue the search for where each tile's list begins, and each chunk's part of it."""
        frame.values["stops_to_clip"], parts = stops_to_clip, len(frame.values["sums"].array)
        for kernel in ("bin_sums", "bin_scan") if parts > 1 else ("bin_scan",):
            frame.events[kernel] = self._stages.run(kernel, (parts, 1), frame.values)

    def count(self, frame: FrameInFlight) -> None:
        """Count the entries of each tile, of the triangles in their order, and find where its list begins."""
        self._split(frame.visible, frame)
        if frame.visible:
            frame.events["bin_count"] = self._stages.run("bin_count", (frame.values["chunks"], 1), frame.values)
            self._scan(frame, stops_to_clip=False)
        else:
            with frame.values["starts"].writing() as rows:
                rows[:] = 0

    def set_up(self, source: TriangleSource, frame: FrameInFlight) -> None:
        """Set up the triangles of faces, count the entries of each tile, and find where its list begins. If there are
        faces to clip, the counters show more entries than any list has room for."""
        frame.visible = source.room
        self._split(source.room, frame, multiple=self._stages.lanes)
        frame.values |= {**source.made.values, "sorted": source.made.bounds, "order": None}
        frame.events["setup"] = self._stages.run("setup_count", (frame.values["chunks"], 1), frame.values)
        self._scan(frame, stops_to_clip=True)
        frame.values["count"] = 0  # see bin_fill

    def fill(self, frame: FrameInFlight) -> None:
        """Write the lists."""
        frame.values["lists"] = self._entries
        if frame.visible:
            frame.events["bin_fill"] = self._stages.run("bin_fill", (frame.values["chunks"], 1), frame.values)

    def make_room(self, entries: int, frame: FrameInFlight) -> None:
        """Make room for the entries of a frame, whose lists are to be filled again, and if memory allows it for more, which
        the next camera may need. Raises DeviceError."""
        kind, device = self._stages.structs.Entry, self._stages.device
        if entries > _MOST_ENTRIES:
            limit = f"the lists of all tiles need {entries} entries, {_MOST_ENTRIES} are allowed"
            raise DeviceError(f"{device.name}: {limit}: draw fewer triangles, or a smaller image")
        most = min(device.max_allocation // kind.itemsize, _MOST_ENTRIES)
        self._entries = Buffer.empty(device, max(entries, min(entries + entries // 2, most)), kind)
        with frame.values["image"].writing() as table:
            table["list_capacity"] = self.room
        with frame.values["counters"].writing() as table:
            table["next_tile"] = table["saturated"] = 0

    def shade(self, frame: FrameInFlight) -> None:
        """Enqueue the pixel stage, for Gouraud's shading after lighting the corners of the visible triangles."""
        stages, features, values = self._stages, self._stages.pixel_features, frame.values
        name = "phong" if features["PHONG"] else "pbr" if features["PBR"] else "gouraud"
        if name == "gouraud" and frame.is_sorted and needs(values["image"].array[0]["needs"], "LIT"):
            light = self._memory("light", 12 * len(values["triangles"].array), stages.structs.real, exact=True)
            values |= {"corner_light": light, "to_light": light}
            size = stages.vectors(frame.visible)
            frame.events["gouraud_corners"] = stages.run("gouraud_corners", size, values, count=frame.visible)
        frame.events[name] = stages.run(name, stages.pixels(name, frame.tiles), values)

    def draw_sorted(self, frame: FrameInFlight) -> None:
        """Draw the visible triangles in the order of their depths, and read the frame's counters."""
        self.sort(frame)
        self.count(frame)
        if not self.room and frame.visible:
            self.make_room(int(frame.read_counters()["entries"]), frame)
        while True:
            self.fill(frame)
            self.shade(frame)
            frame.counters = frame.read_counters()
            entries = int(frame.counters["entries"])
            if entries <= self.room:
                return
            self.make_room(entries, frame)


class SceneDrawing:
    """A scene on a device, which draws frames of it into buffers, one after the other.

    features: of the kernels. lanes: None for what suits the device. Raises DeviceError if the scene does not fit into the
    device's memory. pool: of images. layers: of the settings. extent: of the scene, None without faces. scene_bytes: of
    device memory that does not depend on the frame. tables: of a frame drawn by itself.
    """

    def __init__(self, device: Device, packed: Packed, features: Features, lanes: int | None) -> None:
        self.device, self.features = device, features
        self.scene, self.settings = scene, settings = packed.scene, packed.settings
        of_layers = layer_features(features, packed.layers.requested)
        slow = any(features[name] for name in ("CASTERS", "BLEND", "DOUBLE", "LINES"))
        first = this_thread.is_first and device.keeps_programs and not slow and compiles_longer(scene, settings)
        self.stages = stages = scene_stages(device, features, lanes, of_layers, first=first)
        self.pool = Pool(device)
        self.resident = resident = ResidentScene(stages, packed, features, of_layers)
        self.source, self.extent = resident.source, resident.extent
        # The layers' texture coordinates include these, and also those of meshes without a texture.
        tables = packed.layers.arrays if "uvs" in packed.layers.arrays else packed.arrays
        self._uvs, self._uv_faces = tables.get("uvs"), tables.get("uv_faces", packed.arrays["faces"])
        transparent = packed.faces_with("blends") if features["BLEND"] else None
        self._lists = TileLists(stages, self.source, transparent)
        self._lines: Lines | None = None
        if settings.edges is not None:
            front_only = packed.faces_with("front_only") | bool(features["CULL"])
            self._lines = Lines(self.source, settings.edges, front_only)
        self.layers = Layers(stages, self.pool, settings.layers, packed.layers)
        self.scene_bytes = resident.nbytes + self.layers.nbytes
        self.tables = resident.new_tables()
        self._values = {**resident.inputs, "pieces": Buffer.empty(device, 0, stages.structs.Piece), "shown": None}
        self._clips = False  # whether the last frame had faces to clip

    def frame(
        self, space: CameraSpace, tables: Mapping[str, Buffer], rgba: Buffer, owners: Buffer | None, *, streams: bool
    ) -> FrameInFlight:
        """Return a frame of which nothing is drawn yet."""
        values = {**self._values, **tables, "rgba": rgba, "owners": owners}
        return FrameInFlight(values, space=space, streams=streams)

    def draw(self, frame: FrameInFlight) -> dict[str, Array]:
        """Draw a frame completely, and return its layers by name."""
        self._begin(frame)
        self._complete(frame)
        return self.layers.draw(frame)

    def enqueue(self, frame: FrameInFlight) -> None:
        """Enqueue the drawing of a frame, and of its layers. If `frame.counters` is None, the host has not waited: nothing
        is drawn if there are faces to clip, or more entries than `frame.room`."""
        self._begin(frame)
        frame.room = self._lists.room
        self.layers.enqueue(frame)

    def draw_again(self, frame: FrameInFlight) -> None:
        """Redraw a frame that the device skipped, and enqueue its layers."""
        assert frame.counters is not None
        finish(self.device)  # kernels of the next frame use what is replaced
        self._clips, frame.counters = bool(frame.counters["to_clip"]), None
        self._begin(frame)
        self._complete(frame)
        self.layers.enqueue(frame)

    # The stages

    def _begin(self, frame: FrameInFlight) -> None:
        """Enqueue the drawing of a frame without layers. Where no sort is needed the host does not wait, and has no counters
        yet: `_complete` goes on."""
        source, resident, lists = self.source, self.resident, self._lists
        frame.events.clear()  # those of a frame that was given up
        resident.write_view(frame)
        source.project(frame)
        resident.write_image(frame, lists.room)
        if self.features["SORTED"] or self._clips or not source.room:
            source.set_up(frame)
            resident.write_lights(frame)
            self._clip(frame)
            if self._lines is not None:
                self._lines.draw(frame)
            lists.draw_sorted(frame)
            assert frame.counters is not None
            self._clips = bool(frame.counters["to_clip"])
            for name, count in source.culled.items():
                frame.counters[name] += count
        else:
            lists.set_up(source, frame)
            resident.write_lights(frame)
            lists.fill(frame)
            lists.shade(frame)

    def _complete(self, frame: FrameInFlight) -> None:
        """Wait for the frame that `_begin` has begun, the last one enqueued, and draw it again if lists lack room, or sorted
        if there are faces to clip: nothing of it is drawn then."""
        while frame.counters is None:
            counters = frame.read_counters()
            if counters["to_clip"]:
                self._clips = True
                self._begin(frame)
            elif counters["entries"] <= self._lists.room:
                frame.counters, frame.host_ms["sort"] = counters, 0.0
            else:
                self._lists.make_room(int(counters["entries"]), frame)
                self._lists.fill(frame)
                self._lists.shade(frame)

    def _clip(self, frame: FrameInFlight) -> None:
        """Clip what the frame's setup listed, and set up the pieces. Raises InputError for more triangles than MAX_FACES."""
        source, counters = self.source, frame.read_counters()
        if counters["to_clip"]:
            start = running_time()
            faces = source.to_clip(int(counters["to_clip"]))
            table, sources = self._pieces(faces, frame.space)
            count = len(table)
            if source.room + count > MAX_FACES:
                limit = f"at most {MAX_FACES} triangles, pieces of clipped ones included"
                raise InputError(f"render: scene: expected {limit}, found {source.room} and {count} pieces")
            if count > source.made.piece_capacity:  # with a margin for the next camera
                source.make_memory(source.room, count + count // 2)
                frame.clear_counters()
                source.set_up(frame)
            if count:
                source.add_pieces(faces, sources)
                set_up_pieces(self.stages, Buffer(self.device, table), frame, source.room)
                counters = frame.read_counters()
            frame.host_ms["clip"] = (running_time() - start) * 1e3
        frame.visible = int(counters["visible"])

    def _pieces(self, faces: Faces, space: CameraSpace) -> tuple[Array, Array]:
        """Clip faces to the near plane and the guard band: the table of pieces, (C,) of `structs.Piece`, and which of the
        faces each comes from."""
        structs, points = self.stages.structs, space.points(faces.corners)
        cut = clip(points, space.camera, space.near)
        table = np.zeros(len(cut.source), structs.Piece)
        if self.features["DEPTH_TEST"]:
            table["key_depth"] = cut.points[..., 2].min(axis=1)
        else:
            z = points[..., 2]
            table["key_depth"] = (((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)[cut.source]
        pairs = {"w": scaled_w(cut.points[..., 2], space), "weights": cut.weights.reshape(-1, 9)}
        if self._uvs is not None:  # double-singles u, v, then what rounding left of them
            parts = self._uvs[self._uv_faces[faces.numbers]].astype(np.float64)
            uvs = (parts[..., :2] + parts[..., 2:])[cut.source]
            pairs["uv"] = np.einsum("cjk,ckd->cjd", cut.weights, uvs).reshape(-1, 6)
        for name, value in pairs.items():
            table[name], table[f"{name}_low"] = value, value - value.astype(structs.real)
        snapped = snap(image_positions(cut.points, space.camera), space.raster)
        table["x"], table["y"] = snapped[..., 0], snapped[..., 1]
        table["face"] = faces.numbers[cut.source]
        return table, cut.source

    def facts_of(self, frame: FrameInFlight) -> Callable[[], dict[str, Any]]:
        """Return a function that returns the entries of `Frame.stats` other than times; it outlives the renderer."""
        features, tiles, counters, is_sorted = self.features, frame.tiles, frame.counters, frame.is_sorted
        assert counters is not None
        scene, settings, rgba, owners = self.scene, self.settings, frame.values["rgba"], frame.values["owners"]
        sizes = {"scene": self.scene_bytes, "image": rgba.array.nbytes}
        sizes["owners"] = 0 if owners is None else owners.array.nbytes
        sizes |= {"triangles": self.source.nbytes} if self.source.nbytes else {}
        first = {**self.source.sizes, "resolution": frame.resolution}
        last = {"device": self.device.title, "lanes": self.stages.lanes, "bytes": sizes}

        def facts() -> dict[str, Any]:
            used = features.including("SORTED") if is_sorted else features
            return {
                **first,
                **{name: int(counters[name]) for name in _COUNTS},
                "clipped": int(counters["to_clip"]),
                "tiles": tiles,
                "empty_tiles": int(counters["empty_tiles"]) if counters["visible"] else tiles,
                "features": used.used,
                "left_out": dict(used.left_out),
                "ignored": ignored(scene, settings),
                **last,
            }

        return facts
