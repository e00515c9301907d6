"""Kernels on given arrays: feature masks by keyword, probes of single device functions, and single stages."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl

from clshade.oracle import transform
from clshade.pipeline import struct_layout
from clshade.pipeline.buffers import Buffer, TriangleBuffers, VertexBuffers
from clshade.pipeline.draw import front_to_back
from clshade.pipeline.features import FEATURES, Features
from clshade.pipeline.launches import Stages
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.programs import build
from clshade.pipeline.triangle_source import TriangleSource
from clshade.scene.camera import Camera

LANES = (1, 4, 8, 16)
Array = np.ndarray


def mask(**overrides: int) -> Features:
    """Return features that are all 0 except those named and SORTED."""
    overrides = {"SORTED": 1, **overrides}
    unknown = set(overrides) - set(FEATURES)
    assert not unknown, f"no such feature: {unknown}"
    return Features.of([name for name, value in overrides.items() if value])


def bits(array: Array) -> Array:
    """Return the bits of a float32 array, so that comparisons distinguish signed zeros and NaNs."""
    return np.ascontiguousarray(array, np.float32).view(np.uint32)


def float32(values: Any) -> Array:
    return np.asarray(values, np.float32)


def split(values: Array) -> tuple[Array, Array]:
    """Split float64 into double-single: the rounded value and the remainder."""
    with np.errstate(over="ignore", invalid="ignore"):
        high = float32(values)
        return high, float32(np.asarray(values, np.float64) - high)


class Probe:
    """Short kernels in OpenCL C that call device functions of the kernel files they include.

    Each kernel takes pointers only: inputs, then one output of the first input's length, each (K,) or (K, width).
    A work-item handles LANES elements; arrays are padded with copies of their last row.
    """

    def __init__(self, device: Device, text: str, *, lanes: int | None = None, **features: int) -> None:
        self._device, self._program = device, build(device, mask(**features), text, lanes=lanes)

    def __call__(self, name: str, *inputs: Array, width: int | None = None, dtype: Any = np.float32) -> Array:
        """Run a kernel; return its output, (K,) or, with a width, (K, width)."""
        count = len(inputs[0])
        padded = [np.concatenate([a, np.repeat(a[-1:], -len(a) % 16, axis=0)]) for a in inputs]
        out = Buffer(self._device, np.zeros((len(padded[0]),) if width is None else (len(padded[0]), width), dtype))
        buffers = [*(Buffer(self._device, a) for a in padded), out]
        kernel = self._program[name]
        kernel.set_args(*(buffer.memory for buffer in buffers))
        cl.enqueue_nd_range_kernel(self._device.queue, kernel, (len(padded[0]) // self._program.lanes,), (1,))
        return out.to_host()[:count].copy()


def boxes_of(bounds: Array) -> Array:
    """Return first column, first row, last column, last row (T, 4) of struct_layout.SINGLE.Bounds rows."""
    return (bounds["box"][:, None] >> np.array([0, 16, 32, 48], np.uint64) & np.uint64(0xFFFF)).astype(np.int64)


def view_of(device: Device, camera: Camera, near: float, scale: float = 1.0, **features: int) -> Buffer:
    """Return the struct_layout.SINGLE.View of a camera, with the oracle's axes."""
    view = np.zeros(1, struct_layout.SINGLE.View)
    view["needs"] = mask(ORTHOGRAPHIC=camera.orthographic, **features).needs
    view["eye"], view["focal"], view["principal"] = camera.eye, camera.focal, camera.principal
    view["axes"] = transform.camera_frame(camera).reshape(-1)
    view["plane_height"], view["plane_width"] = camera.plane
    view["columns"], view["rows"] = camera.resolution
    view["near"], view["scale"] = near, scale
    return Buffer(device, view)


