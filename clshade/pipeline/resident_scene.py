"""A scene on a device: what does not change from frame to frame, and the tables that the host writes for each frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..base.arrays import Array, Floats
from ..scene.environment import Environment
from ..scene.lights import PlacedLight
from ..scene.model import Light, Scene, Settings
from . import sample_pattern, scene_buffers, shading_tables, struct_layout
from .buffers import Buffer
from .camera_space import CameraSpace, Extent
from .features import Features, casts_alpha, looks_up
from .frame_state import FrameTables, SceneFrame
from .hierarchy import CasterFrame, Hierarchy, split
from .instances import Instances
from .launches import Stages, lookup_stages
from .light_points import AXIS, LightTable, disc_radii, sides_of, write_pattern
from .scene_buffers import Packed
from .struct_layout import SAMPLE_BITS, SHADOW_REACH, SINGLE, Structs
from .triangle_source import NO_SIDES, SceneFaces, TriangleSource

_LARGEST = 2.0**90  # products of three coordinates stay within float32's range
_NARROWEST = 2.0**-40  # of the viewing direction's part of a ray: the part across the image is at most 1
_MOST_CENTER = 1 << 30  # 1/256 px


def write_shadow_view(row: np.void, space: CameraSpace, frame: CasterFrame) -> None:
    """Fill a row of structs.ShadowView for a camera.

    Rays are counted from the pixel at the whole image's center, by whole 1/256 px that float32 holds.
    """
    camera, raster, steps = space.camera, space.raster, 1 << SAMPLE_BITS
    across, upward, forward = space.axes
    columns, rows = raster.resolution
    center = columns * steps // 2, rows * steps // 2
    (height, width), principal = raster.plane, raster.principal
    start = (camera.eye - frame.origin) * frame.unit
    right, up = width / (columns * steps) * across, height / (rows * steps) * upward
    middle = (center[0] - principal[0] * columns * steps) * right + (center[1] - principal[1] * rows * steps) * up
    if camera.orthographic:
        start, along = start + middle * frame.unit, forward
        right, up = right * frame.unit, up * frame.unit
    else:
        along = middle + camera.focal * forward
        largest = max(float(np.abs(along).max()), width, height)
        along, right, up = along / largest, right / largest, up / largest
    for name, vector in (("start", start), ("along", along), ("right", right), ("up", up)):
        row[name], row[f"{name}_low"] = np.split(split(np.clip(vector, -_LARGEST, _LARGEST)), 2)
    row["center"] = [middle - steps * first for middle, first in zip(center, raster.first, strict=True)]


def shadow_lights(lights: tuple[Light, ...], frame: CasterFrame) -> Array:
    """Return rows of structs.ShadowLight of the lights that shine, in their order, at least one."""
    rows = [frame.light(_homogeneous(light), _size(light)) for light in lights if light.intensity.any()]
    return np.concatenate(rows) if rows else np.zeros(1, SINGLE.ShadowLight)


def shadow_factors(lights: tuple[Light, ...], frame: CasterFrame) -> Floats:
    """Return what turns lengths into the units of the rows of `shadow_lights`, one of each light that shines: the frame's
    unit times w, which the row has as 0 if it is too small."""
    factors = []
    for light in lights:
        if light.intensity.any():
            w = 0.0
            if isinstance(light, PlacedLight):
                moved = (np.asarray(light.position, np.float64) - frame.origin) * frame.unit
                reach = float(np.abs(moved).max()) + _size(light) * frame.unit
                w = 1.0 if reach <= SHADOW_REACH else SHADOW_REACH * 2.0 ** -math.frexp(reach)[1]
            factors.append(frame.unit * w)
    return np.array(factors)


def _size(light: Light) -> float:
    """Return how far from its position a light reaches."""
    return float(np.abs(sides_of(light)).sum()) if isinstance(light, PlacedLight) else 0.0


def _homogeneous(light: Light) -> Floats:
    """Return the position of a light, w = 1, or the unit vector toward a directional one, w = 0."""
    return np.append(light.position, 1.0) if isinstance(light, PlacedLight) else np.append(-light.axis, 0.0)


# Tables of Packed that pixel stages read under the same names.
_TABLES = (
    *("normal_faces", "color_map", "uvs", "uv_faces", "tangent_faces", "face_materials", "environment", "radiance"),
    *("backdrop", "alphas"),
)
_PLACED = ("normals", "tangents")  # read as object_normals and object_tangents of instances
_LONGEST = 4.0 * SHADOW_REACH  # longer than any diagonal of the casters' box, so that longer rays meet no more
_LEAST = 2.0**-60  # shorter rays end where they begin


def hemisphere_row(settings: Settings, frame: CasterFrame, structs: Structs) -> Array:
    """Return one row of structs.Light whose points are those of the unit disc below the hemisphere. shadow_scale is the
    rays' length in the units of shadows; no points without ambient occlusion."""
    rows = np.zeros(1, structs.Light)
    if not settings.ambient_occlusion or settings.ao_distance is None:
        return rows
    row = rows[0]
    row["points"], row["sphere"], row["axis"] = settings.ambient_occlusion, 1, AXIS
    row["right"], row["up"] = disc_radii()
    with np.errstate(over="ignore"):
        distance = float(np.minimum(np.float64(settings.ao_distance) * frame.unit, _LONGEST))
    row["shadow_scale"] = distance if distance >= _LEAST else 0.0
    write_pattern(row, settings.ambient_occlusion)
    return rows


