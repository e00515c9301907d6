"""Lines along edges of the meshes: which edges there are, where they are in the image, and at which samples one shows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..errors import DeviceError
from ..scene.edges import Edges
from . import clip
from .buffers import Buffer, wait
from .camera_space import CameraSpace
from .frame_state import SceneFrame
from .launches import items
from .struct_layout import LINE_INSET, MOST_DEPTH, SAMPLE_BITS, SNAP_LIMIT, SUBPIXEL_BITS, Structs
from .triangle_source import SceneFaces, Triangles


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """E edges, of vertices that are welded where their positions are equal.

    ends: (E, 2) indices of positions. starts: (E,) index of each edge's first entry in `faces` and `forward`; the others
    follow. counts: (E,) how many. faces: (K,) faces, ascending for each edge. forward: (K,) whether the face runs along
    the edge from its first end to its second.
    """

    ends: Integers
    starts: Integers
    counts: Integers
    faces: Integers
    forward: Bools

    def __len__(self) -> int:
        return len(self.ends)

    def sums(self, values: Array) -> Integers:
        """Return (E,): the sums of `values` (K,) over the faces of each edge."""
        total = np.concatenate([[0], np.cumsum(values, dtype=np.int64)])
        summed: Integers = total[self.starts + self.counts] - total[self.starts]
        return summed


def weld(positions: Array) -> Integers:
    """Return (V,): for each position (V, 3) the index of the first one equal to it; -0.0 equals 0.0."""
    order = np.lexsort(positions.T)  # stable: of equal ones the first comes first
    ordered = positions[order]
    new = np.ones(len(order), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    welded = np.empty(len(order), np.int64)
    welded[order] = order[new][np.cumsum(new) - 1] if len(order) else order
    return welded


def mesh_edges(positions: Array, faces: Array) -> MeshEdges:
    """Return the edges of faces (F, 3) between positions (V, 3). A face with two corners at the same place has none."""
    corners = weld(positions)[faces]
    a, b, c = corners.T
    whole = np.flatnonzero((a != b) & (b != c) & (c != a))
    corners = corners[whole]
    start, end = corners.reshape(-1), corners[:, [1, 2, 0]].reshape(-1)
    face = np.repeat(whole, 3)
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
        normals: Floats = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    return normals


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]) + a[:, 2] * b[:, 2]
    return product


def sharp(edges: MeshEdges, normals: Floats, angle: float) -> Bools:
    """Return (E,) bool: the edges of two faces whose normals (F, 3) differ by more than `angle`, degrees. Faces without
    area have no normal, and faces that wind the other way have it turned."""
    found = np.zeros(len(edges), bool)
    pairs = np.flatnonzero(edges.counts == 2)
    first = edges.starts[pairs]
    a, b = (normals[edges.faces[first + k]] for k in (0, 1))
    turned = np.where(edges.forward[first] == edges.forward[first + 1], -1.0, 1.0)
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        a, b = (v / np.abs(v).max(axis=1, initial=0.0, keepdims=True) for v in (a, b))  # squares stay in range
        cosine = turned * _dot(a, b) / np.sqrt(_dot(a, a) * _dot(b, b))
        found[pairs] = cosine < np.cos(np.radians(angle))  # false for NaN
    return found


def always_drawn(edges: MeshEdges, asked: Edges, normals: Floats) -> Bools:
    """Return (E,) bool: the edges of the kinds asked for that do not depend on the camera."""
    found = np.full(len(edges), "all" in asked.kinds)
    if "boundary" in asked.kinds or "silhouette" in asked.kinds:
        found |= edges.counts == 1
    if "nonmanifold" in asked.kinds:
        found |= edges.counts > 2
    if "feature" in asked.kinds:
        found |= sharp(edges, normals, asked.angle)
    return found


def facing(positions: Array, faces: Array, normals: Floats, eye: Floats, axis: Floats | None) -> Integers:
    """Return (F,): 1 for faces seen from the front, -1 for others, 0 for faces without area. axis: (3,) the viewing
    direction of an orthographic camera, else None."""
    if axis is None:
        with np.errstate(over="ignore", invalid="ignore"):
            side = _dot(normals, eye - positions[faces[:, 0]].astype(np.float64))
    else:
        side = _dot(normals, np.broadcast_to(-axis, normals.shape))
    sides: Integers = np.where((normals == 0.0).all(axis=1), 0, np.where(side > 0.0, 1, -1))
    return sides


def outlines(edges: MeshEdges, facing: Integers) -> Bools:
    """Return (E,) bool: the edges whose faces with an area all lie on the same side of them, as seen from the eye."""
    side = np.where(edges.forward, 1, -1) * facing[edges.faces]
    one_side: Bools = np.abs(edges.sums(side)) == edges.sums(side != 0)
    return one_side


_LEAST_CELL, _LARGEST_CELL = 10, 12  # bits of 1/256 px: 4 to 16 px
_MOST_CELLS = 1 << 20


def _cut(points: Floats, distance: Floats) -> tuple[Floats, Bools]:
    """Cut segments (L, 2, 3) to where the distance (L, 2) of their points is not negative; of each at least one is not.
    Returns the points, and which are new, (L, 2).

    A crossing is computed from the end nearer the plane: an end 1e38 away costs no digits.
    """
    first = np.abs(distance[:, 0]) <= np.abs(distance[:, 1])
    order = np.where(first[:, None], [0, 1], [1, 0])
    a, b = (np.take_along_axis(points, order[:, [k], None], axis=1)[:, 0] for k in (0, 1))
    da, db = (np.take_along_axis(distance, order[:, [k]], axis=1) for k in (0, 1))
    outside = distance < 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        crossing = a + (da / (da - db)) * (b - a)
    return np.where(outside[..., None], crossing[:, None], points), outside


def _cut_to_guard_band(points: Floats, space: CameraSpace) -> tuple[Floats, Integers]:
    """Cut segments (L, 2, 3) before the eye to the guard band; return those that are left, and their indices."""
    camera, index = space.camera, np.arange(len(points))
    for axis, side, slope, offset in clip.guard_planes(camera):
        depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
        distance = side * (slope * points[..., axis]) + side * offset * depth
        kept = (distance >= 0.0).any(axis=1)
        points, made = _cut(points[kept], distance[kept])
        index = index[kept]
        depth = np.ones(points.shape[:2]) if camera.orthographic else points[..., 2]
        points[..., axis] = np.where(made, -offset * depth / slope, points[..., axis])
    return points, index


def _clipped(points: Floats, space: CameraSpace) -> tuple[Floats, Integers]:
    """Clip segments (L, 2, 3), camera space, to the near plane and the guard band. Returns those that are left, (K, 2, 3),
    and their indices (K,)."""
    before = points[..., 2] >= space.near
    index = np.flatnonzero(before.any(axis=1))
    crossing = np.flatnonzero(~before[index].all(axis=1))
    points = points[index]
    cut, made = _cut(points[crossing], points[crossing][..., 2] - space.near)
    cut[..., 2] = np.where(made, space.near, cut[..., 2])
    points[crossing] = cut
    with np.errstate(over="ignore", invalid="ignore"):
        beyond = clip.beyond_guard_band(points, space.camera)
    far = np.flatnonzero(beyond.any(axis=(1, 2)))
    cut, left = _cut_to_guard_band(points[far], space)
    points[far[left]] = cut
    gone = np.zeros(len(points), bool)
    gone[far] = True
    gone[far[left]] = False
    return points[~gone], index[~gone]


def _scaled_w(z: Floats, space: CameraSpace) -> Floats:
    """Return 1/depth, scaled, of depths z, as `project` has it."""
    depth = np.minimum(z * space.scale, MOST_DEPTH)
    return -depth if space.camera.orthographic else 1.0 / depth


def _on_line_grid(snapped: Integers) -> Integers:
    """Round snapped positions to the samples' grid, 1/256 px, on which lines cover them: halves up."""
    shift = SUBPIXEL_BITS - SAMPLE_BITS
    return (snapped + (1 << shift - 1)) >> shift


