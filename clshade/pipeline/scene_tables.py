"""A scene as arrays: on the host, then on the device for as long as it is drawn; and the tables that the host writes for
each frame."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..base import host_memory
from ..base.arrays import Array, Bools, Floats
from ..errors import DeviceError, InputError
from ..scene.environment import Environment
from ..scene.geometry import half_diagonal
from ..scene.model import Scene, Settings
from . import struct_layout
from .buffers import Buffer
from .camera_space import CameraSpace, Extent, sample_positions
from .features import Features, casts_alpha, derive, looked_up_at_corners, looks_up
from .gather import Gatherer
from .hierarchy import Hierarchy, hemisphere_row, shadow_lights, write_shadow_view
from .launches import FrameInFlight, Stages, stages_of
from .layers import LayerTables, layer_tables
from .light_points import LightTable
from .shading_tables import backdrop_table, environment_tables, texture_tables, to_real, write_backdrop_size
from .triangle_source import (
    Instances,
    InstanceTables,
    TriangleSource,
    draws_from_one_copy,
    instance_tables,
    placed_extent,
)

MOST_VERTICES = (1 << 31) - 1  # faces name them by int32
_LEAST_ROW = 12  # bytes: three float32 of a vertex, three int32 of a face
_NARROWEST = 2.0**-40  # of the viewing direction's part of a ray: the part across the image is at most 1
_MOST_CENTER = 1 << 30  # 1/256 px


@dataclass(frozen=True)
class Packed:
    """A scene as arrays on the host.

    arrays: those that stay on the device, by the names of the kernels' parameters, see `Inputs` of kernels/surface.clh; and
    positions, (V, 3) world space, float32 or float64. Those that the features leave out are missing. With `instances`
    positions are float64, in object space, and F and V count each mesh once.
    """

    scene: Scene
    settings: Settings
    features: Features  # that these imply
    arrays: Mapping[str, Array]
    corner_lookups: Mapping[str, Array]  # of bilerp with texture_at vertex: by corner, none where texture_of is -1
    low: Floats  # (3,), of the bounding box of the vertices in use
    high: Floats
    light_unit: float  # see `light_unit`; tinted ambient light is expressed in it too
    layers: LayerTables  # further inputs of layers
    instances: InstanceTables | None  # where they are drawn from one copy of their mesh

    def faces_with(self, *members: str) -> Bools:
        """Return which faces have a material with any of some members set, (F,) bool."""
        rows = np.any([self.arrays["materials"][name] != 0 for name in members], axis=0)
        return np.broadcast_to(rows[self.arrays.get("face_materials", 0)], len(self.arrays["faces"]))


def pack(scene: Scene, settings: Settings, *, forced: Collection[str] = frozenset(), has_fp64: bool = True) -> Packed:
    """Return what a render of `scene` under `settings` needs. forced: see `Drawn`. has_fp64: whether the device has float64,
    without which instances are copies. Raises InputError as `check_host`."""
    one_copy = has_fp64 and draws_from_one_copy(scene, settings, forced)
    if not one_copy:
        check_host(scene)
    gatherer = Gatherer(scene, settings, forced, one_copy=one_copy)
    source, scene, structs = (scene, settings), gatherer.scene, gatherer.structs
    positions, faces = gatherer.positions()
    corners = gatherer.scalars is not None and gatherer.scalars.at_corners
    how = {"double_positions": positions.dtype == np.float64, "scalars_at_corners": corners, "instanced": one_copy}
    features = derive(scene, settings, **how, forced=forced)
    double = features["DOUBLE_POSITIONS"] or one_copy
    positions = positions.astype(np.float64 if double else np.float32, copy=False)
    low, high = (positions.min(axis=0), positions.max(axis=0)) if len(positions) else (np.zeros(3), np.zeros(3))
    low, high = placed_extent(gatherer.placed) if one_copy else (low.astype(np.float64), high.astype(np.float64))
    unit, at_corners = gatherer.light_unit(half_diagonal(low, high)), looked_up_at_corners(scene, settings)
    arrays, lookups = {"positions": positions, "faces": faces}, dict[str, Array]()
    arrays["materials"] = gatherer.material_table(unit if features["TINTED"] else 1.0, at_corners)
    if len(faces):
        arrays |= _of_vertices(gatherer, features)
        if at_corners or (looks_up(features) and gatherer.textures):
            # The layer uv shows those of meshes without a texture too: with UV_SETS both tables have as many rows.
            untextured = bool(features["UV_SETS"]) and "uv" in settings.layers
            arrays |= gatherer.uvs(bool(features["UV_INDICES"]), untextured=untextured)
            rows = len(arrays["uvs"]) // gatherer.uv_sets
            tables = texture_tables(gatherer.textures, mipmaps=settings.texture_filter == "trilinear", uv_rows=rows)
            lookups = dict(zip(("textures", "texels"), tables, strict=True))
        if looks_up(features):
            arrays |= lookups
        if at_corners:
            looked_up = arrays["uvs"][arrays.get("uv_faces", faces).reshape(-1)]
            lookups = {**lookups, "uvs": looked_up, "texture_of": np.repeat(gatherer.face_textures(), 3)}
    if features["ENVIRONMENT"]:
        arrays["environment"], arrays["radiance"] = environment_tables(scene.environment, unit, structs)
    if features["BACKDROP"] and scene.environment is not None:
        arrays["backdrop"] = backdrop_table(scene.environment, structs)
    instances = instance_tables(gatherer, structs) if one_copy else None
    layers = layer_tables(gatherer, *source, features)
    return Packed(*source, features, arrays, lookups if at_corners else {}, low, high, unit, layers, instances)


def _of_vertices(gatherer: Gatherer, features: Features) -> dict[str, Array]:
    """Return the arrays of normals, tangents, colors, alphas and materials."""
    arrays: dict[str, Array] = {}
    if features.needs_any("TERMS"):
        arrays |= gatherer.normals(bool(features["NORMAL_INDICES"]), bends=bool(features["SHADOWS"]))
    if features["NORMAL_MAP"]:
        arrays |= gatherer.tangents()
    if features["VERTEX_COLORS"] or features["CORNER_COLORS"]:
        arrays["colors"] = gatherer.colors(bool(features["CORNER_COLORS"]))
    if features["SCALARS"]:
        arrays["color_map"] = gatherer.color_map()
    if features["VERTEX_ALPHA"]:
        arrays["alphas"] = gatherer.alphas()
    if features["MATERIALS"] or features["SIDES"]:
        arrays["face_materials"] = gatherer.face_materials()
    return arrays


def check_host(scene: Scene) -> None:
    """Refuse a scene whose placed meshes have too many vertices, or do not fit into this machine's memory. Raises
    InputError."""
    placed = [(mesh, len(np.asarray(mesh.instances))) for mesh in scene.meshes]
    vertices = sum(len(mesh.verts) * count for mesh, count in placed)
    if vertices > MOST_VERTICES:
        limit = f"at most {MOST_VERTICES} vertices with instances"
        raise InputError(f"render: scene: expected {limit}, found {vertices}")
    copied = sum(_LEAST_ROW * (len(mesh.verts) + len(mesh.faces)) * count for mesh, count in placed if count > 1)
    host_memory.require("render", "scene", copied, f"{scene.face_count:,} triangles with instances")


class ResidentScene:
    """The buffers of a scene, for as long as it is drawn, and the tables of its frames. Each of those may be written while
    kernels run that do not read it.

    features: of the kernels. of_layers: of the layers' program, None without one. Raises DeviceError if the scene does not
    fit into the device's memory.

    extent: of the scene, None without faces. source: of its triangles. inputs: of the pixel stages, by name, all but those
    that a frame makes. casters: None where nothing casts shadows. nbytes: of device memory. places: where the next frames'
    pixels are sampled, see `Renderer.place_samples`.
    """

    def __init__(self, stages: Stages, packed: Packed, features: Features, of_layers: Features | None) -> None:
        self._stages, self._features, self._device, self._structs = stages, features, stages.device, stages.structs
        self._scene, self._settings = scene, settings = packed.scene, packed.settings
        self._check_memory(packed)
        self.places = sample_positions(settings.samples)
        # By tables of images, what they were written for.
        self._written = WeakKeyDictionary[Buffer, tuple[object, ...]]()
        self.extent = Extent.of(packed.low, packed.high) if len(packed.arrays["faces"]) else None
        self._map_colors = len(packed.arrays.get("color_map", range(4))) - 4
        self._lights = LightTable(scene.lights, packed.light_unit, self._structs, settings.light_samples)
        if packed.corner_lookups:
            self._color_corners(packed.arrays["colors"], packed.corner_lookups)
        buffers = {name: Buffer(self._device, array) for name, array in packed.arrays.items()}
        self.nbytes = sum(buffer.array.nbytes for buffer in buffers.values())
        positions = buffers.pop("positions")
        self.inputs = struct_layout.surface_inputs(**buffers)
        self.source: TriangleSource
        if packed.instances is None:
            self.source = TriangleSource(stages, positions, buffers["faces"])
        else:
            pixels = math.prod(scene.camera.resolution)
            self.source = Instances(stages, packed.instances, positions, buffers["faces"], pixels)
            self.nbytes += self.source.resident_bytes
        self.casters: Hierarchy | None = None
        if features["CASTERS"] or (of_layers is not None and of_layers["CASTERS"]):
            veils = packed.faces_with("blends", "alpha_tested") if casts_alpha(scene) else None
            vertices = packed.arrays["positions"].astype(np.float64)
            self.casters = Hierarchy(self._device, vertices, packed.arrays["faces"], lanes=stages.lanes, veils=veils)
            self.nbytes += self.casters.nbytes
            self.inputs.update(self._shadow_inputs(self.casters))

    def _check_memory(self, packed: Packed) -> None:
        """Refuse a scene that does not fit into the device's memory. Raises DeviceError.

        A CPU commits memory as it is written: there, buffers of which a frame may write little do not count.
        """
        device, structs = self._device, self._structs
        tables = {id(table): table for table in (*packed.arrays.values(), *packed.corner_lookups.values())}
        faces, vertices = len(packed.arrays["faces"]), len(packed.arrays["positions"])
        needed = sum(table.nbytes for table in tables.values())
        needed += 0 if packed.instances is None else packed.instances.rows.nbytes
        needed += vertices * (structs.Vertex.itemsize + 4 * np.dtype(structs.real).itemsize)
        if not device.is_cpu:
            needed += faces * (structs.Triangle.itemsize + structs.Bounds.itemsize + np.dtype(np.int32).itemsize)
        if needed > device.memory:
            what = f"{faces:,} triangles and {vertices:,} vertices take {needed / host_memory.GIB:.1f} GiB or more"
            raise DeviceError(f"{device.name}: {what}, the device has {device.memory / host_memory.GIB:.1f} GiB")

    def _shadow_inputs(self, casters: Hierarchy) -> dict[str, Buffer]:
        trees = casters.casters.array
        of_lights = trees if self._settings.shadows else np.zeros_like(trees)
        rows, self._lights.shadow_factors = shadow_lights(self._scene.lights, casters.frame)
        hemisphere = hemisphere_row(self._settings, casters.frame, self._structs)
        tables = {"casters": np.concatenate([of_lights, trees]), "lights": rows, "hemisphere": hemisphere}
        arrays = {"vertices": casters.vertices, "nodes": casters.nodes, "leaves": casters.leaves}
        arrays |= {name: Buffer(self._device, table) for name, table in tables.items()}
        return {f"shadow_{name}": buffer for name, buffer in arrays.items()}

    def _color_corners(self, colors: Array, lookups: Mapping[str, Array]) -> None:
        """Multiply the (3F, 4) colors for texture_at vertex by the texel at each corner."""
        rows = np.flatnonzero(lookups["texture_of"] >= 0)
        textures = np.array(lookups["textures"])
        textures["nearest"] = 0  # see `ignored`
        arrays = {"textures": textures, **{name: lookups[name][rows] for name in ("uvs", "texture_of")}}
        values = {name: Buffer(self._device, array) for name, array in {**lookups, **arrays}.items()}
        looked_up = Buffer.empty(self._device, (len(rows), 4), self._structs.real)
        stages = stages_of(self._device, "bilerp.cl", self._stages.lanes, self._features.compiled(("DOUBLE",)))
        stages.run("bilerp", stages.vectors(len(rows)), values, colors=looked_up, count=len(rows))
        colors[rows, :3] *= looked_up.to_host()[:, :3]

    def new_tables(self) -> dict[str, Buffer]:
        """Return what the host writes for a frame, and what its kernels count, by the names of their parameters; nothing is
        written yet. With two of these the host writes one while kernels use the other."""
        structs, lights = self._structs, Buffer(self._device, np.zeros_like(self._lights.table))
        kinds = {"view": structs.View, "image": structs.Image, "counters": structs.Counters}
        kinds |= {"shadow_view": structs.ShadowView} if self.casters is not None else {}
        return {"lights": lights, **{name: Buffer(self._device, np.zeros(1, kind)) for name, kind in kinds.items()}}

    def write_view(self, frame: FrameInFlight) -> None:
        """Write what the projection reads, and set the counters to 0."""
        with frame.values["view"].writing(waits=False) as table:
            frame.space.write_view(table[0])
            table[0]["needs"] = self._features.needs
        with frame.values["counters"].writing(waits=False) as table:
            table[:] = 0

    def write_image(self, frame: FrameInFlight, room: int) -> None:
        """Write what setup and later stages read. room: entries that the tile lists have room for."""
        settings, background, real = self._settings, self._scene.background, self._structs.real
        columns, rows = resolution = frame.resolution
        first = frame.space.raster.first
        streamed = frame.streams and columns % 4 == 0
        key = resolution, first, room, streamed, self.places.tobytes()
        with frame.values["image"].writing(waits=False) as table:
            image = table[0]
            image["unscale"] = to_real(1.0 / frame.space.scale, real)
            image["to_eye"] = -frame.space.axes[2]
            around = self._scene.environment if self._features["BACKDROP"] else None
            if around is not None:
                _write_backdrop_rays(image, around, frame.space, real)
            if self._written.get(frame.values["image"]) == key:
                return
            self._written.pop(frame.values["image"], None)
            image["needs"] = self._features.needs
            image["columns"], image["rows"], image["first"] = columns, rows, first
            image["tiles_x"], image["tiles"] = -(-columns // struct_layout.TILE_SIZE), frame.tiles
            places = self.places << struct_layout.SUBPIXEL_BITS - struct_layout.SAMPLE_BITS
            image["samples"] = len(places)
            image["sample_x"][: len(places)], image["sample_y"][: len(places)] = places.T
            image["least"], image["most"] = places.min(axis=0), places.max(axis=0)
            image["lights"], image["light_unit"] = self._lights.count, self._lights.unit
            image["list_capacity"], image["streamed"] = room, streamed
            if settings.edges is not None:
                image["line_color"] = settings.edges.color
                image["marked_color"] = settings.edges.nonmanifold_color
            if around is not None:
                write_backdrop_size(image, around)
            image["map_colors"] = self._map_colors
            image["unlit"] = settings.shader == "nolight"
            image["transparent"] = background is None
            if background is not None:
                image["background"] = to_real(background, real)
            image["layer_alpha"] = to_real(settings.layer_alpha, real)
        self._written[frame.values["image"]] = key

    def write_lights(self, frame: FrameInFlight) -> None:
        """Write what only shading reads: lights and shadows, relative to the eye."""
        if self._lights.count:
            rows = self._lights.rows(frame.space.camera.eye, frame.space.scale)
            with frame.values["lights"].writing(waits=False) as table:
                table[:] = rows
        if self.casters is not None:
            with frame.values["shadow_view"].writing(waits=False) as table:
                write_shadow_view(table[0], frame.space, self.casters.frame)


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
    rounded = np.rint(center)
    with np.errstate(over="ignore"):
        pitch = np.minimum(np.array(raster.plane[::-1]) / (pixels * camera.focal), 1e150)
        largest = (np.maximum(np.abs(principal), np.abs(1.0 - principal)) * pixels * pitch).max()
    scale = 1.0 / max(1.0, min(float(largest), 1e300))
    step = np.zeros(2) if camera.orthographic else pitch * scale / steps
    forward = 1.0 if camera.orthographic else max(scale, _NARROWEST)
    image["ray_center"] = rounded.astype(np.int32) - steps * np.array(raster.first, np.int32)
    image["ray_step"] = to_real(step, real)
    image["ray_offset"] = to_real((rounded - principal * pixels * steps) * step, real)
    image["ray_axes"] = to_real(environment.axes @ space.axes.T * (1.0, 1.0, forward), real).reshape(-1)
