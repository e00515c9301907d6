"""Lines along edges of the meshes: which edges there are, where they are in the image, and at which samples one shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..errors import DeviceError
from ..scene.geometry import welded
from ..scene.settings import Edges
from .buffers import Buffer, Scratch, wait
from .camera_space import CameraSpace, cut_to_view, image_positions, scaled_w, snap
from .launches import FrameInFlight, items
from .struct_layout import LINE_INSET, SAMPLE_BITS, SNAP_LIMIT, SUBPIXEL_BITS
from .triangle_source import TriangleSource


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """E edges, of vertices that are welded where their positions are equal."""

    ends: Integers  # (E, 2), of positions
    starts: Integers  # (E,), of each edge's entries in `faces` and `forward`
    counts: Integers  # (E,), of those
    faces: Integers  # (K,), ascending for each edge
    forward: Bools  # (K,), whether the face runs along the edge from its first end to its second

    def __len__(self) -> int:
        return len(self.ends)

    def sums(self, values: Array) -> Integers:
        """Return (E,): the sums of `values` (K,) over the faces of each edge."""
        total = np.concatenate([[0], np.cumsum(values, dtype=np.int64)])
        return np.asarray(total[self.starts + self.counts] - total[self.starts])


def mesh_edges(positions: Array, faces: Array) -> MeshEdges:
    """Return the edges of faces (F, 3) between positions (V, 3). A face with two corners at the same place has none."""
    points, which = welded(positions)
    corners = points[which][faces]
    a, b, c = corners.T
    proper = np.flatnonzero((a != b) & (b != c) & (c != a))
    corners = corners[proper]
    start, end = corners.reshape(-1), corners[:, [1, 2, 0]].reshape(-1)
    face = np.repeat(proper, 3)
    forward = start < end
    low, high = np.where(forward, start, end), np.where(forward, end, start)
    order = np.lexsort((face, high, low))
    low, high = low[order], high[order]
    new = np.ones(len(order), bool)
    new[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    starts = np.flatnonzero(new)
    counts = np.diff(np.append(starts, len(order)))
    return MeshEdges(np.stack([low[starts], high[starts]], axis=1), starts, counts, face[order], forward[order])


def face_normals(positions: Array, faces: Array) -> Floats:
    """Return (F, 3) float64: the cross products of the faces' sides, not of unit length."""
    p = positions[faces].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2])


def sharp(edges: MeshEdges, normals: Floats, angle: float) -> Bools:
    """Return (E,) bool: the edges of two faces whose normals (F, 3) differ by more than `angle`, degrees. Faces without
    area have no normal, and faces that wind the other way have it turned."""
    is_sharp = np.zeros(len(edges), bool)
    pairs = np.flatnonzero(edges.counts == 2)
    first = edges.starts[pairs]
    a, b = (normals[edges.faces[first + k]] for k in (0, 1))
    turned = np.where(edges.forward[first] == edges.forward[first + 1], -1.0, 1.0)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        a, b = (v / np.abs(v).max(axis=1, initial=0.0, keepdims=True) for v in (a, b))  # squares stay in range
        cosine = turned * _dot(a, b) / np.sqrt(_dot(a, a) * _dot(b, b))
        is_sharp[pairs] = cosine < np.cos(np.radians(angle))  # false for NaN
    return is_sharp


def always_drawn(edges: MeshEdges, style: Edges, normals: Floats) -> Bools:
    """Return (E,) bool: the edges of the kinds asked for that do not depend on the camera."""
    always = np.full(len(edges), "all" in style.kinds)
    if "boundary" in style.kinds or "silhouette" in style.kinds:
        always |= edges.counts == 1
    if "nonmanifold" in style.kinds:
        always |= edges.counts > 2
    if "feature" in style.kinds:
        always |= sharp(edges, normals, style.angle)
    return always


def facing(positions: Array, faces: Array, normals: Floats, eye: Floats, axis: Floats | None) -> Integers:
    """Return (F,): 1 for faces seen from the front, -1 for others, 0 for faces without area. axis: (3,) the viewing
    direction of an orthographic camera, else None."""
    with np.errstate(over="ignore", invalid="ignore"):
        toward = eye - positions[faces[:, 0]].astype(np.float64) if axis is None else -axis[None]
        side = _dot(normals, toward)
    return np.asarray(np.where((normals == 0.0).all(axis=1), 0, np.where(side > 0.0, 1, -1)))


