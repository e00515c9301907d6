"""A scene on a device, and the stages that draw a frame of it: projection, setup, clipping, sorting, lists of tiles, pixels,
layers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..base.arrays import Array, Integers
from ..errors import InputError
from ..scene.model import MAX_FACES, Scene, Settings
from . import backdrop, sample_pattern, scene_buffers, scene_memory, shading_tables, struct_layout
from .ambient_occlusion import hemisphere_row
from .buffer_pool import Pool
from .buffers import Buffer, TriangleBuffers, VertexBuffers, finish
from .camera_space import CameraSpace, Extent
from .clipped_triangles import piece_table
from .depth_sort import front_to_back, opaque_first
from .features import Features, finds_casters, ignored, looks_up
from .frame_state import FrameTables, Progress
from .hierarchy import Hierarchy
from .instances import Instances
from .launches import Hiding, Stages, lookup_stages, scene_stages
from .layers import Layers
from .light_table import LightTable
from .lines import Lines
from .opencl.device import Device
from .pixel_pass import draw_pixels
from .programs import running_time
from .shadow_view import shadow_factors, shadow_lights, write_shadow_view
from .surface_inputs import SurfaceInputs
from .tile_lists import TileLists

_COUNTS = ("visible", "behind", "off_screen", "between_samples", "zero_area", "back_facing", "saturated")


class SceneDrawing:
    """A scene on a device, which draws frames of it into buffers, one after the other.

    `draw` completes a frame; `enqueue` only begins one, and does not wait for the device where nothing is sorted.

    scene, settings, packed: as of `scene_buffers.pack`. features: of the kernels. lanes: None for what suits the device.
    Raises DeviceError if the scene does not fit into the device's memory.

    pool: of images. layers: of the settings. extent: of the scene, None without faces. scene_bytes: of device memory that
    does not depend on the frame. tables: those that the next frame uses.
    """

    def __init__(
        self,
        device: Device,
        scene: Scene,
        settings: Settings,
        features: Features,
        packed: scene_buffers.Packed,
        lanes: int | None,
    ) -> None:
        self.device, self.scene, self.settings, self.features = device, scene, settings, features
        self.stages = self._build(lanes, packed.layers.features)
        self._structs = self.stages.structs
        scene_memory.check_device(device, packed, self._structs)
        self.pool = Pool(device)
        self._upload(packed)

    def _build(self, lanes: int | None, layers: Features | None) -> Stages:
        return scene_stages(self.device, self.features, lanes, layers)

    def _upload(self, packed: scene_buffers.Packed) -> None:
        device, structs = self.device, self._structs
        # Of instances that are drawn from one copy, the faces that there is room for.
        self._face_count, self._vertex_count = len(packed.faces), len(packed.positions)
        self.extent = Extent.of(packed.low, packed.high) if self._face_count else None
        self._positions, self._faces = Buffer(device, packed.positions), Buffer(device, packed.faces)
        self._instances: Instances | None = None
        if packed.instances is not None:
            painter = not self.features["DEPTH_TEST"]
            self._instances = Instances(self.stages, packed.instances, self._positions, painter=painter)
            self._face_count, self._vertex_count = (
                self._instances.first_room(math.prod(self.scene.camera.resolution)),
                0,
            )
        # The layers' texture coordinates include these, and also those of meshes without a texture.
        uvs, uv_faces = packed.uvs, packed.uv_faces
        if packed.layers.uvs is not None:
            uvs, uv_faces = packed.layers.uvs, packed.layers.uv_faces
        self._uvs_host = uvs, packed.faces if uv_faces is None else uv_faces
        colors = packed.colors if packed.corner_uvs is None else self._corner_colors(packed)

        def optional(array: Array | None) -> Buffer | None:
            return None if array is None else Buffer(device, array)

        looked_up = looks_up(self.features)
        tables = {
            "normals": optional(packed.normals),
            "normal_faces": optional(packed.normal_faces),
            "colors": optional(colors),
            "color_map": optional(packed.color_map),
            "uvs": optional(packed.uvs),
            "uv_faces": optional(packed.uv_faces),
            "tangents": optional(packed.tangents),
            "tangent_faces": optional(packed.tangent_faces),
            "face_materials": optional(packed.face_materials),
            "textures": optional(packed.textures if looked_up else None),
            "texels": optional(packed.texels if looked_up else None),
            "environment": optional(packed.environment),
            "radiance": optional(packed.radiance),
            "backdrop": optional(packed.backdrop),
            "alphas": optional(packed.alphas),
        }
        if self._instances is not None:
            tables["object_normals"], tables["object_tangents"] = tables.pop("normals"), tables.pop("tangents")
        materials = Buffer(device, packed.materials)
        self.layers = Layers(self.stages, self.pool, self.settings.layers, packed.layers)
        kept = (self._positions, self._faces, materials, *tables.values())
        self.scene_bytes = sum(buffer.array.nbytes for buffer in kept if buffer is not None) + self.layers.nbytes
        self.scene_bytes += 0 if self._instances is None else self._instances.nbytes
        self._sides = (tables["face_materials"], materials) if self.features["SIDES"] else (None, None)
        self._vertices = VertexBuffers(device, self._vertex_count, structs)
        self._transparent = scene_buffers.transparent_faces(packed) if self.features["BLEND"] else None
        self._made = TriangleBuffers(device, self._face_count, 0, structs, slack=self.stages.lanes)
        self._clips = False  # whether the last frame had faces to clip
        self._view = Buffer(device, np.zeros(1, structs.View))
        self._image = Buffer(device, np.zeros(1, structs.Image))
        self._places: Integers | None = None  # of the samples, if not those of the settings
        self._map_colors = 0 if packed.color_map is None else len(packed.color_map) - 4
        self._lines: Lines | None = None
        if self.settings.edges is not None:
            front_only = packed.materials["front_only"] != 0
            front_only = front_only[0 if packed.face_materials is None else packed.face_materials]
            front_only = np.broadcast_to(front_only | bool(self.features["CULL"]), self._face_count)
            self._lines = Lines(self.stages, self.settings.edges, packed.positions, packed.faces, front_only)
        self._upload_lights(packed.light_unit)
        self._upload_casters(packed)
        shadow_view = self._shadow_tables.get("shadow_view")
        self.tables = FrameTables(self._view, self._image, self._lights, shadow_view, self._made.counters)
        self._pieces = Buffer.empty(device, 0, structs.Piece)
        self._lists = TileLists(self.stages)
        self._order = Buffer.empty(device, 0, np.uint32)
        self._inputs = SurfaceInputs(
            triangles=self._made.triangles,
            pieces=self._pieces,
            faces=self._faces,
            relative=self._vertices.relative,
            vertices=self._vertices.projected,
            materials=materials,
            lights=self._lights,
            image=self._image,
            **tables,
            **self._shadow_tables,
        )
        if self._instances is not None:
            self._inputs = self._inputs._replace(
                instances=self._instances.table, view=self._view, object_positions=self._positions
            )

    def _upload_lights(self, unit: float) -> None:
        """Upload the lights. unit: the unit their intensities are expressed in."""
        self._light_table = LightTable(self.scene.lights, unit, self._structs, self.settings.light_samples)
        self._lights = Buffer(self.device, np.zeros(max(self._light_table.count, 1), self._structs.Light))

    def _upload_casters(self, packed: scene_buffers.Packed) -> None:
        """Upload what casts shadows, if the kernels look for any."""
        self._casters: Hierarchy | None = None
        self._shadow_tables: dict[str, Buffer] = {}
        programs_of = [self.features, *([packed.layers.features] if packed.layers.features else [])]
        if not any(map(finds_casters, programs_of)):
            return
        positions = packed.positions.astype(np.float64)
        veiling = any(features["SHADOW_ALPHA"] for features in programs_of)
        veils = scene_buffers.veiling_faces(packed) if veiling else None
        self._casters = Hierarchy(self.device, positions, packed.faces, lanes=self.stages.lanes, veils=veils)
        self.scene_bytes += self._casters.nbytes
        every = self._casters.casters.array
        of_lights = every if self.settings.shadows else np.zeros_like(every)
        self._light_table.shadow_factors = shadow_factors(self.scene.lights, self._casters.frame)
        self._shadow_tables = {
            "shadow_vertices": self._casters.vertices,
            "shadow_nodes": self._casters.nodes,
            "shadow_leaves": self._casters.leaves,
            "shadow_casters": Buffer(self.device, np.concatenate([of_lights, every])),
            "shadow_lights": Buffer(self.device, shadow_lights(self.scene.lights, self._casters.frame)),
            "shadow_view": Buffer(self.device, np.zeros(1, self._structs.ShadowView)),
            "shadow_hemisphere": Buffer(self.device, hemisphere_row(self.settings, self._casters.frame, self._structs)),
        }

    def _corner_colors(self, packed: scene_buffers.Packed) -> Array:
        """Return the (3F, 4) colors for texture_at vertex: the texel at each corner times the vertex color."""
        colors: Array = packed.colors  # type: ignore[assignment]
        rows = np.flatnonzero(packed.corner_textures >= 0)  # type: ignore[operator]
        looked_up = Buffer.empty(self.device, (len(rows), 4), self._structs.real)
        uvs = Buffer(self.device, packed.corner_uvs[rows])  # type: ignore[index]
        texture_of = Buffer(self.device, packed.corner_textures[rows])  # type: ignore[index]
        textures, texels = (Buffer(self.device, np.asarray(table)) for table in (packed.textures, packed.texels))
        stages = lookup_stages(self.device, self.features, self.stages.lanes)
        stages.bilerp(uvs, texture_of, textures, texels, looked_up, len(rows))
        colors[rows, :3] *= looked_up.to_host()[:, :3]
        return colors

    # Per frame

    def _use_tables(self, tables: FrameTables) -> None:
        """Use these tables for the next frame."""
        shadows = self._shadow_tables
        if tables.shadow_view is not None:
            shadows = {**shadows, "shadow_view": tables.shadow_view}
        inputs = self._inputs._replace(lights=tables.lights, image=tables.image, view=tables.view, **shadows)
        # In one step, of which an interrupt does not leave a part.
        vars(self).update(
            tables=tables,
            _view=tables.view,
            _image=tables.image,
            _lights=tables.lights,
            _shadow_tables=shadows,
            _inputs=inputs,
        )
        self._made.counters = tables.counters

    def _write_lights(self, space: CameraSpace) -> None:
        if self._light_table.count:
            rows = self._light_table.rows(space.camera.eye, space.scale)
            with self._lights.writing(waits=False) as table:
                table[:] = rows
        if self._casters is not None:
            with self._shadow_tables["shadow_view"].writing(waits=False) as table:
                write_shadow_view(table[0], space, self._casters.frame)

    def _write_image(self, frame: Progress) -> None:
        columns, rows = resolution = frame.space.camera.resolution
        first = frame.space.raster.first
        # Pixels below lines are written twice.
        streamed = frame.streams and columns % 4 == 0 and self.settings.edges is None
        known = resolution, first, self._lists.room, streamed
        with self._image.writing(waits=False) as table:
            image = table[0]
            image["unscale"] = shading_tables.to_real(np.float64(1.0) / frame.space.scale, self._structs.real)
            image["to_eye"] = -frame.space.axes[2]
            around = self.scene.environment if self.features["BACKDROP"] else None
            if around is not None:
                backdrop.write_rays(image, around, frame.space, self._structs.real)
            if self.tables.image_of == known:
                return
            self.tables.image_of = None
            image["columns"], image["rows"], image["first"] = columns, rows, first
            image["tiles_x"], image["tiles"] = -(-columns // struct_layout.TILE_SIZE), frame.tiles
            places = sample_pattern.positions(self.settings.samples) if self._places is None else self._places
            image["samples"] = len(places)
            image["sample_x"][: len(places)], image["sample_y"][: len(places)] = places.T
            image["least"], image["most"] = places.min(axis=0), places.max(axis=0)
            image["lights"], image["list_capacity"] = self._light_table.count, self._lists.room
            image["streamed"] = streamed
            if self.settings.edges is not None:
                image["line_color"] = self.settings.edges.color
                image["marked_color"] = self.settings.edges.nonmanifold_color
            if around is not None:
                backdrop.write_size(image, around)
            image["map_colors"] = self._map_colors
            image["unlit"] = self.settings.shader == "nolight"
            image["transparent"] = self.scene.background is None
            if self.scene.background is not None:
                image["background"] = shading_tables.to_real(self.scene.background, self._structs.real)
            image["light_unit"] = self._light_table.unit
            image["layer_alpha"] = shading_tables.to_real(np.float64(self.settings.layer_alpha), self._structs.real)
        self.tables.image_of = known  # the resolution, the part, the room, whether it streams

    def _project(self, frame: Progress) -> None:
        """Project the vertices."""
        with self._made.counters.writing(waits=False) as table:
            table[:] = 0
        # Tables are written while kernels run that do not need them yet.
        if self._face_count and self._instances is None:
            events = frame.events
            events["project"] = self.stages.project(self._positions, self._view, self._vertices, self._vertex_count)
        self._write_image(frame)

    def _setup(self, frame: Progress) -> int:
        """Set up the triangles; return the number of visible ones, whose keys are written."""
        self._project(frame)
        if not self._face_count:
            return 0
        if self._instances is None:
            frame.events["setup"] = self.stages.setup(
                self._faces, self._vertices, self._view, self._image, self._made, self._face_count, self._sides
            )
        else:
            self._set_up_instances(self._instances, frame)
        made = self._made
        self._write_lights(frame.space)
        counters = made.counters.to_host()[0]
        if counters["to_clip"]:
            start = running_time()
            count = self._clip(frame.space, int(counters["to_clip"]))
            if self._face_count + count > MAX_FACES:
                limit = f"at most {MAX_FACES} triangles, pieces of clipped ones included"
                raise InputError(f"render: scene: expected {limit}, found {self._face_count} and {count} pieces")
            if count > made.piece_capacity:
                self._made = TriangleBuffers(
                    self.device, self._face_count, count + count // 2, self._structs, slack=self.stages.lanes
                )
                self._inputs = self._inputs._replace(triangles=self._made.triangles)
                return self._setup(frame)
            if count and self._instances is not None:
                self._instances.add_pieces(self._face_count, self._piece_instances)
            if count:
                self.stages.setup_pieces(self._pieces, self._image, made, self._face_count, count, self._sides)
                counters = made.counters.to_host()[0]
            frame.host_ms["clip"] = (running_time() - start) * 1e3
        return int(counters["visible"])

    def _set_up_instances(self, instances: Instances, frame: Progress) -> None:
        """Set up the triangles of instances in the view, with room for all that may be seen."""
        instances.select(frame.space)
        while True:
            made = self._made
            instances.set_up(self._faces, self._view, self._image, made, self._sides, frame.events)
            self._inputs = self._inputs._replace(triangle_instances=instances.of_triangles)
            counters = made.counters.to_host()[0]
            needed = max(int(counters["visible"]), 2 * int(counters["to_clip"]))
            if needed <= self._face_count:
                return
            self._face_count = instances.more_room(needed)
            del made
            self._made = TriangleBuffers(
                self.device, self._face_count, self._made.piece_capacity, self._structs, slack=self.stages.lanes
            )
            self._inputs = self._inputs._replace(triangles=self._made.triangles)

    def _to_clip(self, count: int) -> tuple[Array, Array, Array | None]:
        """Return the faces to clip, in order: their corners (C, 3, 3) in world space, numbers (C,), and the instances (C,)
        that have them, if these are drawn from one copy."""
        if self._instances is None:
            faces = np.sort(self._made.to_clip.to_host(count))
            return self._positions.array[self._faces.array[faces]], faces, None
        pairs = self._made.to_clip.to_host(2 * count).reshape(-1, 2)
        instances, faces = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
        return self._instances.corners(self._faces.array, instances, faces), faces, instances

    def _clip(self, space: CameraSpace, count: int) -> int:
        """Clip the listed faces and upload the pieces; return their number."""
        corners, faces, instances = self._to_clip(count)
        uvs, uv_faces = self._uvs_host
        table = piece_table(
            space.points(corners),
            np.arange(len(faces)),
            None if uvs is None else uvs[uv_faces[faces]],
            space.camera,
            self._structs,
            near=space.near,
            scale=space.scale,
            depth_test=bool(self.features["DEPTH_TEST"]),
        )
        if instances is not None:
            self._piece_instances = instances[table["face"]]
        table["face"] = faces[table["face"]]
        self._pieces = Buffer(self.device, table)
        self._inputs = self._inputs._replace(pieces=self._pieces)
        return len(table)

    def _sort(self, visible: int, frame: Progress) -> None:
        """Write the visible triangles, nearest first, to the order buffer."""
        start = running_time()
        if len(self._order.array) < visible:
            self._order = Buffer.empty(self.device, visible + visible // 2, np.uint32)
        keys = self._made.keys.to_host(visible)
        exact = None if self.features["DEPTH_TEST"] else self._painter_depths
        order = front_to_back(keys, exact, self._made.index_bits)
        if self._transparent is not None:
            if exact is not None:
                self._write_ranks(order)
            order = opaque_first(order, self._transparent[self._faces_of(order)])
        with self._order.writing(visible) as rows:
            rows[:] = order
        frame.host_ms["sort"] = (running_time() - start) * 1e3

    def _faces_of(self, index: Array) -> Array:
        """Return the faces of triangles, which are faces or clipped pieces of them."""
        if self._instances is not None:
            return self._made.triangles.to_host()["face"][index]
        face = index.astype(np.int64)
        pieces = face >= self._face_count
        if pieces.any():
            face[pieces] = self._pieces.array["face"][face[pieces] - self._face_count]
        return face

    def _write_ranks(self, order: Array) -> None:
        """Write the place of each triangle in painter's order."""
        ranks = self._inputs.ranks
        if ranks is None or len(ranks.array) < len(self._made.triangles.array):
            ranks = Buffer.empty(self.device, len(self._made.triangles.array), np.uint32)
            self._inputs = self._inputs._replace(ranks=ranks)
        with ranks.writing() as rows:
            rows[order] = np.arange(len(order), dtype=np.uint32)

    def _painter_depths(self, index: Array) -> tuple[Array, Array]:
        """Return the exact painter's depths and the faces of the triangles in `index`."""
        depth, face = np.empty(len(index)), index.astype(np.int64)
        whole = index < self._face_count
        if self._instances is not None:
            depth[whole] = self._instances.depths_of(index[whole])
            depth[~whole] = self._pieces.array["key_depth"][index[~whole] - np.uint32(self._face_count)]
            return depth, self._instances.order_of(index, self._faces_of(index))
        z = self._vertices.projected.to_host()["depth"][self._faces.array[index[whole]]]
        depth[whole] = ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0
        if not whole.all():
            pieces = self._pieces.array[index[~whole].astype(np.int64) - self._face_count]
            depth[~whole], face[~whole] = pieces["key_depth"], pieces["face"]
        return depth, face

    def _draw_lines(self, frame: Progress) -> Buffer | None:
        """Find the samples that show lines; None if no edges are drawn."""
        if self._lines is None:
            return None
        pieces = self._pieces if self._clips else Buffer.empty(self.device, 0, self._structs.Piece)
        vertices, (numbers, materials) = self._vertices.projected, self._sides
        hiding = Hiding(self._faces, vertices, pieces, numbers, materials, None, self._view, self._face_count)
        painter = not self.features["DEPTH_TEST"]
        return self._lines.draw(hiding, self._vertices, frame.space, self._image, frame.events, painter=painter)

    def _draw(
        self, visible: int, rgba: Buffer, owners: Buffer | None, frame: Progress, shown: Buffer | None = None
    ) -> None:
        """Enqueue the pixel stage. shown: the samples that show lines."""
        tile: tuple[Any, ...] = (self._lists.entries, self._lists.starts, rgba, owners, self._made.counters)
        tile = tile if shown is None else (*tile, shown)
        self._inputs = draw_pixels(self.stages, self._inputs, self._order, visible, tile, frame.tiles, frame.events)

    def _read_counters(self) -> np.void:
        counters: np.void = self._made.counters.to_host()[0].copy()
        return counters

    def _draw_sorted(self, rgba: Buffer, owners: Buffer | None, frame: Progress) -> None:
        """Draw the triangles in the order of their depths."""
        frame.events.clear()  # those of a frame that was given up
        visible = self._setup(frame)
        frame.is_sorted = visible > 0
        self._clips = bool(self._made.counters.array[0]["to_clip"])
        shown = self._draw_lines(frame)
        self._sort(visible, frame)
        self._lists.count(self._order, self._made, self._image, visible, frame.tiles, frame.events)
        while True:
            self._lists.fill(self._order, self._made, self._image, visible, frame.events)
            self._draw(visible, rgba, owners, frame, shown)
            frame.counters = self._read_counters()
            if frame.counters["entries"] <= self._lists.room:
                for name, count in self._culled().items():
                    frame.counters[name] += count
                return
            self._make_room(int(frame.counters["entries"]))

    def _culled(self) -> dict[str, int]:
        """Return the triangles of instances outside of the view, by their place."""
        return {} if self._instances is None else self._instances.culled

    def _enqueue_unsorted(self, rgba: Buffer, owners: Buffer | None, frame: Progress) -> None:
        """Enqueue the drawing of the faces in their order; `_finish_unsorted` completes it."""
        self._project(frame)
        self._lists.set_up(self._faces, self._vertices, self._made, self._image, frame.tiles, frame.events, self._sides)
        self._write_lights(frame.space)
        self._fill_unsorted(rgba, owners, frame)

    def _fill_unsorted(self, rgba: Buffer, owners: Buffer | None, frame: Progress) -> None:
        self._lists.fill_unsorted(self._made, self._image, frame.events)
        self._draw(self._face_count, rgba, owners, frame)

    def _finish_unsorted(self, rgba: Buffer, owners: Buffer | None, frame: Progress) -> None:
        """Wait for the frame, the last one enqueued, and draw it again if lists lack room, or sorted if there are faces to
        clip: nothing of it is drawn then."""
        while True:
            counters = self._read_counters()
            if counters["to_clip"]:
                self._draw_sorted(rgba, owners, frame)
                return
            if counters["entries"] <= self._lists.room:
                frame.counters, frame.host_ms["sort"] = counters, 0.0
                return
            self._make_room(int(counters["entries"]))
            self._fill_unsorted(rgba, owners, frame)

    def _begin(self, frame: Progress, rgba: Buffer, owners: Buffer | None) -> None:
        """Enqueue the drawing of a frame without layers. Where no sort is needed the host does not wait, and has no
        counters yet."""
        with self._view.writing(waits=False) as table:
            frame.space.write_view(table[0])
        if self.features["SORTED"] or self._clips or not self._face_count:
            self._draw_sorted(rgba, owners, frame)
        else:
            self._enqueue_unsorted(rgba, owners, frame)

    def _complete(self, frame: Progress, rgba: Buffer, owners: Buffer | None) -> None:
        """Complete what `_begin` has begun, the last frame enqueued."""
        if frame.counters is None:
            self._finish_unsorted(rgba, owners, frame)

    def draw(self, frame: Progress, rgba: Buffer, owners: Buffer | None) -> dict[str, Array]:
        """Draw a frame into the image, (M, N, 4), and return its layers by name. owners: (M, N), if there are layers."""
        self._begin(frame, rgba, owners)
        self._complete(frame, rgba, owners)
        if owners is None or not self.settings.layers:
            return {}
        return self.layers.draw(self._inputs, owners, frame.tiles, frame.space, frame.events)

    def enqueue(
        self, tables: FrameTables, frame: Progress, targets: Mapping[str, Buffer], owners: Buffer | None
    ) -> None:
        """Enqueue the drawing of a frame with its layers in these tables, into buffers by name. If `frame.counters` is None,
        the host has not waited: nothing is drawn if there are faces to clip, or more entries than `frame.room`, in
        `frame.counted`."""
        self._use_tables(tables)
        self._begin(frame, targets["rgba"], owners)
        frame.counted, frame.room = self._made.counters, self._lists.room
        self._enqueue_layers(frame, targets, owners)

    def draw_again(
        self, tables: FrameTables, frame: Progress, targets: Mapping[str, Buffer], owners: Buffer | None
    ) -> None:
        """Draw a frame of which nothing was drawn, and enqueue its layers."""
        assert frame.counters is not None
        finish(self.device)  # kernels of the next frame use what is replaced
        self._use_tables(tables)
        self._clips, frame.counters = bool(frame.counters["to_clip"]), None
        self._begin(frame, targets["rgba"], owners)
        self._complete(frame, targets["rgba"], owners)
        self._enqueue_layers(frame, targets, owners)

    def _enqueue_layers(self, frame: Progress, targets: Mapping[str, Buffer], owners: Buffer | None) -> None:
        if owners is not None:
            layers = {name: buffer for name, buffer in targets.items() if name != "rgba"}
            self.layers.enqueue(layers, self._inputs, owners, frame.tiles, frame.events)

    def _make_room(self, entries: int) -> None:
        self._lists.make_room(entries)
        with self._image.writing() as table:
            table["list_capacity"] = self._lists.room
        with self._made.counters.writing() as table:
            table["next_tile"] = table["saturated"] = 0

    def place_samples(self, places: Integers) -> None:
        """Set where the next frames' pixels are sampled, see `Renderer.place_samples`."""
        self._places, self.tables.image_of = places, None

    def sizes(self) -> dict[str, int]:
        """Return the numbers of triangles and vertices, those of all instances."""
        if self._instances is not None:
            return {"triangles": self._instances.face_count, "vertices": self._instances.vertex_count}
        return {"triangles": self._face_count, "vertices": self._vertex_count}

    def facts_of(self, frame: Progress, image_bytes: dict[str, int]) -> Callable[[], dict[str, Any]]:
        """Return a function that returns the entries of `Frame.stats` other than times; it outlives the renderer."""
        features, camera, tiles, counters = self.features, frame.space.camera, frame.tiles, frame.counters
        assert counters is not None
        sizes, scene, settings = self.sizes(), self.scene, self.settings
        if self._instances is not None:
            image_bytes = {**image_bytes, "triangles": self._made.nbytes + self._instances.of_triangles.array.nbytes}
        title, lanes, own_bytes = self.device.title, self.stages.lanes, {"scene": self.scene_bytes, **image_bytes}

        def facts() -> dict[str, Any]:
            used = features.including("SORTED") if frame.is_sorted else features
            return {
                **sizes,
                "resolution": camera.resolution,
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