def image_of(
    device: Device, resolution: tuple[int, int], structs: struct_layout.Structs = struct_layout.SINGLE, **fields: Any
) -> Buffer:
    """Return the structs.Image of a resolution (N, M); `fields` set its other members."""
    image = np.zeros(1, structs.Image)
    image["light_unit"] = 1.0
    columns, rows = resolution
    image["columns"], image["rows"] = columns, rows
    image["tiles_x"] = -(-columns // struct_layout.TILE_SIZE)
    image["tiles"] = image["tiles_x"] * -(-rows // struct_layout.TILE_SIZE)
    image["unscale"] = 1.0
    for name, value in fields.items():
        image[name] = value
    return Buffer(device, image)


def project(device: Device, positions: Array, camera: Camera, near: float, scale: float = 1.0) -> VertexBuffers:
    """Run the stage `project` on world positions (V, 3), float32 or float64."""
    stages = Stages(device, build(device, mask(), ("project.cl",)))
    source = TriangleSource(stages, Buffer(device, positions), Buffer(device, np.zeros((1, 3), np.int32)))
    view = view_of(device, camera, near, scale, DOUBLE_POSITIONS=positions.dtype == np.float64)
    source.project(SimpleNamespace(values={"view": view}, events={}))
    source.vertices.projected.to_host()
    source.vertices.relative.to_host()
    return source.vertices


def samples_at(places: Array) -> dict[str, Any]:
    """Return the members of structs.Image that define the sample positions (S, 2), in 1/256 px."""
    kept = np.zeros((2, struct_layout.MOST_SAMPLES), np.int32)
    snapped = places << struct_layout.SUBPIXEL_BITS - struct_layout.SAMPLE_BITS
    kept[:, : len(places)] = snapped.T
    rest = {"least": snapped.min(axis=0), "most": snapped.max(axis=0)}
    return {"samples": len(places), "sample_x": kept[0], "sample_y": kept[1], **rest}


def vertices_at(
    device: Device,
    xy: Array,
    z: Array,
    relative: Array | None = None,
    *,
    structs: struct_layout.Structs = struct_layout.SINGLE,
    orthographic: bool = False,
) -> VertexBuffers:
    """Return vertices in the form that `project` writes.

    xy: snapped positions (V, 2). z: depths (V,). relative: positions (V, 3) relative to the eye.
    """
    projected = np.zeros(len(z), structs.Vertex)
    projected["x"], projected["y"] = np.asarray(xy).T
    projected["depth"] = z
    depth = np.minimum(z, struct_layout.MOST_DEPTH)
    with np.errstate(divide="ignore", over="ignore"):
        w = -depth if orthographic else 1.0 / depth
        projected["w"], projected["w_low"] = split(w) if structs is struct_layout.SINGLE else (w, 0.0)
    made = VertexBuffers(device, 0)
    made.projected = Buffer(device, projected)
    made.relative = Buffer(device, four(np.zeros((len(z), 3)) if relative is None else relative).astype(structs.real))
    return made


class Pipeline:
    """The stages from `setup` on. Each method runs one and keeps its buffers for the next.

    resolution: (N, M). image: further members of the struct Image.
    """

    def __init__(
        self, device: Device, resolution: tuple[int, int], *, image: dict[str, Any] | None = None, **features: int
    ) -> None:
        self.device, self.features = device, mask(OWNERS=1, **features)
        self.stages = Stages(device, build(device, self.features, ("setup.cl", "bin.cl", "gouraud.cl")))
        self.resolution, self.structs = resolution, self.stages.structs
        self.image = image_of(device, resolution, self.structs, needs=self.features.needs, **(image or {}))
        self.tiles = int(self.image.array["tiles"][0])

    def set_up(self, vertices: VertexBuffers, faces: Array, near: float = 0.0) -> Any:
        """Run `setup`; return the counters."""
        self.vertices, self.faces = vertices, Buffer(self.device, np.asarray(faces, np.int32))
        source = TriangleSource(self.stages, Buffer.empty(self.device, 0, np.float32), self.faces)
        source.vertices = vertices
        source.made = self.made = TriangleBuffers(self.device, len(faces), 0, self.structs)
        self.counted = Buffer(self.device, np.zeros(1, self.structs.Counters))
        with vertices.projected.writing() as rows:
            rows["w"][rows["depth"] < near] = 0.0  # as project leaves it
        self.frame = {"image": self.image, "counters": self.counted}
        values = {**self.frame, "vertices": vertices.projected, "faces": self.faces}
        values |= {"face_materials": None, "materials": None}
        source.set_up(SimpleNamespace(values=values, events={}))
        self.counters = self.counted.to_host()[0].copy()
        self.visible = int(self.counters["visible"])
        return self.counters

    def set_up_apart(self, xy: Array, z: Array, near: float = 0.0, **vertices: Any) -> Any:
        """Run `setup` on triangles without shared vertices: snapped xy (F, 3, 2), depths z (F, 3). vertices: as of
        `vertices_at`."""
        made = vertices_at(self.device, xy.reshape(-1, 2), z.reshape(-1), structs=self.structs, **vertices)
        return self.set_up(made, np.arange(z.size).reshape(-1, 3), near)

    def sort(self, exact: Any = None) -> Array:
        """Return the visible triangles, nearest first, sorted by the keys of `setup`."""
        order = front_to_back(self.made.keys.to_host(self.visible).copy(), exact)
        return self.ordered(order)

    def ordered(self, order: Array) -> Array:
        """Make the following stages take the triangles in this order."""
        self.visible = len(order)
        self.order = Buffer(self.device, np.asarray(order, np.uint32))
        return order

    def bin(self, chunk: int | None = None, parts: int = 1, room: int | None = None) -> list[Array]:
        """Fill the tile lists, `chunk` triangles at a time; return the triangles of each tile.

        parts: work-items of the scan. room: capacity of the lists in entries, by default as many as there are.
        """
        chunk = chunk or max(self.visible, 1)
        chunks = -(-self.visible // chunk)
        if not self.visible:
            self.starts = Buffer(self.device, np.zeros(self.tiles + 1, np.uint32))
            self.lists = Buffer.empty(self.device, 0, self.structs.Entry)
            return [np.zeros(0, np.int32)] * self.tiles
        # Prior contents of memory must not matter, and empty tiles add to the count so far.
        counts = self.counts = Buffer(self.device, np.full((chunks, self.tiles), 7, np.uint32))
        values = {**self.made.values, **self.frame, "order": self.order, "sorted": self.made.sorted_bounds}
        values |= {"count": self.visible, "chunk_size": chunk, "chunks": chunks, "counts": counts, "cursors": counts}
        run = self.stages.run
        empty = int(self.counted.to_host()["empty_tiles"][0])
        run("bin_count", (chunks, 1), values)
        table = counts.to_host().copy()
        self.starts = Buffer(self.device, np.full(self.tiles + 1, 7, np.uint32))
        sums = Buffer(self.device, np.full(parts, 7, np.uint64))
        if parts > 1:
            run("bin_sums", (parts, 1), values, sums=sums)
        run("bin_scan", (parts, 1), values, sums=sums, starts=self.starts, stops_to_clip=False)
        # Ordered by tile, then by chunk, each begins where the previous one ends.
        begin = np.cumsum(np.concatenate([[0], table.T.reshape(-1)]))
        assert np.array_equal(counts.to_host(), begin[:-1].reshape(self.tiles, chunks).T)
        assert np.array_equal(self.starts.to_host(), begin[::chunks])
        assert self.counted.to_host()["entries"] == begin[-1]
        assert self.counted.array["empty_tiles"] == empty + np.count_nonzero(table.sum(axis=0) == 0)
        self.lists = Buffer.empty(self.device, int(begin[-1]) if room is None else room, self.structs.Entry)
        with self.image.writing() as image:
            image["list_capacity"] = len(self.lists.array)
        run("bin_fill", (chunks, 1), values, made=None, lists=self.lists)
        return np.split(self.lists.to_host()["index"].copy(), self.starts.array[1:-1].astype(np.int64))

    def draw(self) -> tuple[Array, Array]:
        """Run the stage `gouraud`, unlit; return rgba (M, N, 4) and triangles (M, N), both with row 0 at the TOP."""
        columns, rows = self.resolution
        # A guard row before and after the image reveals writes out of bounds.
        around = np.full((rows + 2, columns, 4), np.nan, self.structs.real), np.full((rows + 2, columns), -2, np.int32)
        rgba, owners = (Buffer(self.device, array[1:-1]) for array in around)
        with self.counted.writing() as table:
            table["next_tile"] = table["saturated"] = 0
        surface = struct_layout.surface_inputs(
            triangles=self.made.triangles,
            faces=self.faces,
            relative=self.vertices.relative,
            vertices=self.vertices.projected,
            image=self.image,
        )
        values = {**surface, "corner_light": None, **self.frame, "shown": None}
        values |= {"lists": self.lists, "starts": self.starts}
        self.stages.run("gouraud", self.stages.pixels("gouraud", self.tiles), values, rgba=rgba, owners=owners)
        planes = rgba.to_host(), owners.to_host()
        assert np.isnan(around[0][[0, -1]]).all()
        assert (around[1][[0, -1]] == -2).all()
        return planes


def four(vectors: Array) -> Array:
    """Pad (K, 3) or (K, 2) with zeros to (K, 4) float32."""
    wide = np.zeros((len(vectors), 4), np.float32)
    wide[:, : np.shape(vectors)[1]] = vectors
    return wide