def outlines(edges: MeshEdges, facing: Integers) -> Bools:
    """Return (E,) bool: the edges whose faces with an area all lie on the same side of them, as seen from the eye."""
    side = np.where(edges.forward, 1, -1) * facing[edges.faces]
    return np.asarray(np.abs(edges.sums(side)) == edges.sums(side != 0))


_LEAST_CELL, _LARGEST_CELL = 10, 12  # bits of 1/256 px: 4 to 16 px
_MOST_CELLS = 1 << 20


def _on_line_grid(snapped: Integers) -> Integers:
    """Round snapped positions to the samples' grid, 1/256 px, on which lines cover them: halves up."""
    shift = SUBPIXEL_BITS - SAMPLE_BITS
    return (snapped + (1 << shift - 1)) >> shift


class Lines:
    """The edges of a scene that are drawn as lines, and the memory for their lists.

    source: of the faces, which hide lines. front_only: (F,) bool, those not drawn where they are seen from behind. Raises
    DeviceError on a device without float64.
    """

    def __init__(self, source: TriangleSource, style: Edges, front_only: Bools) -> None:
        device = source.stages.device
        if not device.has_fp64:
            raise DeviceError(f"{device.name}: expected a device with float64 for edges, found one without")
        self._source, self._asked, self._front_only = source, style, front_only
        self._positions, self._faces = source.positions.array, source.faces.array
        self._edges = mesh_edges(self._positions, self._faces)
        self._normals = face_normals(self._positions, self._faces)
        self._always = always_drawn(self._edges, style, self._normals)
        self._edge_faces = Buffer(device, self._edges.faces.astype(np.int32))
        self._memory, self._kinds = Scratch(device), {"listed": np.uint32, "hiders": source.stages.structs.Hider}

    def draw(self, frame: FrameInFlight) -> None:
        """Write `shown`, (M, N, 2) uint64, row 0 at the top: a bit for each sample of a pixel at which a line shows, and for
        each at which a line along an edge of more than two faces does."""
        source, stages, device = self._source, self._source.stages, self._source.stages.device
        lines, ranks = self._table(frame.space)
        grid = self._grid(lines, frame.space)
        columns, rows = frame.resolution
        arrays = {"lines": lines, "grid": grid, "ranks": ranks, "shown": np.zeros((rows, columns, 2), np.uint64)}
        values = {**frame.values, **{name: Buffer(device, array) for name, array in arrays.items()}}
        values |= {"edge_faces": self._edge_faces, "face_count": source.room}
        cells = int(grid["across"][0]) * int(grid["up"][0])
        hiders = source.room + len(frame.values["pieces"].array)
        lists = ("list_lines", "listed", "line_starts", len(lines)), ("list_hiders", "hiders", "starts", hiders)
        all_cursors = [Buffer(device, np.zeros(cells, np.uint32)) for _ in lists]
        for (kernel, name, starts, count), cursors in zip(lists, all_cursors, strict=True):
            values |= {"cursors": cursors, name: None, "count": count}
            stages.run(kernel, items(count), values, writes=False)  # only counts
            begin = np.concatenate([[0], np.cumsum(cursors.to_host(), dtype=np.int64)])
            if begin[-1] >= 1 << 32:
                raise DeviceError(f"{device.name}: edges: expected lists of less than 2^32 entries, found {begin[-1]}")
            with cursors.writing() as rows_of:
                rows_of[:] = begin[:-1]
            values[name] = self._memory(name, int(begin[-1]), self._kinds[name])
            values[starts] = Buffer(device, begin.astype(np.uint32))
            frame.events[kernel] = stages.run(kernel, items(count), values, writes=True)
        group = 1 if device.is_cpu else 64
        frame.events["line_samples"] = stages.run("line_samples", (cells * group, group), values)
        wait(device, [frame.events["line_samples"]])  # the tables are freed on return
        frame.values["shown"] = values["shown"]

    def _table(self, space: CameraSpace) -> tuple[Array, Array]:
        """Return a table (L,) of structs.Line, and the faces' ranks in painter's order, nearest first; none without it."""
        source, edges = self._source, self._edges
        projected = source.vertices.projected.to_host()
        lines, index = self._segments(projected, space)
        lines["first_face"], lines["faces"] = edges.starts[index], edges.counts[index]
        lines["marked"] = edges.counts[index] > 2
        if source.stages.features["DEPTH_TEST"]:
            return lines, np.zeros(0, np.int32)
        mean = source.mean_depths(projected, slice(None))
        ranks = np.empty(len(mean), np.int32)
        ranks[np.lexsort((-np.arange(len(mean)), mean))] = np.arange(len(mean))
        if len(index):  # the first rank of each edge's faces
            first = np.minimum.reduceat(ranks[edges.faces], edges.starts).astype(np.float64)
            lines["w"] = -first[index, None]
        return lines, ranks

    def _segments(self, vertices: Array, space: CameraSpace) -> tuple[Array, Integers]:
        """Return a table (L,) of structs.Line, without what concerns faces, of the edges that may reach the image, and their
        indices (L,). vertices: (V,), projected."""
        chosen = self._chosen(space)
        ends, before = self._edges.ends[chosen], vertices["depth"] >= space.near
        at = np.stack([vertices["x"], vertices["y"]], axis=-1).astype(np.int64)
        unclipped = (before & (np.abs(at) < SNAP_LIMIT).all(axis=1))[ends].all(axis=1)
        z = np.where(before, vertices["depth"], space.near)  # only those before the near plane are read
        index = np.flatnonzero(unclipped)
        xy, w = _on_line_grid(at[ends[index]]), scaled_w(z, space)[ends[index]]
        clipped = np.flatnonzero(before[ends].any(axis=1) & ~unclipped)
        if len(clipped):
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                points = space.points(self._positions[ends[clipped]])
                points, counts = cut_to_view(points, space.camera, space.near, closed=False)
            left = np.flatnonzero(counts)
            points = points[left, :2]
            index = np.concatenate([index, clipped[left]])
            snapped = snap(image_positions(points, space.camera), space.raster)
            xy = np.concatenate([xy, _on_line_grid(snapped)])
            w = np.concatenate([w, scaled_w(points[..., 2], space)])
        size, reach = np.array(space.camera.resolution) << SAMPLE_BITS, (self._asked.steps + 1) // 2
        in_view = ((xy.max(axis=1) >= -reach) & (xy.min(axis=1) <= size + reach)).all(axis=1)
        index, xy, w = index[in_view], xy[in_view], w[in_view]
        lines = np.zeros(len(index), self._source.stages.structs.Line)
        lines["x"], lines["y"], lines["w"] = xy[..., 0], xy[..., 1], w
        with np.errstate(divide="ignore"):
            dx, dy = (xy[:, 1] - xy[:, 0]).astype(np.float64).T
            lines["inset"] = np.minimum(LINE_INSET / np.sqrt(dx * dx + dy * dy), 0.5)
        return lines, chosen[index]

    def _grid(self, lines: Array, space: CameraSpace) -> Array:
        """Return the one row of structs.LineGrid: cells about as long as the lines (L,), over the image and as far around it
        as a line reaches. The cells change only how long the search for what hides a line takes."""
        width, size = self._asked.steps, np.array(space.camera.resolution, np.int64) << SAMPLE_BITS
        dx, dy = (lines[name][:, 1].astype(np.float64) - lines[name][:, 0] for name in ("x", "y"))
        length = float(np.sqrt(dx * dx + dy * dy).mean()) if len(lines) else 0.0
        bits = min(max(math.ceil(math.log2(max(length, 1.0))), _LEAST_CELL), _LARGEST_CELL)
        while (size >> bits).prod() > _MOST_CELLS:
            bits += 1
        margin = -(-((width + 1) // 2) // (1 << bits))
        grid = np.zeros(1, self._source.stages.structs.LineGrid)
        grid["cell_bits"], grid["margin"], grid["width"] = bits, margin, width
        grid["across"], grid["up"] = (-(-size // (1 << bits)) + 2 * margin).tolist()
        return grid

    def _chosen(self, space: CameraSpace) -> Integers:
        """Return the indices of the edges to be drawn from this camera."""
        edges, culls = self._edges, bool(self._front_only.any())
        chosen = self._always
        if culls or "silhouette" in self._asked.kinds:
            axis = space.axes[2] if space.camera.orthographic else None
            front = facing(self._positions, self._faces, self._normals, space.camera.eye, axis)
            if "silhouette" in self._asked.kinds:
                chosen = chosen | outlines(edges, front)
            if culls:
                chosen = chosen & (edges.sums(((front > 0) | ~self._front_only)[edges.faces]) > 0)
        return np.flatnonzero(chosen)