def segments(
    ends: Integers, positions: Array, vertices: Array, space: CameraSpace, width: int, structs: Structs
) -> tuple[Array, Integers]:
    """Return a table (L,) of `structs.Line`, without what concerns faces, of the edges that may reach the image, and their
    indices (L,).

    ends: (E, 2) indices of positions (V, 3), world space, and of vertices (V,), what `project` makes of them. width: of
    the lines, 1/256 px.
    """
    before = vertices["depth"] >= space.near
    at = np.stack([vertices["x"], vertices["y"]], axis=-1).astype(np.int64)
    whole = (before & (np.abs(at) < SNAP_LIMIT).all(axis=1))[ends].all(axis=1)
    z = np.where(before, vertices["depth"], space.near)  # only those before the near plane are read
    index = np.flatnonzero(whole)
    xy, w = _on_line_grid(at[ends[index]]), _scaled_w(z, space)[ends[index]]
    rest = np.flatnonzero(before[ends].any(axis=1) & ~whole)
    if len(rest):
        points, left = _clipped(space.points(positions[ends[rest]]), space)
        index = np.concatenate([index, rest[left]])
        snapped = clip.snap(clip.image_positions(points, space.camera), space.raster)
        xy = np.concatenate([xy, _on_line_grid(snapped)])
        w = np.concatenate([w, _scaled_w(points[..., 2], space)])
    size = np.array(space.camera.resolution) << SAMPLE_BITS
    reach = (width + 1) // 2
    low, high = np.minimum(xy[:, 0], xy[:, 1]), np.maximum(xy[:, 0], xy[:, 1])
    seen = ((high >= -reach) & (low <= size + reach)).all(axis=1)
    if not seen.all():
        index, xy, w = index[seen], xy[seen], w[seen]
    lines = np.zeros(len(index), structs.Line)
    lines["x"], lines["y"], lines["w"] = xy[..., 0], xy[..., 1], w
    with np.errstate(divide="ignore"):
        dx, dy = (xy[:, 1] - xy[:, 0]).astype(np.float64).T
        lines["inset"] = np.minimum(LINE_INSET / np.sqrt(dx * dx + dy * dy), 0.5)
    return lines, index


