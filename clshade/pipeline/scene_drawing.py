"""Frames of a scene: the stages from its triangles to pixels and layers, one after the other."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..base.arrays import Array, Integers
from ..scene.model import Scene, Settings
from . import programs
from .buffers import Pool, finish
from .clip import Clipping
from .features import Features, ignored
from .frame_state import SceneFrame
from .launches import scene_stages
from .layers import Layers, layer_features
from .lines import Lines
from .opencl.device import Device
from .scene_tables import Packed, ResidentScene
from .tile_lists import DepthOrder, TileLists, draw_sorted
from .triangle_source import SceneFaces, Triangles

_COUNTS = ("visible", "behind", "off_screen", "between_samples", "zero_area", "back_facing", "saturated")
# Samples times lights, and faces, that unoptimized programs draw in less time than optimizing takes.
_MOST_LIT, _MOST_FACES = 1 << 23, 1 << 18


def compiles_longer(scene: Scene, settings: Settings) -> bool:
    """Return whether optimizing the kernels takes longer than a frame does without, as far as its size tells."""
    lit = math.prod(scene.camera.resolution) * settings.samples * (1 + len(scene.lights))
    return lit <= _MOST_LIT and scene.face_count <= _MOST_FACES


class SceneDrawing:
    """A scene on a device, which draws frames of it into buffers, one after the other.

    `draw` completes a frame; `enqueue` only begins one, and does not wait for the device where nothing is sorted.

    scene, settings, packed: as of `scene_tables.pack`. features: of the kernels. lanes: None for what suits the device.
    Raises DeviceError if the scene does not fit into the device's memory.

    pool: of images. layers: of the settings. extent: of the scene, None without faces. scene_bytes: of device memory that
    does not depend on the frame. tables: of a frame drawn by itself.
    """

    def __init__(
        self, device: Device, scene: Scene, settings: Settings, features: Features, packed: Packed, lanes: int | None
    ) -> None:
        self.device, self.scene, self.settings, self.features = device, scene, settings, features
        of_layers = layer_features(features, packed.layers.asked)
        slow = any(features[name] for name in ("CASTERS", "BLEND", "DOUBLE", "LINES"))
        first = programs.own.is_first and device.keeps_programs and not slow and compiles_longer(scene, settings)
        self.stages = stages = scene_stages(device, features, lanes, of_layers, first=first)
        self.pool, depth_test = Pool(device), bool(features["DEPTH_TEST"])
        self._resident = resident = ResidentScene(stages, scene, settings, features, packed, of_layers)
        self._source, self.extent = resident.source, resident.extent
        # The layers' texture coordinates include these, and also those of meshes without a texture.
        own = packed.layers.arrays if "uvs" in packed.layers.arrays else packed.arrays
        uvs, uv_faces = own.get("uvs"), own.get("uv_faces", packed.arrays["faces"])
        self._clipping = Clipping(self._source, uvs, uv_faces, depth_test=depth_test)
        transparent = packed.faces_with("blends") if features["BLEND"] else None
        self._order = DepthOrder(device, self._source, painter=not depth_test, transparent=transparent)
        self._lists = TileLists(stages)
        self._lines: Lines | None = None
        if settings.edges is not None and isinstance(self._source, SceneFaces):
            front_only = packed.faces_with("front_only") | bool(features["CULL"])
            self._lines = Lines(self._source, settings.edges, front_only)
        self.layers = Layers(stages, self.pool, settings.layers, packed.layers)
        self.scene_bytes = resident.nbytes + self.layers.nbytes
        self.tables = resident.new_tables()
        self._clips = False  # whether the last frame had faces to clip

    def _begin(self, frame: SceneFrame) -> None:
        """Enqueue the drawing of a frame without layers. Where no sort is needed the host does not wait, and has no
        counters yet: `_complete` goes on. Nothing is drawn then if there are faces to clip."""
        source = self._source
        if self.features["SORTED"] or self._clips or not source.room:
            self._draw_sorted(frame)
            return
        assert isinstance(source, SceneFaces)
        self._resident.write_view(frame)
        source.project(frame)
        self._resident.write_image(frame, self._lists.room)
        self._lists.set_up(source, frame)
        self._resident.write_lights(frame)
        self._fill_and_shade(frame)

    def _draw_sorted(self, frame: SceneFrame) -> None:
        """Draw the triangles in the order of their depths."""
        frame.events.clear()  # those of a frame that was given up
        self._resident.write_view(frame)
        self._source.project(frame)
        self._resident.write_image(frame, self._lists.room)
        self._source.set_up(frame)
        self._resident.write_lights(frame)
        triangles = self._clipping.clip(frame)
        painter = not self.features["DEPTH_TEST"]
        shown = None if self._lines is None else self._lines.draw(triangles, frame, painter=painter)
        draw_sorted(self._order, self._lists, triangles, self._inputs(triangles, frame), frame, shown)
        assert frame.counters is not None
        self._clips = bool(frame.counters["to_clip"])
        for name, count in self._source.culled.items():
            frame.counters[name] += count

    def _fill_and_shade(self, frame: SceneFrame) -> None:
        """Enqueue the lists and the pixels of faces in their order."""
        self._lists.fill_unsorted(self._source.made, frame)
        triangles = self._clipping.nothing_clipped(self._source.room)
        self._lists.shade(self._inputs(triangles, frame), frame)

    def _complete(self, frame: SceneFrame) -> None:
        """Wait for the frame that `_begin` has begun, the last one enqueued, and draw it again if lists lack room, or sorted
        if there are faces to clip: nothing of it is drawn then."""
        while frame.counters is None:
            counters = frame.read_counters()
            if counters["to_clip"]:
                self._draw_sorted(frame)
            elif counters["entries"] <= self._lists.room:
                frame.counters, frame.host_ms["sort"] = counters, 0.0
            else:
                self._lists.make_room_for(int(counters["entries"]), frame)
                self._fill_and_shade(frame)

    def _inputs(self, triangles: Triangles, frame: SceneFrame) -> dict[str, Any]:
        """Return the inputs of the pixel stages by name."""
        tables = frame.tables
        of_frame = {"lights": tables.lights, "image": tables.image, "shadow_view": tables.shadow_view}
        own = {"triangles": triangles.made.triangles, "pieces": triangles.pieces, **of_frame}
        return {**self._resident.inputs, **own, **self._source.inputs(frame)}

    def draw(self, frame: SceneFrame) -> dict[str, Array]:
        """Draw a frame, and return its layers by name."""
        self._begin(frame)
        self._complete(frame)
        return self.layers.draw(frame)

    def enqueue(self, frame: SceneFrame) -> None:
        """Enqueue the drawing of a frame, and of its layers. If `frame.counters` is None, the host has not waited: nothing
        is drawn if there are faces to clip, or more entries than `frame.room`, in `frame.counted`."""
        self._begin(frame)
        frame.room = self._lists.room
        self.layers.enqueue(frame)

    def draw_again(self, frame: SceneFrame) -> None:
        """Redraw a frame that the device skipped, and enqueue its layers."""
        assert frame.counters is not None
        finish(self.device)  # kernels of the next frame use what is replaced
        self._clips, frame.counters = bool(frame.counters["to_clip"]), None
        self._begin(frame)
        self._complete(frame)
        self.layers.enqueue(frame)

    def place_samples(self, places: Integers) -> None:
        """Set where the next frames' pixels are sampled, see `Renderer.place_samples`."""
        self._resident.places = places

    def sizes(self) -> dict[str, int]:
        """Return the numbers of triangles and vertices, those of all instances."""
        return self._source.sizes()

    def facts_of(self, frame: SceneFrame) -> Callable[[], dict[str, Any]]:
        """Return a function that returns the entries of `Frame.stats` other than times; it outlives the renderer."""
        features, tiles, counters = self.features, frame.tiles, frame.counters
        assert counters is not None
        sizes, scene, settings, resolution = self.sizes(), self.scene, self.settings, frame.resolution
        buffers = {"image": frame.rgba, "owners": frame.owners}
        sizes_of = {name: 0 if buffer is None else buffer.array.nbytes for name, buffer in buffers.items()}
        if self._source.nbytes:
            sizes_of["triangles"] = self._source.nbytes
        title, lanes, own_bytes = self.device.title, self.stages.lanes, {"scene": self.scene_bytes, **sizes_of}
        is_sorted = frame.is_sorted

        def facts() -> dict[str, Any]:
            used = features.including("SORTED") if is_sorted else features
            return {
                **sizes,
                "resolution": resolution,
                **{name: int(counters[name]) for name in _COUNTS},
                "clipped": int(counters["to_clip"]),
                "tiles": tiles,
                "empty_tiles": int(counters["empty_tiles"]) if counters["visible"] else tiles,
                "features": used.used,
                "left_out": dict(used.left_out),
                "ignored": ignored(scene, settings),
                "device": title,
                "lanes": lanes,
                "bytes": own_bytes,
            }

        return facts
