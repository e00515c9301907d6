"""Lines along edges: which samples show one. Every sample is compared with every line, and every line with every triangle.

A sample belongs to a line if it is at most half the width away from it, by integers. Let q be the point of the line,
less an inset at either end, that is nearest to the sample. A triangle hides the line there if it does not contain the
edge, covers q, and is nearer than the line at q by more than moving its corners by 1/512 px could change, twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..base.arrays import Bools, Floats, Integers
from ..scene.model import Edges
from .clip import GUARD, beyond_guard, clip_guard, clip_near
from .coverage import painter_order, places, signed_area
from .shot import Shot
from .transform import SAMPLE_STEPS, SUBPIXELS, camera_frame, cross, dot, near_distance, project, snap, to_camera

INSET = 64  # 1/256 px from the ends of a line, at most up to its middle
SLACK = 2.0**-12  # 1/256 px by which triangles cover more
ROUNDED_TWICE = 1.0 + 2.0**-8  # 1/256 px and 1/65536 px, in 1/256 px
EQUAL = 2.0**-40  # relative difference of 1/depths that count as equal
CELLS = (128, 8)  # pixels looked at together: of large cells the small ones
BATCH = 1 << 20  # pairs compared at a time
NONE, LINE, MARKED = 0, 1, 2  # kinds of lines at samples; marked: an edge of more than two faces


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """E edges, and the K places where a face contains one."""

    ends: Floats  # (E, 2, 3) positions
    face: Integers  # (K,)
    edge: Integers  # (K,)
    forward: Bools  # (K,), whether the face runs along the edge from its first end to its second


@dataclass(frozen=True, eq=False)
class Lines:
    """L edges in the image."""

    xy: Integers  # (L, 2, 2) snapped ends, 1/256 px
    w: Floats  # (L, 2) 1/depth, orthographic -depth; in painter's order minus the rank of the first face
    edge: Integers  # (L,)


@dataclass(frozen=True, eq=False)
class Occluders:
    """Triangles that may hide lines."""

    xy: Integers  # (T, 3, 2) snapped corners, 1/256 px
    w: Floats  # (T, 3), see `Lines`
    face: Integers  # (T,)
    containing: Integers  # pairs of an edge and a face that contains it: edge * faces + face

    def __getitem__(self, index: slice | Integers) -> Occluders:
        return replace(self, xy=self.xy[index], w=self.w[index], face=self.face[index])


def mesh_edges(world: Floats) -> MeshEdges:
    """Return the edges of faces (F, 3, 3). Equal positions are one vertex; faces with two equal corners have no edges."""
    positions, corner = np.unique(world.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    start, end = corner, np.roll(corner, -1, axis=1)
    face, side = np.nonzero((start != end).all(axis=1)[:, None] & np.ones((1, 3), bool))
    pair = np.stack([start[face, side], end[face, side]], axis=1)
    ends, edge = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True)
    return MeshEdges(positions[ends], face, edge.reshape(-1), pair[:, 0] < pair[:, 1])


def drawn_edges(edges: MeshEdges, shot: Shot, style: Edges) -> Bools:
    """Return (E,) bool: the edges of the kinds to draw, of which a face is drawn."""
    world, camera = shot.corners.world, shot.scene.camera
    normal = cross(world[:, 1] - world[:, 0], world[:, 2] - world[:, 0])
    towards = camera.eye - world[:, 0]
    if camera.orthographic:
        towards = np.broadcast_to(-camera_frame(camera)[2], normal.shape)
    front, flat = dot(normal, towards) > 0.0, (normal == 0.0).all(axis=1)
    count = np.bincount(edges.edge, minlength=len(edges.ends))
    visible = np.full(len(edges.ends), "all" in style.kinds)
    if "boundary" in style.kinds:
        visible |= count == 1
    if "nonmanifold" in style.kinds:
        visible |= count > 2
    if "silhouette" in style.kinds:
        left = front[edges.face] == edges.forward  # on which side of the edge the face lies in the image
        with_area = ~flat[edges.face]
        sides = [np.bincount(edges.edge[with_area & (left == side)], minlength=len(visible)) for side in (False, True)]
        visible |= (sides[0] == 0) | (sides[1] == 0)
    if "feature" in style.kinds:
        visible |= _sharp(edges, normal, count, style.angle)
    faces = edges.edge[(front | ~shot.backs_culled)[edges.face]]
    return np.asarray(visible & (np.bincount(faces, minlength=len(visible)) > 0))


def _sharp(edges: MeshEdges, normal: Floats, count: Integers, angle: float) -> Bools:
    order = np.lexsort((edges.face, edges.edge))
    pairs = np.flatnonzero(count == 2)
    first = np.searchsorted(edges.edge[order], pairs)
    both = order[first], order[first + 1]
    with np.errstate(invalid="ignore"):
        largest = (np.abs(normal[edges.face[side]]).max(axis=1, initial=0.0, keepdims=True) for side in both)
        a, b = (normal[edges.face[side]] / size for side, size in zip(both, largest, strict=True))
        cosine = dot(a, b) / np.sqrt(dot(a, a) * dot(b, b))
    sharp, alike = np.zeros(len(count), bool), edges.forward[both[0]] == edges.forward[both[1]]
    sharp[pairs] = np.where(alike, -cosine, cosine) < np.cos(np.radians(angle))
    return sharp


def lines_of(ends: Floats, edge: Integers, shot: Shot) -> Lines:
    """Return the lines of edges (E, 2, 3) with these numbers (E,), as far as they lie before the near plane."""
    camera, corners = shot.scene.camera, shot.corners.world.reshape(-1, 3)
    points, near = to_camera(ends, camera), near_distance(corners, camera, shot.settings.near)
    with np.errstate(all="ignore"):
        simple = (points[..., 2] >= near).all(axis=1) & ~beyond_guard(project(points, camera))
        kept, numbers = [points[simple]], [edge[simple]]
        for k in np.flatnonzero(~simple):
            cut, weights = clip_near(points[k], np.zeros((2, 0)), near)  # as a polygon of two corners
            if len(cut) and beyond_guard(project(cut, camera)):
                cut, _ = clip_guard(cut, weights, camera)
            if len(cut):
                kept.append(cut[None, :2])
                numbers.append(edge[k : k + 1])
    points = np.concatenate(kept)
    w = -points[..., 2] if camera.orthographic else 1.0 / points[..., 2]
    return Lines(on_line_grid(snap(np.clip(project(points, camera), *GUARD))), w, np.concatenate(numbers))


def on_line_grid(xy: Integers) -> Integers:
    """Round snapped coordinates to the samples' grid, 1/256 px, on which lines are covered and hidden: halves up."""
    step = SUBPIXELS // SAMPLE_STEPS
    return (xy + step // 2) // step


def samples_with_lines(shot: Shot, column: Integers, row: Integers) -> Integers:
    """Return the kinds of lines at the samples of pixels (columns and rows from the BOTTOM), (K,): (S, K)."""
    style, offsets, faces = shot.settings.edges, places(shot.settings.samples), len(shot.corners.world)
    shown = np.zeros((len(offsets), len(column)), np.int64)
    edges = mesh_edges(shot.corners.world)
    if style is None or not len(edges.ends):
        return shown
    indices = np.flatnonzero(drawn_edges(edges, shot, style))
    lines, occluders = _ranked(shot, edges, lines_of(edges.ends[indices], indices, shot))
    marked = np.bincount(edges.edge)[lines.edge] > 2

    def points(mine: Integers) -> Integers:
        corner = np.stack([column[mine], row[mine]], axis=1) * SAMPLE_STEPS
        return (corner[None] + offsets[:, None]).reshape(-1, 2)

    for mine, near_lines, near in _cells((column, row), points, lines.xy, occluders.xy, style.steps):
        p = points(mine)
        kinds = np.zeros(len(p), np.int64)
        for sample, line in _covered(p, lines.xy[near_lines], style.steps):
            line = near_lines[line]
            q, depth = nearest_points(p[sample], lines.xy[line], lines.w[line])
            hidden = _hidden(q, depth, occluders[near], lines.edge[line] * faces, shot.settings.visibility == "painter")
            np.maximum.at(kinds, sample[~hidden], np.where(marked[line[~hidden]], MARKED, LINE))
        shown[:, mine] = kinds.reshape(len(offsets), -1)
    return shown


def _ranked(shot: Shot, edges: MeshEdges, lines: Lines) -> tuple[Lines, Occluders]:
    """Return the lines, and the triangles that may hide them; in painter's order by the ranks of the faces."""
    cut, z = shot.pieces, shot.z
    w = -cut.z if shot.scene.camera.orthographic else 1.0 / cut.z
    if shot.settings.visibility == "painter":
        rank = np.empty(len(z))
        rank[painter_order(z, np.ones(len(z), bool))] = np.arange(len(z))
        first = np.full(len(edges.ends), np.inf)
        np.minimum.at(first, edges.edge, rank[edges.face])
        lines = replace(lines, w=-np.repeat(first[lines.edge][:, None], 2, axis=1))
        w = -np.repeat(rank[cut.face][:, None], 3, axis=1)
    corners = on_line_grid(cut.xy)
    area = signed_area(corners)
    facing = np.flatnonzero((area != 0) & ~(shot.backs_culled[cut.face] & (area < 0)))
    return lines, Occluders(corners, w, cut.face, np.unique(edges.edge * len(z) + edges.face))[facing]


def _cells(
    pixels: tuple[Integers, Integers],
    points: Callable[[Integers], Integers],
    lines: Integers,
    occluders: Integers,
    width: int,
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield indices of pixels in the same cell of the image, and of the lines (L, 2, 2) and occluders (T, 3, 2) that come
    near their sample points."""
    for large in _groups(pixels, np.arange(len(pixels[0])), CELLS[0]):
        some_lines = _touching(lines, points(large), width)
        some_occluders = _touching(occluders, points(large), width + 2 * INSET)
        for small in _groups(pixels, large, CELLS[1]):
            near_lines = some_lines[_touching(lines[some_lines], points(small), width)]
            near_occluders = some_occluders[_touching(occluders[some_occluders], points(small), width + 2 * INSET)]
            yield small, near_lines, near_occluders


def _groups(pixels: tuple[Integers, Integers], some: Integers, size: int) -> list[Integers]:
    """Split the indices `some` of pixels by square cells of the image."""
    cell = (pixels[1][some] // size) * (1 << 20) + pixels[0][some] // size
    order = np.argsort(cell, kind="stable")
    return [mine for mine in np.split(some[order], np.flatnonzero(np.diff(cell[order])) + 1) if len(mine)]


def _touching(xy: Integers, p: Integers, more: int) -> Integers:
    """Return the indices of boxes around corners xy (T, n, 2) that come within `more` of the box around points p (P, 2)."""
    low, high = p.min(axis=0) - more, p.max(axis=0) + more
    return np.flatnonzero(((xy.max(axis=1) >= low) & (xy.min(axis=1) <= high)).all(axis=1))


def _covered(p: Integers, xy: Integers, width: int) -> Iterator[tuple[Integers, Integers]]:
    """Yield which of the points (P, 2) which lines (L, 2, 2) of this width cover: indices of both."""
    step = max(1, BATCH // max(1, len(p)))
    for start in range(0, len(xy), step):
        a, b = xy[start : start + step, 0], xy[start : start + step, 1]
        d, r = b - a, p[:, None] - a
        along, length2 = (r * d).sum(axis=-1), (d * d).sum(axis=-1)
        beyond = along >= length2
        end = np.where(beyond[..., None], r - d, r)
        inside = 4 * (end * end).sum(axis=-1) <= width * width
        between = (along > 0) & ~beyond
        offset2 = 4.0 * np.square((r[..., 0] * d[..., 1] - r[..., 1] * d[..., 0]).astype(np.float64))
        limit2 = float(width * width) * length2.astype(np.float64)
        inside = np.where(between, offset2 <= limit2, inside)
        for i, j in np.argwhere(between & (np.abs(offset2 - limit2) <= 1e-9 * limit2)):
            (rx, ry), (dx, dy) = r[i, j].tolist(), d[j].tolist()
            inside[i, j] = 4 * (rx * dy - ry * dx) ** 2 <= width * width * (dx * dx + dy * dy)
        sample, line = np.nonzero(inside)
        if len(sample):
            yield sample, start + line


def nearest_points(p: Integers, xy: Integers, w: Floats) -> tuple[Floats, Floats]:
    """Return the point of each line (K, 2, 2), less the inset, that is nearest to p (K, 2): (K, 2), and its w (K,)."""
    a, d = xy[:, 0], xy[:, 1] - xy[:, 0]
    length2 = (d * d).sum(axis=1).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        inset = np.minimum(INSET / np.sqrt(length2), 0.5)
        t = ((p - a) * d).sum(axis=1).astype(np.float64) / length2
    t = np.minimum(np.maximum(t, inset), 1.0 - inset)
    end_on = length2 == 0.0
    t = np.where(end_on, 0.0, t)
    q: Floats = a + t[:, None] * d.astype(np.float64)
    return q, np.where(end_on, w.max(axis=1), w[:, 0] + t * (w[:, 1] - w[:, 0]))


def _hidden(q: Floats, depth: Floats, occluders: Occluders, edge: Integers, painter: bool) -> Bools:
    """Return which points q (K, 2) at `depth` (K,) of edges (K,), each times the number of faces, triangles hide."""
    hidden = np.zeros(len(q), bool)
    xy, w, area = occluders.xy, occluders.w, signed_area(occluders.xy)
    turn, area = np.sign(area), np.abs(area).astype(np.float64)
    step = max(1, BATCH // max(1, len(q)))
    for start in range(0, len(xy), step):
        some = slice(start, start + step)
        ahead = slope_x = slope_y = np.zeros(())
        covers = np.ones((len(q), len(area[some])), bool)
        for k in range(3):
            i, j = xy[some, k - 2], xy[some, k - 1]
            a, b = ((i[:, 1] - j[:, 1]) * turn[some]).astype(float), ((j[:, 0] - i[:, 0]) * turn[some]).astype(float)
            e = a * (q[:, None, 0] - i[:, 0]) + b * (q[:, None, 1] - i[:, 1])
            covers &= ~(e < -((np.abs(a) + np.abs(b)) * SLACK))
            nearer = w[some, k] - depth[:, None]
            ahead, slope_x, slope_y = ahead + e * nearer, slope_x + a * nearer, slope_y + b * nearer
        if painter:
            before = w[some, 0] > depth[:, None]
        else:
            slack = (np.abs(slope_x) + np.abs(slope_y)) * ROUNDED_TWICE + (EQUAL * np.abs(depth[:, None])) * area[some]
            before = ahead - slack > 0.0
        at, triangle = np.nonzero(covers & before)
        foreign = ~np.isin(edge[at] + occluders.face[some][triangle], occluders.containing)
        hidden[at[foreign]] = True
    return hidden