class ResidentScene:
    """The buffers of a scene, for as long as it is drawn, and the tables of its frames. Each of those may be written while
    kernels run that do not read it.

    Parameters are those of `SceneDrawing`, and of_layers: features of the layers' program, None without one. Raises
    DeviceError if the scene does not fit into the device's memory.

    structs: of the kernels. extent: of the scene, None without faces. source: of its triangles. inputs: of the pixel stages,
    by name, all but those that a frame makes. faces: (F, 3). lights, casters: what the tables of a frame are made from;
    casters None where nothing casts shadows. map_colors: number of colors of the color map. nbytes: of device memory.
    places: where the next frames' pixels are sampled, see `Renderer.place_samples`.
    """

    def __init__(
        self,
        stages: Stages,
        scene: Scene,
        settings: Settings,
        features: Features,
        packed: Packed,
        of_layers: Features | None,
    ) -> None:
        self.stages, self.scene, self.settings, self.features = stages, scene, settings, features
        self.device, self.structs = stages.device, stages.structs
        self.places = sample_pattern.positions(settings.samples)
        scene_buffers.check_device(self.device, packed, self.structs)
        self.extent = Extent.of(packed.low, packed.high) if len(packed.faces) else None
        self.map_colors = 0 if packed.color_map is None else len(packed.color_map) - 4
        self.faces = Buffer(self.device, packed.faces)
        self.lights = LightTable(scene.lights, packed.light_unit, self.structs, settings.light_samples)
        self.inputs: dict[str, Any] = {"faces": self.faces, **self._surface(packed)}
        self.source, source_bytes = self._source_of(packed)
        self.nbytes = source_bytes + sum(each.array.nbytes for each in self.inputs.values() if each is not None)
        self.casters: Hierarchy | None = None
        if features["CASTERS"] or (of_layers is not None and of_layers["CASTERS"]):
            positions = packed.positions.astype(np.float64)
            veils = scene_buffers.faces_with(packed, "blends", "alpha_tested") if casts_alpha(self.scene) else None
            self.casters = Hierarchy(self.device, positions, packed.faces, lanes=self.stages.lanes, veils=veils)
            self.lights.shadow_factors = shadow_factors(self.scene.lights, self.casters.frame)
            self.nbytes += self.casters.nbytes
            self.inputs.update(self._shadow_inputs(self.casters))

    def _surface(self, packed: Packed) -> dict[str, Buffer | None]:
        arrays = {name: getattr(packed, name) for name in _TABLES}
        prefix = "" if packed.instances is None else "object_"
        arrays |= {prefix + name: getattr(packed, name) for name in _PLACED}
        arrays["colors"] = packed.colors if packed.corner_uvs is None else self._corner_colors(packed)
        if looks_up(self.features):
            arrays |= {"textures": packed.textures, "texels": packed.texels}
        arrays["materials"] = packed.materials
        return {name: None if array is None else Buffer(self.device, array) for name, array in arrays.items()}

    def _source_of(self, packed: Packed) -> tuple[TriangleSource, int]:
        """Return where the triangles come from, and the size of what stays of it."""
        positions = Buffer(self.device, packed.positions)
        sided = self.features["SIDES"]
        sides = {name: self.inputs[name] for name in NO_SIDES} if sided else NO_SIDES
        if packed.instances is None:
            return SceneFaces(self.stages, positions, self.faces, sides), positions.array.nbytes
        pixels, painter = math.prod(self.scene.camera.resolution), not self.features["DEPTH_TEST"]
        arguments = (self.stages, packed.instances, positions, self.faces, sides, pixels)
        instances = Instances(*arguments, painter=painter)
        return instances, positions.array.nbytes + instances.resident_bytes

    def _shadow_inputs(self, casters: Hierarchy) -> dict[str, Buffer]:
        every = casters.casters.array
        of_lights = every if self.settings.shadows else np.zeros_like(every)
        return {
            "shadow_vertices": casters.vertices,
            "shadow_nodes": casters.nodes,
            "shadow_leaves": casters.leaves,
            "shadow_casters": Buffer(self.device, np.concatenate([of_lights, every])),
            "shadow_lights": Buffer(self.device, shadow_lights(self.scene.lights, casters.frame)),
            "shadow_hemisphere": Buffer(self.device, hemisphere_row(self.settings, casters.frame, self.structs)),
        }

    def _corner_colors(self, packed: Packed) -> Array:
        """Return the (3F, 4) colors for texture_at vertex: the texel at each corner times the vertex color."""
        colors: Array = packed.colors  # type: ignore[assignment]
        rows = np.flatnonzero(packed.corner_textures >= 0)  # type: ignore[operator]
        looked_up = Buffer.empty(self.device, (len(rows), 4), self.structs.real)
        uvs = Buffer(self.device, packed.corner_uvs[rows])  # type: ignore[index]
        texture_of = Buffer(self.device, packed.corner_textures[rows])  # type: ignore[index]
        table = np.array(packed.textures)
        table["nearest"] = 0  # see `ignored`
        textures, texels = Buffer(self.device, table), Buffer(self.device, np.asarray(packed.texels))
        stages = lookup_stages(self.device, self.features, self.stages.lanes)
        values = {"uvs": uvs, "texture_of": texture_of, "textures": textures, "texels": texels, "colors": looked_up}
        stages.run("bilerp", stages.vectors(len(rows)), values, count=len(rows))
        colors[rows, :3] *= looked_up.to_host()[:, :3]
        return colors

    def new_tables(self) -> FrameTables:
        """Return tables of which nothing is written yet."""
        device, structs = self.device, self.structs
        rows = (structs.View, structs.Image, structs.ShadowView, structs.Counters)
        view, image, shadow_view, counters = (Buffer(device, np.zeros(1, kind)) for kind in rows)
        lights = Buffer(device, np.zeros_like(self.lights.table))
        return FrameTables(view, image, lights, shadow_view if self.casters else None, counters)

    def write_view(self, frame: SceneFrame) -> None:
        """Write what the projection reads, and set the counters to 0."""
        with frame.tables.view.writing(waits=False) as table:
            frame.space.write_view(table[0])
            table[0]["needs"] = self.features.needs
        with frame.counted.writing(waits=False) as table:
            table[:] = 0

    def write_image(self, frame: SceneFrame, room: int) -> None:
        """Write what setup and later stages read. room: entries that the tile lists have room for."""
        settings, background, real = self.settings, self.scene.background, self.structs.real
        columns, rows = resolution = frame.resolution
        first = frame.space.raster.first
        # Pixels below lines are written twice.
        streamed = frame.streams and columns % 4 == 0 and settings.edges is None
        known = resolution, first, room, streamed, self.places.tobytes()
        with frame.image.writing(waits=False) as table:
            image = table[0]
            image["unscale"] = shading_tables.to_real(np.float64(1.0) / frame.space.scale, real)
            image["to_eye"] = -frame.space.axes[2]
            around = self.scene.environment if self.features["BACKDROP"] else None
            if around is not None:
                _write_backdrop_rays(image, around, frame.space, real)
            if frame.tables.image_of == known:
                return
            frame.tables.image_of = None
            image["needs"] = self.features.needs
            image["columns"], image["rows"], image["first"] = columns, rows, first
            image["tiles_x"], image["tiles"] = -(-columns // struct_layout.TILE_SIZE), frame.tiles
            places = self.places << struct_layout.SUBPIXEL_BITS - struct_layout.SAMPLE_BITS
            image["samples"] = len(places)
            image["sample_x"][: len(places)], image["sample_y"][: len(places)] = places.T
            image["least"], image["most"] = places.min(axis=0), places.max(axis=0)
            image["lights"], image["list_capacity"] = self.lights.count, room
            image["streamed"] = streamed
            if settings.edges is not None:
                image["line_color"] = settings.edges.color
                image["marked_color"] = settings.edges.nonmanifold_color
            if around is not None:
                shading_tables.write_backdrop_size(image, around)
            image["map_colors"] = self.map_colors
            image["unlit"] = settings.shader == "nolight"
            image["transparent"] = background is None
            if background is not None:
                image["background"] = shading_tables.to_real(background, real)
            image["light_unit"] = self.lights.unit
            image["layer_alpha"] = shading_tables.to_real(np.float64(settings.layer_alpha), real)
        frame.tables.image_of = known

    def write_lights(self, frame: SceneFrame) -> None:
        """Write what only shading reads: lights and shadows, relative to the eye."""
        lights, casters = self.lights, self.casters
        if lights.count:
            rows = lights.rows(frame.space.camera.eye, frame.space.scale)
            with frame.tables.lights.writing(waits=False) as table:
                table[:] = rows
        if casters is not None and frame.tables.shadow_view is not None:
            with frame.tables.shadow_view.writing(waits=False) as table:
                write_shadow_view(table[0], frame.space, casters.frame)


def _write_backdrop_rays(image: np.void, environment: Environment, space: CameraSpace, real: type[np.floating]) -> None:
    """Fill a row of structs.Image with the rays through the image of a camera.

    A ray at u, v is proportional to (x, y, f) in camera space: x = (u - u0) W/(N focal), y = (v - v0) H/(M focal) and f = 1,
    all three divided by the largest x or y in the image if that is above 1. Rays of an orthographic camera are all
    parallel. u - u0 is taken in whole 1/256 px, exactly, so that x and y are accurate relative to themselves.
    """
    camera, raster = space.camera, space.raster
    steps = 1 << struct_layout.SAMPLE_BITS
    pixels, principal = np.array(raster.resolution, np.float64), np.array(raster.principal)
    center = np.clip(principal * pixels * steps, -float(_MOST_CENTER), float(_MOST_CENTER))
    whole = np.rint(center)
    with np.errstate(over="ignore"):
        pitch = np.minimum(np.array(raster.plane[::-1]) / (pixels * camera.focal), 1e150)
        largest = (np.maximum(np.abs(principal), np.abs(1.0 - principal)) * pixels * pitch).max()
    scale = 1.0 / max(1.0, min(float(largest), 1e300))
    step = np.zeros(2) if camera.orthographic else pitch * scale / steps
    forward = 1.0 if camera.orthographic else max(scale, _NARROWEST)
    image["ray_center"] = whole.astype(np.int32) - steps * np.array(raster.first, np.int32)
    image["ray_step"] = shading_tables.to_real(step, real)
    image["ray_offset"] = shading_tables.to_real((whole - principal * pixels * steps) * step, real)
    image["ray_axes"] = shading_tables.to_real(environment.axes @ space.axes.T * (1.0, 1.0, forward), real).reshape(-1)
