"""One wrapper per kernel: its arguments, its launch, its event."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pyopencl as cl

from ..errors import DeviceError
from . import host_projection, struct_layout
from .buffers import Buffer, TriangleBuffers, VertexBuffers, wait
from .features import Features, needs
from .opencl.device import Device
from .programs import Program, build, first_use
from .surface_inputs import SurfaceInputs

# Triangles and tile lists depend on few features, lighting on most: two programs, so that scenes share the first.
_GEOMETRY_FILES = ("project.cl", "setup.cl", "bin.cl", "layers.cl")
_GEOMETRY_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST", "INSTANCES")
_INSTANCES_FILE = "instances.cl"  # of the geometry too
_LINE_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST")
_LAYER_FEATURES = ("DOUBLE", "FAST", "SAMPLES", "INSTANCES", "CASTERS")
_WIDE = (1 << 16) - 1  # work-items in one dimension from which on PoCL compiles a separate kernel


@dataclass
class Chunks:
    """Chunks of triangles, or faces, each of which a work-item counts into the tiles and writes to their lists.

    count: number of triangles in all. size: of a chunk. number: of chunks. counts: (number, tiles + 1) entries of each
    tile, then where they begin. made: (number,) visible triangles of each, of setup_count.
    """

    count: int
    size: int
    number: int
    counts: Buffer
    made: Buffer


class Hiding(NamedTuple):
    """The triangles that hide lines, as the first arguments of the kernels in lines.cl: F faces and C clipped pieces.

    faces: (F, 3). vertices: of `project`. pieces: (C,). face_materials, materials: see Sides. ranks: (F,) in painter's
    order. view: one row of structs.View. face_count: F.
    """

    faces: Buffer
    vertices: Buffer
    pieces: Buffer
    face_materials: Buffer | None
    materials: Buffer | None
    ranks: Buffer | None
    view: Buffer
    face_count: int

    @property
    def triangles(self) -> int:
        """Number of faces and pieces."""
        return self.face_count + len(self.pieces.array)


class Placing(NamedTuple):
    """Where instances are drawn from one copy of their mesh.

    instances: (K,) of structs.Instance. listed: (K,) uint32, the first L are numbers of those to draw. vertex_starts,
    face_starts: (K + 1,) int64, of the first L + 1 the number of vertices, or faces, of all listed before.
    """

    instances: Buffer
    listed: Buffer
    vertex_starts: Buffer
    face_starts: Buffer


# face_materials and materials, if some material is drawn from the front only.
Sides = tuple[Buffer | None, Buffer | None]


def scene_stages(
    device: Device, features: Features, lanes: int | None = None, layers: Features | None = None
) -> Stages:
    """Return the stages that draw a scene; their programs are built unless they are cached. layers: features of the
    program of surface_layers.cl, None if it is not needed."""
    files = (*_GEOMETRY_FILES, _INSTANCES_FILE) if features["INSTANCES"] else _GEOMETRY_FILES
    geometry = build(device, features.compiled(_GEOMETRY_FEATURES), files)
    pixels = "pbr.cl" if features["PBR"] else "phong.cl" if features["PHONG"] else "gouraud.cl"
    programs = [build(device, features.compiled(), (pixels,), lanes=lanes)]
    if layers is not None:
        programs.append(build(device, layers.compiled(_LAYER_FEATURES), ("surface_layers.cl",), lanes=lanes))
    if features["LINES"] and device.has_fp64:
        programs.append(build(device, features.compiled(_LINE_FEATURES), ("lines.cl",), lanes=1))
    return Stages(device, *programs, geometry)


def lookup_stages(device: Device, features: Features, lanes: int | None = None) -> Stages:
    """Return the stages that look up textures at given coordinates."""
    return Stages(device, build(device, features.compiled(("FAST", "DOUBLE")), ("bilerp.cl",), lanes=lanes))


def stages_of(device: Device, name: str, lanes: int | None = None) -> Stages:
    """Return the stages of one kernel file alone, such as shadow.cl, which traces shadow rays by themselves."""
    return Stages(device, build(device, Features.of(), (name,), lanes=lanes))


class Stages:
    """The kernels of some programs on one device. Each method enqueues a kernel and returns its event.

    Array arguments are `Buffer`s; their element types and sizes are documented beside the kernels' arguments.
    The first program is that of the pixel stage and determines the lanes, the last one that of the geometry.
    """

    def __init__(self, device: Device, *programs: Program) -> None:
        self.device, self.lanes, self._features = device, programs[0].lanes, programs[-1].features
        self.pixel_features = programs[0].features
        self.structs = struct_layout.DOUBLE if self._features["DOUBLE"] else struct_layout.SINGLE
        self._programs = {name: program for program in programs for name in program.kernels}
        self._token = object()  # marks the kernels whose arguments these stages set last, to _set
        self._set: dict[str, tuple[Any, ...]] = {}

    @cached_property
    def _dummy(self) -> Buffer:
        """Stand-in for an argument that is None; made at the first launch, for programs may be built while a device is
        still being tested, and making a buffer enqueues commands."""
        return Buffer(self.device, np.zeros(64, np.uint8))

    def _launch(self, name: str, size: tuple[int, ...], local: tuple[int, ...] | None, *arguments: Any) -> cl.Event:
        program = self._programs[name]
        kernel = program[name]
        # PoCL compiles at the first launch with a local size, and again for a wide grid.
        code = name, local, max(size) >= _WIDE
        try:
            if code not in program.launched:
                return self._launch_first(program, code, size, self._raw(arguments))
            with program.lock:  # a kernel has one set of arguments, shared by all threads
                # Setting thirty arguments takes longer than a small kernel runs.
                asked = tuple(weakref.ref(each) if isinstance(each, Buffer) else each for each in arguments)
                if program.set_by.get(name) is not self._token or self._set.get(name) != asked:
                    program.set_by.pop(name, None)
                    kernel.set_args(*self._raw(arguments))
                    self._set[name] = asked
                    program.set_by[name] = self._token
                return cl.enqueue_nd_range_kernel(self.device.queue, kernel, size, local)
        except cl.Error as error:
            raise DeviceError(f"{self.device.name}: {name} did not start: {error}") from error

    def _raw(self, arguments: tuple[Any, ...]) -> list[Any]:
        """Return what pyopencl takes as a kernel's arguments."""
        return [
            argument.memory
            if isinstance(argument, Buffer)
            else self._dummy.memory
            if argument is None
            else argument
            if isinstance(argument, (np.floating, np.uint64))
            else np.int32(argument)
            for argument in arguments
        ]

    def _launch_first(
        self, program: Program, code: tuple[Any, ...], size: tuple[int, ...], raw: Sequence[Any]
    ) -> cl.Event:
        """Launch code that the runtime may have to compile or load first, and wait until it has run."""
        name, local, *_ = code
        with first_use(self.device, stored=program.stored) as use, program.lock:
            program.set_by.pop(name, None)
            program[name].set_args(*raw)
            event = cl.enqueue_nd_range_kernel(self.device.queue, program[name], size, local)
            event.wait()
            if self.device.profiling:
                use.ran = (event.profile.end - event.profile.start) * 1e-9
            program.launched.add(code)
        return event

    def _per_item(self, name: str, count: int, *arguments: Any, each: int = 1) -> cl.Event:
        """Launch a work-item for every `each` elements, in work-groups of 64."""
        return self._launch(name, (max(1, -(-count // (64 * each))) * 64,), (64,), *arguments, count)

    def _in_runs(self, name: str, count: int, run: int, *arguments: Any) -> cl.Event:
        """Launch a work-item for each run of elements, on a CPU in work-groups of its own."""
        local = 1 if self.device.is_cpu else 64
        return self._launch(name, (max(1, -(-count // (run * local))) * local,), (local,), *arguments)

    def _per_tile(self, name: str, tiles: int, *arguments: Any) -> cl.Event:
        """Launch a work-item for each tile, or where they have one lane, a work-group with one for each pixel."""
        items = 1 if self._programs[name].lanes > 1 else struct_layout.TILE_SIZE**2
        return self._launch(name, (tiles * items,), (items,), *arguments)

    def fused_lanes(self, given: Buffer, found: Buffer) -> cl.Event:
        return self._launch("fused_lanes", (1,), (1,), given, found)

    def hierarchy_keys(self, vertices: Buffer, faces: Buffer, keys: Buffer, index_bits: int, count: int) -> cl.Event:
        return self._per_item("hierarchy_keys", count, vertices, faces, keys, index_bits, each=16)

    def hierarchy_runs(
        self, vertices: Buffer, faces: Buffer, keys: Buffer, rows: Buffer, first: int, index_bits: int, count: int
    ) -> cl.Event:
        runs = -(-count // struct_layout.HIERARCHY_RUN)
        return self._launch("hierarchy_runs", (runs,), (1,), vertices, faces, keys, rows, first, index_bits, count)

    def hierarchy_leaves(
        self,
        vertices: Buffer,
        faces: Buffer,
        keys: Buffer,
        leaves: Buffer,
        nodes: Buffer,
        ends: tuple[int, int, int, int],
        index_bits: int,
    ) -> cl.Event:
        """ends: the first leaf and how many, the first node and the children of the lowest level's. index_bits: of the
        keys."""
        arguments = (vertices, faces, keys, leaves, nodes, *ends[:-1], index_bits, len(keys.array))
        return self._launch("hierarchy_leaves", (ends[-1],), (16,), *arguments)

    def hierarchy_level(self, nodes: Buffer, first: int, above: int, count: int, slots: int) -> cl.Event:
        """slots: children of the nodes in the level above, full or empty."""
        return self._launch("hierarchy_level", (slots,), (16,), nodes, first, above, count)

    def shadow_rays(
        self, points: Buffer, receivers: Buffer, casters: tuple[Buffer, ...], lights: Buffer, dark: Buffer, count: int
    ) -> cl.Event:
        """casters: vertices, faces, nodes, leaves, Casters."""
        arguments = (points, receivers, *casters[:4], lights, casters[4], dark)
        return self._in_runs("shadow_rays", count, self.lanes, *arguments, count)

    def shadow_fans(
        self, points: Buffer, receivers: Buffer, ends: Buffer, casters: tuple[Buffer, ...], dark: Buffer, w: float
    ) -> cl.Event:
        """ends: (K, 6, N) float32. casters: as of `shadow_rays`."""
        count, _, many = ends.array.shape
        arguments = (points, receivers, ends, *casters, dark, np.float32(w), many)
        return self._in_runs("shadow_fans", count, self.lanes, *arguments, count)

    def project(self, positions: Buffer, view: Buffer, vertices: VertexBuffers, count: int) -> cl.Event | None:
        """Project the vertices. On a device without float64 the host does it, and there is no event."""
        if self.device.has_fp64:
            return self._per_item("project", count, positions, view, vertices.projected, vertices.relative)
        orthographic = needs(view.array[0]["needs"], "ORTHOGRAPHIC")
        with vertices.projected.writing() as projected, vertices.relative.writing() as relative:
            host_projection.project(positions.array, view.array[0], orthographic, projected, relative)
        return None

    def setup(
        self,
        faces: Buffer,
        vertices: VertexBuffers,
        view: Buffer,
        image: Buffer,
        made: TriangleBuffers,
        counters: Buffer,
        count: int,
        sides: Sides = (None, None),
    ) -> cl.Event:
        means = None
        if not (self.device.has_fp64 or self._features["DEPTH_TEST"]):
            z = vertices.projected.array["depth"][faces.array]
            means = Buffer(self.device, ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)
        inputs = (faces, vertices.projected, *sides, means, view, image)
        outputs = (made.triangles, made.bounds, made.keys, made.to_clip, counters, made.index_bits)
        event = self._in_runs("setup", count, self.device.setup_run, *inputs, *outputs, count)
        if means is not None:
            wait(self.device, [event])  # `means` is freed on return
        return event

    def place(
        self, positions: Buffer, placing: Placing, view: Buffer, vertices: Buffer, block: tuple[int, int], count: int
    ) -> cl.Event:
        """Project the vertices, `count` in all, of a block of the listed instances: from the first to before the last."""
        run = self.device.setup_run
        inputs = (positions, placing.instances, placing.listed, placing.vertex_starts, view)
        return self._in_runs("place", count, run, *inputs, vertices, *block, run)

    def setup_instances(
        self,
        faces: Buffer,
        vertices: Buffer,
        placing: Placing,
        view: Buffer,
        image: Buffer,
        made: TriangleBuffers,
        counters: Buffer,
        of_triangles: tuple[Buffer, Buffer | None],
        block: tuple[int, int],
        count: int,
        sides: Sides = (None, None),
    ) -> cl.Event:
        """Set up the triangles of a block's faces, `count` in all. of_triangles: their instances, and with painter's order
        their mean depths."""
        run = self.device.setup_run
        inputs = (
            faces,
            vertices,
            *sides,
            placing.instances,
            placing.listed,
            placing.vertex_starts,
            placing.face_starts,
        )
        outputs = (made.triangles, made.bounds, made.keys, *of_triangles, made.to_clip, counters)
        arguments = (*inputs, view, image, *outputs, *block, run, len(made.to_clip.array), made.index_bits)
        return self._in_runs("setup_instances", count, run, *arguments)

    def setup_count(
        self,
        faces: Buffer,
        vertices: VertexBuffers,
        image: Buffer,
        made: TriangleBuffers,
        counters: Buffer,
        chunks: Chunks,
        sides: Sides = (None, None),
    ) -> cl.Event:
        """Set up the triangles of faces in their order, and count the entries of each tile."""
        inputs = (faces, vertices.projected, *sides, image)
        outputs = (made.triangles, made.bounds, chunks.made, chunks.counts, made.to_clip, counters)
        return self._launch("setup_count", (chunks.number,), (1,), *inputs, *outputs, chunks.size, chunks.count)

    def setup_pieces(
        self,
        pieces: Buffer,
        image: Buffer,
        made: TriangleBuffers,
        counters: Buffer,
        face_count: int,
        count: int,
        sides: Sides = (None, None),
    ) -> cl.Event:
        inputs = (pieces, *sides, image)
        outputs = (made.triangles, made.bounds, made.keys, counters)
        each = self._programs["setup_pieces"].lanes
        return self._per_item("setup_pieces", count, *inputs, *outputs, face_count, made.index_bits, each=each)

    def bin_count(self, order: Buffer, made: TriangleBuffers, image: Buffer, chunks: Chunks) -> cl.Event:
        arguments = (order, made.triangles, made.bounds, image, made.sorted_bounds, chunks.counts)
        return self._launch("bin_count", (chunks.number,), (1,), *arguments, chunks.size, chunks.count)

    def bin_sums(self, image: Buffer, chunks: Chunks, sums: Buffer) -> cl.Event:
        return self._launch("bin_sums", sums.array.shape, (1,), image, chunks.counts, sums, chunks.number)

    def bin_scan(
        self, image: Buffer, sums: Buffer, chunks: Chunks, starts: Buffer, counters: Buffer, stops_to_clip: bool
    ) -> cl.Event:
        """Find where the lists begin. stops_to_clip: whether nothing is drawn if there are faces to clip."""
        arguments = (image, sums, chunks.counts, starts, counters, chunks.number, stops_to_clip)
        return self._launch("bin_scan", sums.array.shape, (1,), *arguments)

    def bin_fill(
        self, order: Buffer, made: TriangleBuffers, image: Buffer, chunks: Chunks, lists: Buffer, counters: Buffer
    ) -> cl.Event:
        arguments = (order, made.triangles, image, made.sorted_bounds, chunks.counts, lists, counters)
        return self._launch("bin_fill", (chunks.number,), (1,), *arguments, chunks.size, chunks.count)

    def fill_lists(
        self, made: TriangleBuffers, image: Buffer, chunks: Chunks, lists: Buffer, counters: Buffer
    ) -> cl.Event:
        """Write the lists in the order of `setup_count`."""
        arguments = (made.triangles, image, made.bounds, chunks.made, chunks.counts, lists, counters)
        return self._launch("fill_lists", (chunks.number,), (1,), *arguments, chunks.size)

    def _surface(self, surface: SurfaceInputs) -> tuple[Buffer | None, ...]:
        return self._inputs(surface, self.pixel_features)

    def _inputs(self, surface: SurfaceInputs, features: Features) -> tuple[Buffer | None, ...]:
        casters, instances = bool(features["CASTERS"]), bool(features["INSTANCES"])
        return surface.arguments(casters=casters, instances=instances)

    def gouraud_corners(self, surface: SurfaceInputs, order: Buffer, corner_light: Buffer, count: int) -> cl.Event:
        items = -(-count // self.lanes)
        return self._launch("gouraud_corners", (items,), (1,), *self._surface(surface), order, corner_light, count)

    def shade(self, name: str, surface: SurfaceInputs, tile: tuple[Any, ...], tiles: int) -> cl.Event:
        """Light the pixels. name: phong, pbr or gouraud."""
        arguments = (*self._surface(surface), *tile)
        if self.lanes > 1:
            return self._launch(name, (4 * self.device.compute_units,), (1,), *arguments)
        return self._per_tile(name, tiles, *arguments)

    def bilerp(
        self, uvs: Buffer, texture_of: Buffer, textures: Buffer, texels: Buffer, colors: Buffer, count: int
    ) -> cl.Event:
        items = -(-count // self.lanes)
        return self._launch("bilerp", (items,), (1,), uvs, texture_of, textures, texels, colors, count)

    def light(
        self,
        points: Buffer,
        normals: Buffer,
        colors: Buffer,
        materials: Buffer,
        lights: Buffer,
        needed: int,
        lit: Buffer,
        unit: float,
        light_count: int,
        count: int,
    ) -> cl.Event:
        """needed: as the member `needs` of structs.Image."""
        items = -(-count // self.lanes)
        inputs = (points, normals, colors, materials, lights, np.uint64(needed))
        return self._launch("light", (items,), (1,), *inputs, lit, self.structs.real(unit), light_count, count)

    def layer_of_owners(self, kernel: str, count: int, owners: Buffer, *tables: Buffer | None) -> cl.Event:
        """Draw a layer that the owning triangles tell. kernel: layer_id, layer_number, or one of instances; the last of
        its tables is the layer."""
        return self._per_item(kernel, count, owners, *tables)

    def layer_z(self, owners: Buffer, triangles: Buffer, image: Buffer, depths: Buffer, tiles: int) -> cl.Event:
        return self._per_tile("layer_z", tiles, owners, triangles, image, depths)

    def surface_layers(
        self,
        surface: SurfaceInputs,
        owners: Buffer,
        own: tuple[Buffer | None, Buffer | None],
        outputs: Sequence[Buffer | None],
        asked: int,
        tiles: int,
    ) -> cl.Event:
        """Draw layers. own: mirrored and scalars of `LayerTables`. outputs: those of SURFACE_LAYERS, None if not asked for.
        asked: `LayerTables.asked`."""
        inputs = self._inputs(surface, self._programs["surface_layers"].features)
        return self._per_tile("surface_layers", tiles, *inputs, owners, *own, *outputs, asked)

    def list_hiders(self, hiding: Hiding, grid: Buffer, cursors: Buffer, hiders: Buffer | None) -> cl.Event:
        """Write the lists of triangles per cell, or only count (`hiders` None)."""
        return self._per_item("list_hiders", hiding.triangles, *hiding, grid, cursors, hiders, hiders is not None)

    def list_lines(self, lines: Buffer, grid: Buffer, cursors: Buffer, listed: Buffer | None, count: int) -> cl.Event:
        """Write the lists of lines per cell, or only count (`listed` None)."""
        return self._per_item("list_lines", count, lines, grid, cursors, listed, listed is not None)

    def line_samples(
        self, hiding: Hiding, image: Buffer, grid: Buffer, lists: tuple[Buffer, ...], shown: Buffer, cells: int
    ) -> cl.Event:
        """Find the samples that show lines. lists: the lines, the faces of edges, and the lists of `cells` cells."""
        items = 1 if self.device.is_cpu else 64
        return self._launch("line_samples", (cells * items,), (items,), *hiding, image, grid, *lists, shown)
