"""Where a frame's triangles come from: the faces of a scene's meshes, or of instances drawn from one copy of their mesh; for
which scenes they are, and their tables.

Of instances a frame keeps what it needs of triangles that may be seen, and nothing of the others: those in the view are
projected and set up in blocks, whose vertices share one buffer; the pixel stages place corners again as they need them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.contents import first_instances
from ..scene.model import MAX_FACES, Scene, Settings
from .buffers import Buffer, TriangleBuffers, VertexBuffers, wait
from .camera_space import CameraSpace, project_on_host
from .gather import Copies, Gatherer
from .launches import FrameInFlight, Stages, items
from .placements import plain, products
from .struct_layout import Structs

LEAST_COPIES = 1 << 16  # triangles that copies would add: with fewer, copies take little memory and less time
_LEAST_ROOM = 1 << 16  # triangles that there is room for at first
_ROOM_A_PIXEL, _ROOM_A_PIXEL_OF_GPU = 4, 1  # or so many for each; a CPU commits memory as it is written
_BLOCK = 1 << 16  # vertices of a block, on a CPU few enough for its caches; more if a mesh has more
_BLOCK_OF_GPU = 1 << 20
_UNKNOWN = np.full(1, 2**32 - 1, np.uint32)  # no list of instances
_MARGIN = 2.0**-40  # of all that tests of boxes and spheres add up: far more than its rounding


class Faces(NamedTuple):
    """Faces to clip, in order."""

    corners: Floats  # (C, 3, 3), world space
    numbers: Integers  # (C,)
    instances: Integers | None = None  # (C,), those that have them, None for faces of the scene


class TriangleSource:
    """Projects a scene's vertices and sets up the triangles of its faces, in memory that is kept from frame to frame.

    positions: (V, 3) and faces: (F, 3) of the scene. vertices: projected. made: the memory of faces, and of pieces of
    clipped ones. sizes: the numbers of triangles and vertices, those of all instances. culled: triangles outside of the view
    that are not even set up, by the counter that they are added to.
    """

    def __init__(self, stages: Stages, positions: Buffer, faces: Buffer, room: int | None = None) -> None:
        """room: faces that there is memory for at first, but none for vertices; None: all, and their vertices."""
        self.stages, self.positions, self.faces, self.culled = stages, positions, faces, dict[str, int]()
        self.vertices = VertexBuffers(stages.device, len(positions.array) if room is None else 0, stages.structs)
        self.make_memory(len(faces.array) if room is None else room)
        self.sizes = {"triangles": len(faces.array), "vertices": len(positions.array)}

    @property
    def room(self) -> int:
        """Number of faces that there is memory for; pieces follow them."""
        return len(self.made.to_clip.array)

    def make_memory(self, room: int, pieces: int = 0) -> None:
        """Replace the memory by one for so many faces and pieces of clipped ones."""
        stages = self.stages
        self.made = TriangleBuffers(stages.device, room, pieces, stages.structs, slack=stages.lanes)

    @property
    def nbytes(self) -> int:
        """Size of memory that depends on how many triangles are seen."""
        return 0

    def project(self, frame: FrameInFlight) -> None:
        """Enqueue the projection of the vertices; on a device without float64 the host does it, and there is no event."""
        vertices, values, count = self.vertices, frame.values, len(self.positions.array)
        values |= {"vertices": vertices.projected, "relative": vertices.relative}
        if not self.room:
            return
        if self.stages.device.has_fp64:
            arguments = {"positions": self.positions, "count": count}
            frame.events["project"] = self.stages.run("project", items(count), values, **arguments)
        else:
            with vertices.projected.writing() as projected, vertices.relative.writing() as relative:
                project_on_host(self.positions.array, frame.space, projected, relative)
            frame.events["project"] = None

    def set_up(self, frame: FrameInFlight) -> None:
        """Enqueue the setup of the triangles, whose keys are written; the frame's counters are 0 before."""
        stages, count, means = self.stages, self.room, None
        frame.values |= {**self.made.values, "keys": self.made.keys, "sorted": self.made.sorted_bounds}
        if not count:
            return
        if not (stages.device.has_fp64 or stages.features["DEPTH_TEST"]):
            means = Buffer(stages.device, self.mean_depths(self.vertices.projected.array, slice(None)))
        size = stages.runs(count, stages.device.setup_run)
        frame.events["setup"] = stages.run("setup", size, frame.values, mean_depths=means, count=count)
        if means is not None:
            wait(stages.device, [frame.events["setup"]])  # `means` is freed on return

    def mean_depths(self, projected: Array, which: Array | slice) -> Floats:
        """Return the mean depths of the corners of some faces, from projected vertices."""
        z = projected["depth"][self.faces.array[which]]
        return np.asarray(((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0)

    def to_clip(self, count: int) -> Faces:
        """Return the faces that setup listed to be clipped."""
        numbers = np.sort(self.made.to_clip.to_host(count))
        return Faces(self.positions.array[self.faces.array[numbers]], numbers)

    def add_pieces(self, faces: Faces, sources: Integers) -> None:
        """Note which of the faces each of the pieces comes from, (C,). The table of pieces holds faces of the scene."""

    def painter_depths(self, frame: FrameInFlight, index: Array) -> tuple[Floats, Integers]:
        """Return the exact painter's depths of the triangles in `index`, and numbers in the order of their faces."""
        depth, unclipped = np.empty(len(index)), index < self.room
        depth[unclipped] = self.mean_depths(self.vertices.projected.to_host(), index[unclipped])
        depth[~unclipped] = frame.values["pieces"].array["key_depth"][index[~unclipped].astype(np.int64) - self.room]
        return depth, self.faces_of(frame, index)

    def faces_of(self, frame: FrameInFlight, index: Array) -> Integers:
        """Return the faces of the triangles in `index`."""
        face: Integers = index.astype(np.int64)
        pieces = face >= self.room
        if pieces.any():
            face[pieces] = frame.values["pieces"].array["face"][face[pieces] - self.room]
        return face


def set_up_pieces(stages: Stages, pieces: Buffer, frame: FrameInFlight, face_count: int) -> None:
    """Set up the triangles of pieces, (C,) of structs.Piece, after those of so many faces."""
    count, size = len(pieces.array), items(len(pieces.array), stages.lanes_of("setup_pieces"))
    frame.values["pieces"] = pieces
    stages.run("setup_pieces", size, frame.values, face_count=face_count, count=count)


def draws_from_one_copy(scene: Scene, settings: Settings, forced: Collection[str]) -> bool:
    """Return whether a scene's instances are drawn from one copy of each mesh. Shadows, ambient occlusion and edges
    need copies."""
    copies = sum((len(np.asarray(mesh.instances)) - 1) * len(mesh.faces) for mesh in scene.meshes)
    rays = settings.shadows or settings.ambient_occlusion or {"SHADOWS", "AMBIENT_OCCLUSION"} & set(forced)
    return copies >= LEAST_COPIES and not rays and settings.edges is None


@dataclass(frozen=True)
class InstanceTables:
    """The instances of a scene, K of them, in its order."""

    rows: Array  # (K,) of structs.Instance
    vertices: Integers  # (K,), numbers of those of its mesh, and of its faces
    faces: Integers
    centers: Floats  # (K, 3), of spheres around them
    radii: Floats


def _box(copies: Copies) -> tuple[Floats, Floats, Floats]:
    """Return half the size of a mesh's box, (3,), its middle under each placement, (K, 3), and how much rounding may move
    those and the copies' vertices, (K, 3)."""
    low, high = copies.verts.min(axis=0).astype(np.float64), copies.verts.max(axis=0).astype(np.float64)
    linear, shift = copies.matrices[:, :3, :3], copies.matrices[:, :3, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        middle = (linear * (low / 2 + high / 2)).sum(axis=2) + shift
        sizes = (np.abs(linear) * np.maximum(np.abs(low), np.abs(high))).sum(axis=2) + np.abs(shift)
        return high / 2 - low / 2, middle, _MARGIN * sizes


def instance_tables(gatherer: Gatherer, structs: Structs) -> InstanceTables:
    """Return the tables of instances whose meshes `gatherer` has one copy of, or one more with the winding reversed."""
    first_vertex, first_face = {}, {}
    numbers = first_instances(gatherer.scene)
    vertex = face = first = 0
    for copy in gatherer.copies:
        key = copy.numbers[0], bool(copy.mirrored[0])
        first_vertex[key], first_face[key] = vertex, face
        vertex, face = vertex + len(copy.verts), face + len(copy.faces)
    parts: list[tuple[Array, ...]] = []
    for each in gatherer.placed:
        rows, copies = np.zeros(each.count, structs.Instance), np.arange(each.count)
        rows["rows"] = each.matrices[:, :3].reshape(-1, 12)
        linear = each.matrices[:, :3, :3]
        rows["scale"] = np.ldexp(1.0, -np.frexp(np.abs(linear).max(axis=(1, 2)))[1])
        rows["plain"], rows["mirrored"] = plain(each.matrices), each.mirrored
        rows["number"] = (numbers[each.numbers[0]] + copies).astype(np.uint32).view(np.int32)
        own_face = np.zeros(each.count, np.int64)
        for side in (False, True):
            mine = each.mirrored == side
            if mine.any():
                rows["first_vertex"][mine] = first_vertex[each.numbers[0], side]
                own_face[mine] = first_face[each.numbers[0], side]
        rows["first_face"] = own_face
        rows["face_shift"] = (first + len(each.faces) * copies - own_face).astype(np.uint32).view(np.int32)
        first += each.count * len(each.faces)
        half, middle, margin = _box(each)
        with np.errstate(over="ignore", invalid="ignore"):
            corners = half * [[1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]]
            radii = np.sqrt(((linear @ corners.T) ** 2).sum(axis=1)).max(axis=1) + margin.sum(axis=1)
        sizes = (np.full(each.count, len(table)) for table in (each.verts, each.faces))
        parts.append((rows, *sizes, middle, radii))
    return InstanceTables(*map(np.concatenate, zip(*parts, strict=True)))


def placed_extent(placed: Collection[Copies]) -> tuple[Floats, Floats]:
    """Return the least and the largest coordinates, (3,) each, of all copies' vertices. Only copies whose boxes reach far
    enough are placed."""
    ends = np.full((2, 3), np.inf)
    for copies in placed:
        half, middle, margin = _box(copies)
        verts, step = np.asarray(copies.verts, np.float64), max(1, _BLOCK // len(copies.verts))
        with np.errstate(over="ignore", invalid="ignore"):
            reach = (np.abs(copies.matrices[:, :3, :3]) * half).sum(axis=2) + margin
        for axis, (end, sign) in product(range(3), zip(ends, (1.0, -1.0), strict=True)):
            bounds = sign * middle[:, axis] - reach[:, axis]
            numbers = np.array([bounds.argmin()])  # the copy that reaches farthest, then all that may reach beyond it
            for _ in range(2):
                for start in range(0, len(numbers), step):
                    matrices = copies.matrices[numbers[start : start + step], None, axis : axis + 1]
                    end[axis] = min(end[axis], (sign * products(verts, matrices)).min())
                numbers = np.flatnonzero(~(bounds >= end[axis]))
    return ends[0], -ends[1]


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


class Instances(TriangleSource):
    """The triangles of a scene's instances.

    Instances in the view are listed for each frame. There is room for the triangles of an image of usual contents, and more
    is made where they need it.
    """

    def __init__(self, stages: Stages, tables: InstanceTables, positions: Buffer, faces: Buffer, pixels: int) -> None:
        """positions: (V, 3) float64 and faces: (F, 3) of the meshes. pixels: of the image."""
        device, self._tables = stages.device, tables
        face_count, vertex_count = int(tables.faces.sum()), int(tables.vertices.sum())
        room = _ROOM_A_PIXEL if device.is_cpu else _ROOM_A_PIXEL_OF_GPU
        super().__init__(stages, positions, faces, min(face_count, max(_LEAST_ROOM, room * pixels)))
        self.sizes = {"triangles": face_count, "vertices": vertex_count}
        count = len(tables.rows)
        # listed: L numbers of those to draw. *_starts: L + 1, the number of vertices or faces of all listed before.
        arrays = {"instances": tables.rows, "listed": np.zeros(count, np.uint32)}
        arrays |= {name: np.zeros(count + 1, np.int64) for name in ("vertex_starts", "face_starts")}
        self._placing = {name: Buffer(device, array) for name, array in arrays.items()}
        self._listed = np.zeros(0, np.uint32)
        block = _BLOCK if device.is_cpu else _BLOCK_OF_GPU
        self._block = max(int(tables.vertices.max(initial=0)), min(block, vertex_count))
        self._vertices = Buffer.empty(device, self._block, stages.structs.Vertex)
        # Size of memory that does not depend on the frame.
        self.resident_bytes = sum(buffer.array.nbytes for buffer in (*self._placing.values(), self._vertices))
        self._of_triangles = Buffer.empty(device, 0, np.int32)  # the instance of each
        self._depths: Buffer | None = None  # their mean depths, with painter's order

    @property
    def nbytes(self) -> int:
        return self.made.nbytes + self._of_triangles.array.nbytes

    def project(self, frame: FrameInFlight) -> None:
        """Do nothing: vertices are projected block by block, before their triangles are set up."""

    def set_up(self, frame: FrameInFlight) -> None:
        self._select(frame.space)
        frame.values |= {"relative": self.vertices.relative, "object_positions": self.positions}
        while True:
            triangles, device = len(self.made.triangles.array), self.stages.device  # clipped pieces included
            if len(self._of_triangles.array) < triangles:
                painter = not self.stages.features["DEPTH_TEST"]
                self._depths = Buffer.empty(device, triangles, np.float64) if painter else None
                self._of_triangles = Buffer.empty(device, triangles, np.int32)
            frame.values |= {**self.made.values, "keys": self.made.keys, "sorted": self.made.sorted_bounds}
            self._set_up_blocks(frame)
            counters = frame.read_counters()
            needed = max(int(counters["visible"]), 2 * int(counters["to_clip"]))
            if needed <= self.room:
                return
            limit = MAX_FACES - self.made.piece_capacity
            self.make_memory(max(needed, min(needed + needed // 8, limit)), self.made.piece_capacity)
            frame.clear_counters()

    def _select(self, space: CameraSpace) -> None:
        """List the instances in the view of a camera, and count the faces of the others."""
        behind, beside = outside(self._tables, space)
        faces = self._tables.faces
        self.culled = {"behind": int(faces[behind].sum()), "off_screen": int(faces[beside].sum())}
        listed = np.flatnonzero(~(behind | beside)).astype(np.uint32)
        if np.array_equal(listed, self._listed):
            return
        self._listed = _UNKNOWN  # until all of it is written
        with self._placing["listed"].writing(len(listed)) as rows:
            rows[:] = listed
        for name, counts in (("vertex_starts", self._tables.vertices), ("face_starts", faces)):
            with self._placing[name].writing(len(listed) + 1) as rows:
                rows[0] = 0
                np.cumsum(counts[listed], out=rows[1:])
        self._listed = listed

    def _blocks(self) -> Iterator[tuple[int, int]]:
        starts, count, first = self._placing["vertex_starts"].array, len(self._listed), 0
        while first < count:
            last = int(np.searchsorted(starts[: count + 1], starts[first] + self._block, "right")) - 1
            last = min(max(last, first + 1), count)
            yield first, last
            first = last

    def _set_up_blocks(self, frame: FrameInFlight) -> None:
        """Append the visible triangles of the listed instances. The counters count those too for which there is no room."""
        placed, set_up = list[Any](), list[Any]()
        run = self.stages.device.setup_run
        frame.values |= {"instances": self._placing["instances"], "triangle_instances": self._of_triangles}
        values: dict[str, Any] = {**frame.values, **self._placing, "vertices": self._vertices}
        values |= {"positions": self.positions, "room": self.room, "run": run, "mean_depths": self._depths}
        vertex_starts, face_starts = (self._placing[name].array for name in ("vertex_starts", "face_starts"))
        kernels = ("place", vertex_starts, placed), ("setup_instances", face_starts, set_up)
        for first, last in self._blocks():
            for kernel, starts, launches in kernels:
                begin, end = int(starts[first]), int(starts[last])
                size = self.stages.runs(end - begin, run)
                launches.append(self.stages.run(kernel, size, values, first=first, last=last))
        frame.events["project"], frame.events["setup"] = placed, set_up

    def to_clip(self, count: int) -> Faces:
        pairs = self.made.to_clip.to_host(2 * count).reshape(-1, 2)
        instances, numbers = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].T
        points, rows = self.positions.array[self.faces.array[numbers]], self._tables.rows[instances]
        placed = products(points, rows["rows"].reshape(-1, 1, 3, 4))
        return Faces(np.where(rows["plain"][:, None, None] != 0, points, placed), numbers, instances)

    def add_pieces(self, faces: Faces, sources: Integers) -> None:
        numbers = faces.instances[sources]  # type: ignore[index]
        self._of_triangles.to_host()
        with self._of_triangles.writing() as rows:
            rows[self.room : self.room + len(numbers)] = numbers

    def painter_depths(self, frame: FrameInFlight, index: Array) -> tuple[Floats, Integers]:
        depth, unclipped = np.empty(len(index)), index < self.room
        depth[unclipped] = self._depths.to_host()[index[unclipped]]  # type: ignore[union-attr]
        depth[~unclipped] = frame.values["pieces"].array["key_depth"][index[~unclipped].astype(np.int64) - self.room]
        instances = self._of_triangles.to_host()[index].astype(np.int64)
        return depth, (instances << 32) + self.faces_of(frame, index)

    def faces_of(self, frame: FrameInFlight, index: Array) -> Integers:
        return np.asarray(self.made.triangles.to_host()["face"][index])