def line_grid(lines: Array, space: CameraSpace, width: int, structs: Structs) -> Array:
    """Return the one row of `structs.LineGrid`: cells about as long as the lines (L,), over the image and as far
    around it as a line reaches. The cells change only how long the search for what hides a line takes."""
    reach, size = (width + 1) // 2, np.array(space.camera.resolution, np.int64) << SAMPLE_BITS
    dx, dy = (lines[name][:, 1].astype(np.float64) - lines[name][:, 0] for name in ("x", "y"))
    length = float(np.sqrt(dx * dx + dy * dy).mean()) if len(lines) else 0.0
    bits = min(max(math.ceil(math.log2(max(length, 1.0))), _LEAST_CELL), _LARGEST_CELL)
    while (size >> bits).prod() > _MOST_CELLS:
        bits += 1
    margin = -(-reach // (1 << bits))
    grid = np.zeros(1, structs.LineGrid)
    grid["cell_bits"], grid["margin"], grid["width"] = bits, margin, width
    grid["across"], grid["up"] = (-(-size // (1 << bits)) + 2 * margin).tolist()
    return grid


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
        space, events, source, vertices = frame.space, frame.events, self._source, self._source.vertices
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
        grid = Buffer(device, line_grid(lines, space, self._asked.steps, stages.structs))
        columns, rows = space.camera.resolution
        shown = Buffer(device, np.zeros((rows, columns, 2), np.uint64))
        values: dict[str, Any] = {**frame.values, **source.sides, "faces": source.faces, "vertices": vertices.projected}
        values |= {"pieces": triangles.pieces, "ranks": ranks, "view": frame.tables.view, "face_count": source.room}
        values |= {"lines": Buffer(device, lines), "grid": grid, "edge_faces": self._edge_faces}
        values |= {"listed": None, "hiders": None, "writes": False}  # only counted at first
        cells = int(grid.array[0]["across"]) * int(grid.array[0]["up"])
        cursors = [Buffer(device, np.zeros(cells, np.uint32)) for _ in range(2)]
        counts = len(lines), source.room + len(triangles.pieces.array)
        for name, cells_of, count in zip(("list_lines", "list_hiders"), cursors, counts, strict=True):
            stages.run(name, items(count), values, cursors=cells_of, count=count)
        starts = []
        for buffer in cursors:
            begin = np.concatenate([[0], np.cumsum(buffer.to_host(), dtype=np.int64)])
            starts.append(Buffer(device, begin.astype(np.uint32)))
            with buffer.writing() as rows_of:
                rows_of[:] = begin[:-1]
            if begin[-1] >= 1 << 32:
                raise DeviceError(f"{device.name}: edges: expected lists of less than 2^32 entries, found {begin[-1]}")
        self._make_room(*(int(buffer.array[-1]) for buffer in starts))
        values |= {"listed": self._listed, "hiders": self._hiders, "writes": True}
        for name, cells_of, count in zip(("list_lines", "list_hiders"), cursors, counts, strict=True):
            events[name] = stages.run(name, items(count), values, cursors=cells_of, count=count)
        values |= {"line_starts": starts[0], "starts": starts[1], "shown": shown}
        group = 1 if device.is_cpu else 64
        events["line_samples"] = stages.run("line_samples", (cells * group, group), values)
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
