"""Lines along edges of the meshes: at which samples of each pixel one shows."""

from __future__ import annotations

import numpy as np

from ..base.arrays import Bools, Integers
from ..errors import DeviceError
from ..scene.edges import Edges
from .buffers import Buffer, wait
from .camera_space import CameraSpace
from .frame_state import SceneFrame
from .launches import Hiding
from .line_segments import line_grid, segments
from .mesh_edges import always_drawn, face_normals, facing, mesh_edges, outlines
from .triangle_source import SceneFaces, Triangles


class Lines:
    """The edges of a scene that are drawn as lines, and the memory for their lists.

    source: the scene's faces, which hide lines. front_only: (F,) bool, those not drawn where they are seen from behind.
    Raises DeviceError on a device without float64.
    """

    def __init__(self, source: SceneFaces, asked: Edges, front_only: Bools) -> None:
        self._source, self._stages, device = source, source.stages, source.stages.device
        if not device.has_fp64:
            raise DeviceError(f"{device.name}: expected a device with float64 for edges, found one without")
        self._asked, self._front_only = asked, front_only
        self._positions, self._faces = source.positions.array, source.faces.array
        self._edges = mesh_edges(self._positions, self._faces)
        self._normals = face_normals(self._positions, self._faces)
        self._always = always_drawn(self._edges, asked, self._normals)
        self._edge_faces = Buffer(device, self._edges.faces.astype(np.int32))
        self._listed = Buffer.empty(device, 0, np.uint32)
        self._hiders = Buffer.empty(device, 0, source.stages.structs.Hider)

    def draw(self, triangles: Triangles, frame: SceneFrame, *, painter: bool) -> Buffer:
        """Find the samples that show lines: (M, N, 2) uint64, row 0 at the top, a bit for each sample of each pixel, and
        likewise of lines along edges of more than two faces.

        triangles: those that hide lines. painter: whether they do so in painter's order.
        """
        space, events, vertices = frame.space, frame.events, self._source.vertices
        stages, device = self._stages, self._stages.device
        chosen = self._chosen(space)
        ends, projected = self._edges.ends[chosen], vertices.projected.to_host()
        lines, index = segments(ends, self._positions, projected, space, self._asked.steps, stages.structs)
        index = chosen[index]
        lines["first_face"], lines["faces"] = self._edges.starts[index], self._edges.counts[index]
        lines["marked"] = self._edges.counts[index] > 2
        ranks = None
        if painter:
            z = projected["depth"][self._faces]
            mean, rank = ((z[:, 0] + z[:, 1]) + z[:, 2]) / 3.0, np.empty(len(z), np.int32)
            rank[np.lexsort((-np.arange(len(z)), mean))] = np.arange(len(z))  # nearest first
            ranks = Buffer(device, rank)
            if len(index):  # the first rank of each edge's faces
                first = np.minimum.reduceat(rank[self._edges.faces], self._edges.starts).astype(np.float64)
                lines["w"] = -first[index, None]
        pieces, sides, view = triangles.pieces, self._source.sides, frame.tables.view
        hiding = Hiding(self._source.faces, vertices.projected, pieces, *sides, ranks, view, self._source.room)
        grid = Buffer(device, line_grid(lines, space, self._asked.steps, stages.structs))
        columns, rows = space.camera.resolution
        shown = Buffer(device, np.zeros((rows, columns, 2), np.uint64))
        table = Buffer(device, lines)
        cells = int(grid.array[0]["across"]) * int(grid.array[0]["up"])
        cursors = [Buffer(device, np.zeros(cells, np.uint32)) for _ in range(2)]
        stages.list_lines(table, grid, cursors[0], None, len(lines))
        stages.list_hiders(hiding, grid, cursors[1], None)
        starts = []
        for buffer in cursors:
            counts = buffer.to_host()
            begin = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
            starts.append(Buffer(device, begin.astype(np.uint32)))
            with buffer.writing() as rows_of:
                rows_of[:] = begin[:-1]
            if begin[-1] >= 1 << 32:
                raise DeviceError(f"{device.name}: edges: expected lists of less than 2^32 entries, found {begin[-1]}")
        self._make_room(*(int(buffer.array[-1]) for buffer in starts))
        events["list_lines"] = stages.list_lines(table, grid, cursors[0], self._listed, len(lines))
        events["list_hiders"] = stages.list_hiders(hiding, grid, cursors[1], self._hiders)
        lists = (table, self._edge_faces, starts[0], self._listed, starts[1], self._hiders)
        events["line_samples"] = stages.line_samples(hiding, frame.image, grid, lists, shown, cells)
        wait(device, [events["line_samples"]])  # the tables are freed on return
        return shown

    def _chosen(self, space: CameraSpace) -> Integers:
        """Return the edges to be drawn from this camera."""
        edges, culls = self._edges, bool(self._front_only.any())
        found = self._always
        if culls or "silhouette" in self._asked.kinds:
            axis = space.axes[2] if space.camera.orthographic else None
            front = facing(self._positions, self._faces, self._normals, space.camera.eye, axis)
            if "silhouette" in self._asked.kinds:
                found = found | outlines(edges, front)
            if culls:
                found = found & (edges.sums(((front > 0) | ~self._front_only)[edges.faces]) > 0)
        return np.flatnonzero(found)

    def _make_room(self, lines: int, hiders: int) -> None:
        device = self._stages.device
        if len(self._listed.array) < lines:
            self._listed = Buffer.empty(device, lines + lines // 2, np.uint32)
        if len(self._hiders.array) < hiders:
            self._hiders = Buffer.empty(device, hiders + hiders // 2, self._stages.structs.Hider)
