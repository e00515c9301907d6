"""Instances drawn from one copy of their mesh: for which scenes, their tables, and the triangles of a frame.

A frame keeps what it needs of triangles that may be seen, and nothing of the others: instances in the view are projected and
set up in blocks, whose vertices share one buffer; the pixel stages place corners again as they need them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.model import MAX_FACES, Scene, Settings
from .buffers import Buffer, TriangleBuffers
from .camera_space import CameraSpace
from .gather import Copies, Gatherer
from .launches import Placing, Sides, Stages
from .layer_buffers import first_instances
from .placements import placed_along, placed_each, plain
from .struct_layout import Structs

LEAST_COPIES = 1 << 16  # triangles that copies would add: with fewer, copies take little memory and less time
_LAYERS = {"Z", "id", "object_id", "material_id", "instance_id", "N", "P", "albedo", "uv", "barycentrics", "scalar"}
_LEAST_ROOM = 1 << 16  # triangles that there is room for at first
_ROOM_A_PIXEL, _ROOM_A_PIXEL_OF_GPU = 4, 1  # or so many for each; a CPU commits memory as it is written
_BLOCK = 1 << 16  # vertices of a block, on a CPU few enough for its caches; more if a mesh has more
_BLOCK_OF_GPU = 1 << 20
_MARGIN = 2.0**-40  # of all that tests of boxes and spheres add up: far more than its rounding


def draws_from_one_copy(scene: Scene, settings: Settings, forced: Collection[str]) -> bool:
    """Return whether a scene's instances are drawn from one copy of each mesh. Shadows, ambient occlusion, edges and layers
    unknown here need copies."""
    copies = sum((len(np.asarray(mesh.instances)) - 1) * len(mesh.faces) for mesh in scene.meshes)
    rays = settings.shadows or settings.ambient_occlusion or {"SHADOWS", "AMBIENT_OCCLUSION"} & set(forced)
    return copies >= LEAST_COPIES and not rays and settings.edges is None and set(settings.layers) <= _LAYERS


@dataclass(frozen=True)
class InstanceTables:
    """The instances of a scene, K of them, in its order.

    rows: (K,) of structs.Instance. vertices, faces: (K,) int64, of each one's mesh. centers, radii: (K, 3) and (K,) float64,
    spheres around them.
    """

    rows: Array
    vertices: Integers
    faces: Integers
    centers: Floats
    radii: Floats


class _Box(NamedTuple):
    """The box of a mesh and its copies: half its size (3,), its middle under each placement (K, 3), how much rounding may
    move those and the copies' vertices, (K, 3)."""

    half: Floats
    middle: Floats
    margin: Floats


