"""What the host tells the kernels of a frame: camera, image, lights."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Integers
from . import backdrop, sample_pattern, shading_tables, struct_layout
from .buffers import Buffer
from .frame_state import FrameTables, SceneFrame
from .resident_scene import ResidentScene
from .shadow_view import write_shadow_view


class TableWriter:
    """Writes the tables of a scene's frames. Each may be written while kernels run that do not read it."""

    def __init__(self, scene: ResidentScene) -> None:
        self._resident, self._scene, self._settings = scene, scene.scene, scene.settings
        self._structs, self._real = scene.structs, scene.structs.real
        self.place_samples(sample_pattern.positions(self._settings.samples))

    def new_tables(self) -> FrameTables:
        """Return tables of which nothing is written yet."""
        device, structs = self._resident.device, self._structs
        rows = (structs.View, structs.Image, structs.ShadowView, structs.Counters)
        view, image, shadow_view, counters = (Buffer(device, np.zeros(1, kind)) for kind in rows)
        lights = Buffer(device, np.zeros_like(self._resident.lights.table))
        return FrameTables(view, image, lights, shadow_view if self._resident.casters else None, counters)

    def place_samples(self, places: Integers) -> None:
        """Set where the next frames' pixels are sampled, see `Renderer.place_samples`."""
        self._places = places

    def write_view(self, frame: SceneFrame) -> None:
        """Write what the projection reads, and set the counters to 0."""
        with frame.tables.view.writing(waits=False) as table:
            frame.space.write_view(table[0])
            table[0]["needs"] = self._resident.features.needs
        with frame.counted.writing(waits=False) as table:
            table[:] = 0

    def write_image(self, frame: SceneFrame, room: int) -> None:
        """Write what setup and later stages read. room: entries that the tile lists have room for."""
        settings, resident, real = self._settings, self._resident, self._real
        columns, rows = resolution = frame.resolution
        first = frame.space.raster.first
        # Pixels below lines are written twice.
        streamed = frame.streams and columns % 4 == 0 and settings.edges is None
        known = resolution, first, room, streamed, self._places.tobytes()
        with frame.image.writing(waits=False) as table:
            image = table[0]
            image["unscale"] = shading_tables.to_real(np.float64(1.0) / frame.space.scale, real)
            image["to_eye"] = -frame.space.axes[2]
            around = self._scene.environment if resident.features["BACKDROP"] else None
            if around is not None:
                backdrop.write_rays(image, around, frame.space, real)
            if frame.tables.image_of == known:
                return
            frame.tables.image_of = None
            image["needs"] = resident.features.needs
            image["columns"], image["rows"], image["first"] = columns, rows, first
            image["tiles_x"], image["tiles"] = -(-columns // struct_layout.TILE_SIZE), frame.tiles
            places = self._places << struct_layout.SUBPIXEL_BITS - struct_layout.SAMPLE_BITS
            image["samples"] = len(places)
            image["sample_x"][: len(places)], image["sample_y"][: len(places)] = places.T
            image["least"], image["most"] = places.min(axis=0), places.max(axis=0)
            image["lights"], image["list_capacity"] = resident.lights.count, room
            image["streamed"] = streamed
            if settings.edges is not None:
                image["line_color"] = settings.edges.color
                image["marked_color"] = settings.edges.nonmanifold_color
            if around is not None:
                backdrop.write_size(image, around)
            image["map_colors"] = resident.map_colors
            image["unlit"] = settings.shader == "nolight"
            image["transparent"] = self._scene.background is None
            if self._scene.background is not None:
                image["background"] = shading_tables.to_real(self._scene.background, real)
            image["light_unit"] = resident.lights.unit
            image["layer_alpha"] = shading_tables.to_real(np.float64(settings.layer_alpha), real)
        frame.tables.image_of = known

    def write_lights(self, frame: SceneFrame) -> None:
        """Write what only shading reads: lights and shadows, relative to the eye."""
        lights, casters = self._resident.lights, self._resident.casters
        if lights.count:
            rows = lights.rows(frame.space.camera.eye, frame.space.scale)
            with frame.tables.lights.writing(waits=False) as table:
                table[:] = rows
        if casters is not None and frame.tables.shadow_view is not None:
            with frame.tables.shadow_view.writing(waits=False) as table:
                write_shadow_view(table[0], frame.space, casters.frame)