def _box(copies: Copies) -> _Box:
    low, high = copies.verts.min(axis=0).astype(np.float64), copies.verts.max(axis=0).astype(np.float64)
    linear, shift = copies.matrices[:, :3, :3], copies.matrices[:, :3, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        middle = (linear * (low / 2 + high / 2)).sum(axis=2) + shift
        sizes = (np.abs(linear) * np.maximum(np.abs(low), np.abs(high))).sum(axis=2) + np.abs(shift)
        return _Box(high / 2 - low / 2, middle, _MARGIN * sizes)


def instance_tables(gatherer: Gatherer, structs: Structs) -> InstanceTables:
    """Return the tables of instances whose meshes `gatherer` has one copy of, or one more with the winding reversed."""
    first_vertex, first_face = {}, {}
    numbers = first_instances(gatherer.scene)
    vertex = face = first = 0
    for each in gatherer.copies:
        key = each.number, bool(each.mirrored[0])
        first_vertex[key], first_face[key] = vertex, face
        vertex, face = vertex + len(each.verts), face + len(each.faces)
    parts, vertices, faces, centers, radii = [], [], [], [], []
    for each in gatherer.placed:
        rows = np.zeros(each.count, structs.Instance)
        rows["rows"] = each.matrices[:, :3].reshape(-1, 12)
        linear = each.matrices[:, :3, :3]
        rows["scale"] = np.ldexp(1.0, -np.frexp(np.abs(linear).max(axis=(1, 2)))[1])
        rows["plain"], rows["mirrored"] = plain(each.matrices), each.mirrored
        rows["number"] = _as_int32(numbers[each.number] + np.arange(each.count))
        own_face = np.zeros(each.count, np.int64)
        for side in (False, True):
            mine = each.mirrored == side
            if mine.any():
                rows["first_vertex"][mine], own_face[mine] = (
                    first_vertex[each.number, side],
                    first_face[each.number, side],
                )
        rows["first_face"] = own_face
        rows["face_shift"] = _as_int32(first + len(each.faces) * np.arange(each.count) - own_face)
        first += each.count * len(each.faces)
        box = _box(each)
        with np.errstate(over="ignore", invalid="ignore"):
            centers.append(box.middle)
            corners = box.half * [[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]]
            radius = np.sqrt(((linear @ corners.T) ** 2).sum(axis=1)).max(axis=1)
            radii.append(radius + box.margin.sum(axis=1))
        parts.append(rows)
        vertices.append(np.full(each.count, len(each.verts)))
        faces.append(np.full(each.count, len(each.faces)))
    return InstanceTables(*map(np.concatenate, (parts, vertices, faces, centers, radii)))


def _as_int32(numbers: Integers) -> Array:
    """Return the lowest 32 bits of integers."""
    return numbers.astype(np.int64).astype(np.uint32).view(np.int32)


def placed_extent(placed: Collection[Copies]) -> tuple[Floats, Floats]:
    """Return the least and the largest coordinates, (3,) each, of all copies' vertices. Only copies whose boxes reach far
    enough are placed."""
    found = np.full((2, 3), np.inf)
    for each in placed:
        box = _box(each)
        with np.errstate(over="ignore", invalid="ignore"):
            reach = (np.abs(each.matrices[:, :3, :3]) * box.half).sum(axis=2) + box.margin
        for axis in range(3):
            for row, sign in zip(found, (1.0, -1.0), strict=True):
                bounds = sign * box.middle[:, axis] - reach[:, axis]
                row[axis] = min(row[axis], _least(each, axis, sign, np.array([bounds.argmin()])))
                row[axis] = min(row[axis], _least(each, axis, sign, np.flatnonzero(~(bounds >= row[axis]))))
    return found[0], -found[1]


def _least(copies: Copies, axis: int, sign: float, numbers: Integers) -> float:
    """Return the least coordinate of some copies along an axis, times a sign."""
    least = np.inf
    step = max(1, _BLOCK // len(copies.verts))
    for start in range(0, len(numbers), step):
        placed = placed_along(copies.verts, copies.matrices[numbers[start : start + step]], axis)
        least = min(least, float((sign * placed).min()))
    return least


def outside(tables: InstanceTables, space: CameraSpace) -> tuple[Bools, Bools]:
    """Return which instances are wholly before the near plane, and which wholly behind it and beside the image, (K,)
    each. One that is neither may still show nothing."""
    camera = space.camera
    with np.errstate(over="ignore", invalid="ignore"):
        at = space.points(tables.centers)
        sizes = tables.radii + np.abs(tables.centers).sum(axis=1) + np.abs(camera.eye).sum()
        radii = tables.radii + 16.0 * _MARGIN * sizes
        z = at[:, 2]
        behind, ahead = z + radii < space.near, z - radii >= space.near
        beside = np.zeros(len(z), bool)
        for axis in (0, 1):
            size, width, principal = camera.resolution[axis], camera.plane[1 - axis], camera.principal[axis]
            for sign in (1.0, -1.0):
                # sign * (image coordinate - a pixel beyond the edge), times what makes it linear in the position
                edge = (principal + 1.0 / size if sign > 0.0 else principal - 1.0 - 1.0 / size) * width
                if camera.orthographic:
                    value, slope = at[:, axis] + edge, 1.0
                else:
                    value, slope = camera.focal * at[:, axis] + edge * z, np.hypot(camera.focal, edge)
                beside |= sign * value + slope * radii < 0.0
    return behind, beside & ahead


class _Launches:
    """The launches of one stage, with the time of all."""

    def __init__(self) -> None:
        self._events: list[Any] = []

    def add(self, event: Any) -> None:
        self._events.append(event)

    @property
    def profile(self) -> SimpleNamespace:
        return SimpleNamespace(start=0, end=sum(each.profile.end - each.profile.start for each in self._events))


class Instances:
    """A scene's instances on the device.

    of_triangles: (T,) int32, the instance of each triangle that may be seen. depths: (T,) float64 their mean depths, with
    painter's order.
    """

    def __init__(self, stages: Stages, tables: InstanceTables, positions: Buffer, *, painter: bool) -> None:
        """positions: (V, 3) float64 of the meshes. painter: whether painter's order counts."""
        device, self._stages, self._tables = stages.device, stages, tables
        count = len(tables.rows)
        self._positions = positions
        self._placing = Placing(
            Buffer(device, tables.rows),
            Buffer(device, np.zeros(count, np.uint32)),
            Buffer(device, np.zeros(count + 1, np.int64)),
            Buffer(device, np.zeros(count + 1, np.int64)),
        )
        self._listed = np.zeros(0, np.uint32)
        most = _BLOCK if device.is_cpu else _BLOCK_OF_GPU
        self._block = max(int(tables.vertices.max(initial=0)), min(most, self.vertex_count))
        self._vertices = Buffer.empty(device, self._block, stages.structs.Vertex)
        self._painter = painter
        self.of_triangles = Buffer.empty(device, 0, np.int32)
        self.depths: Buffer | None = None
        self.culled = {"behind": 0, "off_screen": 0}

    @property
    def table(self) -> Buffer:
        """(K,) of structs.Instance."""
        return self._placing.instances

    @property
    def face_count(self) -> int:
        """Number of triangles, those of all instances."""
        return int(self._tables.faces.sum())

    @property
    def vertex_count(self) -> int:
        """Number of vertices likewise."""
        return int(self._tables.vertices.sum())

    def first_room(self, pixels: int) -> int:
        """Return how many triangles to make room for before the first frame, of so many pixels."""
        each = _ROOM_A_PIXEL if self._stages.device.is_cpu else _ROOM_A_PIXEL_OF_GPU
        return min(self.face_count, max(_LEAST_ROOM, each * pixels))

    @property
    def nbytes(self) -> int:
        """Device memory of the instances, for as long as the renderer is open."""
        return sum(buffer.array.nbytes for buffer in (*self._placing, self._vertices))

    def more_room(self, needed: int) -> int:
        """Return how many triangles to make room for if so many are needed."""
        return max(needed, min(needed + needed // 8, MAX_FACES))

    def select(self, space: CameraSpace) -> None:
        """List the instances in the view of a camera; `culled` counts the faces of the others."""
        behind, beside = outside(self._tables, space)
        faces = self._tables.faces
        self.culled = {"behind": int(faces[behind].sum()), "off_screen": int(faces[beside].sum())}
        listed = np.flatnonzero(~(behind | beside)).astype(np.uint32)
        if np.array_equal(listed, self._listed):
            return
        self._listed = listed
        with self._placing.listed.writing(len(listed)) as rows:
            rows[:] = listed
        for starts, counts in (
            (self._placing.vertex_starts, self._tables.vertices),
            (self._placing.face_starts, faces),
        ):
            with starts.writing(len(listed) + 1) as rows:
                rows[0] = 0
                np.cumsum(counts[listed], out=rows[1:])

    def _blocks(self) -> Iterator[tuple[int, int]]:
        starts, count, first = self._placing.vertex_starts.array, len(self._listed), 0
        while first < count:
            last = int(np.searchsorted(starts[: count + 1], starts[first] + self._block, "right")) - 1
            last = min(max(last, first + 1), count)
            yield first, last
            first = last

    def make_room(self, triangles: int) -> None:
        """Make room for the instances of so many triangles, clipped pieces included."""
        if len(self.of_triangles.array) < triangles:
            device = self._stages.device
            self.of_triangles = Buffer.empty(device, triangles, np.int32)
            self.depths = Buffer.empty(device, triangles, np.float64) if self._painter else None

    def set_up(
        self, faces: Buffer, view: Buffer, image: Buffer, made: TriangleBuffers, sides: Sides, events: dict[str, Any]
    ) -> None:
        """Append the visible triangles of the listed instances. The counters count those too for which there is no room."""
        self.make_room(len(made.triangles.array))
        placed, set_up = _Launches(), _Launches()
        vertex_starts, face_starts = self._placing.vertex_starts.array, self._placing.face_starts.array
        for block in self._blocks():
            first, last = block
            count = int(vertex_starts[last] - vertex_starts[first])
            placed.add(self._stages.place(self._positions, self._placing, view, self._vertices, block, count))
            count = int(face_starts[last] - face_starts[first])
            of_triangles = self.of_triangles, self.depths
            set_up.add(
                self._stages.setup_instances(
                    faces, self._vertices, self._placing, view, image, made, of_triangles, block, count, sides
                )
            )
        events["project"], events["setup"] = placed, set_up

    def add_pieces(self, first: int, numbers: Array) -> None:
        """Note the instances of clipped pieces, the triangles from `first` on."""
        self.of_triangles.to_host()
        with self.of_triangles.writing() as rows:
            rows[first : first + len(numbers)] = numbers

    def depths_of(self, index: Array) -> Floats:
        """Return the mean depths of triangles, with painter's order."""
        return self.depths.to_host()[index]  # type: ignore[union-attr]

    def order_of(self, index: Array, faces: Array) -> Integers:
        """Return numbers of triangles in the order of the scene's faces. faces: of their meshes."""
        order: Integers = (self.of_triangles.to_host()[index].astype(np.int64) << 32) + faces
        return order

    def corners(self, faces: Array, numbers: Array, own: Array) -> Floats:
        """Return the corners (C, 3, 3), world space, of faces of instances: `own` (C,) of `faces` (F, 3), by the instances'
        numbers (C,)."""
        points = self._positions.array[faces[own]]
        rows = self._tables.rows[numbers]
        return placed_each(points, rows["rows"].reshape(-1, 3, 4), rows["plain"] != 0)
