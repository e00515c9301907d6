"""Lines along edges: which samples show one. Every sample is compared with every line, and every line with every triangle.

A sample belongs to a line if it is at most half the width away from it, by integers. Let q be the point of the line,
less an inset at either end, that is nearest to the sample. A triangle hides the line there if it does not contain the
edge, covers q, and is nearer than the line at q by more than moving its corners by 1/512 px could change, twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers
from ..scene.model import Edges, Scene, Settings
from .clip import GUARD, Pieces, beyond_guard, guard_planes
from .coverage import signed_area
from .sampling import places
from .transform import (
    SAMPLE_STEPS,
    SUBPIXELS,
    Lens,
    camera_frame,
    lens_of,
    near_distance,
    painter_depth,
    project,
    snap,
    to_camera,
)
from .vectors import cross, dot

INSET = 64  # 1/256 px from the ends of a line, at most up to its middle
SLACK = 2.0**-12  # 1/256 px by which triangles cover more
ROUNDED_TWICE = 1.0 + 2.0**-8  # 1/256 px and 1/65536 px, in 1/256 px
EQUAL = 2.0**-40  # relative difference of 1/depths that count as equal
CELLS = (128, 8)  # pixels looked at together: of large cells the small ones
BATCH = 1 << 20  # pairs compared at a time
NONE, LINE, MARKED = 0, 1, 2  # what a sample shows; marked: an edge of more than two faces


@dataclass(frozen=True, eq=False)
class MeshEdges:
    """ends: (E, 2, 3) positions. face, edge, forward: (K,) which face contains which edge, and whether it runs along it
    from its first end to its second."""

    ends: Floats
    face: Integers
    edge: Integers
    forward: Bools


@dataclass(frozen=True, eq=False)
class Lines:
    """xy: (L, 2, 2) snapped ends, 1/256 px. w: (L, 2) 1/depth, orthographic -depth; in painter's order minus the rank of
    the first face. edge: (L,)."""

    xy: Integers
    w: Floats
    edge: Integers


def mesh_edges(world: Floats) -> MeshEdges:
    """Return the edges of faces (F, 3, 3). Equal positions are one vertex; faces with two equal corners have no edges."""
    positions, corner = np.unique(world.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    corner = corner.reshape(-1, 3)
    start, end = corner, np.roll(corner, -1, axis=1)
    face, side = np.nonzero((start != end).all(axis=1)[:, None] & np.ones((1, 3), bool))
    pair = np.stack([start[face, side], end[face, side]], axis=1)
    ends, edge = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True)
    return MeshEdges(positions[ends], face, edge.reshape(-1), pair[:, 0] < pair[:, 1])


def drawn_edges(edges: MeshEdges, world: Floats, asked: Edges, scene: Scene, front_only: Bools) -> Bools:
    """Return (E,) bool: the edges asked for, of which a face is drawn. front_only: (F,) faces that are culled from
    behind."""
    normal = cross(world[:, 1] - world[:, 0], world[:, 2] - world[:, 0])
    camera = scene.camera
    towards = camera.eye - world[:, 0]
    if camera.orthographic:
        towards = np.broadcast_to(-camera_frame(camera.eye, camera.lookat, camera.up)[2], normal.shape)
    front, flat = dot(normal, towards) > 0.0, (normal == 0.0).all(axis=1)
    count = np.bincount(edges.edge, minlength=len(edges.ends))
    found = np.zeros(len(edges.ends), bool)
    if "all" in asked.kinds:
        found[:] = True
    if "boundary" in asked.kinds:
        found |= count == 1
    if "nonmanifold" in asked.kinds:
        found |= count > 2
    if "silhouette" in asked.kinds:
        left = front[edges.face] == edges.forward  # on which side of the edge the face lies in the image
        with_area = ~flat[edges.face]
        sides = [np.bincount(edges.edge[with_area & (left == side)], minlength=len(found)) for side in (False, True)]
        found |= (sides[0] == 0) | (sides[1] == 0)
    if "feature" in asked.kinds:
        found |= _sharp(edges, normal, count, asked.angle)
    seen = np.bincount(edges.edge[(front | ~front_only)[edges.face]], minlength=len(found)) > 0
    return found & seen


def _sharp(edges: MeshEdges, normal: Floats, count: Integers, angle: float) -> Bools:
    order = np.lexsort((edges.face, edges.edge))
    pairs = np.flatnonzero(count == 2)
    first = order[np.searchsorted(edges.edge[order], pairs)]
    second = order[np.searchsorted(edges.edge[order], pairs) + 1]
    with np.errstate(invalid="ignore"):
        a, b = (
            v / np.abs(v).max(axis=1, initial=0.0, keepdims=True)
            for v in (normal[edges.face[first]], normal[edges.face[second]])
        )
        cosine = dot(a, b) / np.sqrt(dot(a, a) * dot(b, b))
    sharp = np.zeros(len(count), bool)
    sharp[pairs] = np.where(edges.forward[first] == edges.forward[second], -cosine, cosine) < np.cos(np.radians(angle))
    return sharp


def _cut(points: Floats, distance: Floats) -> tuple[Floats, Bools] | None:
    """Cut a segment (2, 3) to where the distance (2,) is not negative. Also returns which ends are new."""
    outside = distance < 0.0
    if outside.all():
        return None
    a, b = (0, 1) if abs(distance[0]) <= abs(distance[1]) else (1, 0)
    crossing = points[a] + distance[a] / (distance[a] - distance[b]) * (points[b] - points[a]) if outside.any() else 0.0
    return np.where(outside[:, None], crossing, points), outside


def clip_segment(points: Floats, near: float, lens: Lens) -> Floats | None:
    """Clip a segment (2, 3), camera space, to the near plane and, if it exceeds it, to the guard band."""
    found = _cut(points, points[:, 2] - near)
    if found is None:
        return None
    points, made = found
    points[made, 2] = near
    if not beyond_guard(project(points, *lens)):
        return points
    for axis, side, slope, offset in guard_planes(lens):
        depth = np.ones(2) if lens.orthographic else points[:, 2]
        found = _cut(points, side * (slope * points[:, axis]) + side * offset * depth)
        if found is None:
            return None
        points, made = found
        depth = np.ones(2) if lens.orthographic else points[:, 2]
        points[made, axis] = -offset * depth[made] / slope
    return points


def lines_of(ends: Floats, edge: Integers, scene: Scene, near: float) -> Lines:
    """Return the lines of edges (E, 2, 3) with these numbers (E,), as far as they lie before the near plane."""
    camera, lens = scene.camera, lens_of(scene.camera)
    points = to_camera(ends, camera.eye, camera_frame(camera.eye, camera.lookat, camera.up))
    with np.errstate(all="ignore"):
        simple = (points[..., 2] >= near).all(axis=1) & ~beyond_guard(project(points, *lens))
        kept, numbers = [points[simple]], [edge[simple]]
        for k in np.flatnonzero(~simple):
            cut = clip_segment(points[k], near, lens)
            if cut is not None:
                kept.append(cut[None])
                numbers.append(edge[k : k + 1])
    points = np.concatenate(kept)
    w = -points[..., 2] if lens.orthographic else 1.0 / points[..., 2]
    return Lines(on_line_grid(snap(np.clip(project(points, *lens), *GUARD))), w, np.concatenate(numbers))


def on_line_grid(xy: Integers) -> Integers:
    """Round snapped coordinates to the samples' grid, 1/256 px, on which lines are covered and hidden: halves up."""
    step = SUBPIXELS // SAMPLE_STEPS
    return (xy + step // 2) // step


def samples_with_lines(
    scene: Scene,
    settings: Settings,
    world: Floats,
    cut: Pieces,
    z: Floats,
    front_only: Bools,
    pixels: tuple[Array, Array],
) -> Integers:
    """Return what each sample of pixels shows, NONE, LINE or MARKED: (S, K).

    world: (F, 3, 3) faces. cut: the triangles drawn. z: (F, 3) depths of the faces. front_only: (F,) bool. pixels: columns
    and rows from the BOTTOM, (K,) each.
    """
    asked = settings.edges
    shown = np.zeros((settings.samples, len(pixels[0])), np.int64)
    edges = mesh_edges(world)
    if asked is None or not len(edges.ends):
        return shown
    drawn = np.flatnonzero(drawn_edges(edges, world, asked, scene, front_only))
    before = near_distance(world.reshape(-1, 3), scene.camera.eye, scene.camera.lookat, settings.near)
    lines = lines_of(edges.ends[drawn], drawn, scene, before)
    corners = on_line_grid(cut.xy)
    area = signed_area(corners)
    hiding = np.flatnonzero((area != 0) & ~((front_only[cut.face]) & (area < 0)))
    w = -cut.z if scene.camera.orthographic else 1.0 / cut.z
    if settings.visibility == "painter":
        rank = np.empty(len(z))
        rank[np.lexsort((-np.arange(len(z)), painter_depth(z)))] = np.arange(len(z))
        first = np.full(len(edges.ends), np.inf)
        np.minimum.at(first, edges.edge, rank[edges.face])
        lines = Lines(lines.xy, -np.repeat(first[lines.edge][:, None], 2, axis=1), lines.edge)
        w = -np.repeat(rank[cut.face][:, None], 3, axis=1)
    marked = np.bincount(edges.edge)[lines.edge] > 2
    own = np.unique(edges.edge * len(world) + edges.face)
    offsets = places(settings.samples)

    def points(mine: Integers) -> Integers:
        corner = np.stack([pixels[0][mine], pixels[1][mine]], axis=1) * SAMPLE_STEPS
        return (corner[None] + offsets[:, None]).reshape(-1, 2)

    for mine, near_lines, near in _cells(pixels, points, lines.xy, corners, hiding, asked.steps):
        p = points(mine)
        kinds = np.zeros(len(p), np.int64)
        for sample, line in _covered(p, lines.xy[near_lines], asked.steps):
            line = near_lines[line]
            q, depth = nearest_points(p[sample], lines.xy[line], lines.w[line])
            owner = lines.edge[line] * len(world)
            seen = ~_hidden(q, depth, corners[near], w[near], owner, cut.face[near], own, settings)
            np.maximum.at(kinds, sample[seen], np.where(marked[line[seen]], MARKED, LINE))
        shown[:, mine] = kinds.reshape(settings.samples, -1)
    return shown


def _cells(
    pixels: tuple[Array, Array],
    points: Callable[[Integers], Integers],
    lines: Integers,
    pieces: Integers,
    hiding: Integers,
    width: int,
) -> Iterator[tuple[Integers, Integers, Integers]]:
    """Yield indices of pixels in the same cell of the image, and of the lines (L, 2, 2), and those of the pieces (T, 3, 2)
    in `hiding`, that come near their sample points."""
    for large in _groups(pixels, np.arange(len(pixels[0])), CELLS[0]):
        some_lines = _touching(lines, points(large), width)
        some_pieces = hiding[_touching(pieces[hiding], points(large), width + 2 * INSET)]
        for small in _groups(pixels, large, CELLS[1]):
            near_lines = some_lines[_touching(lines[some_lines], points(small), width)]
            near_pieces = some_pieces[_touching(pieces[some_pieces], points(small), width + 2 * INSET)]
            yield small, near_lines, near_pieces


def _groups(pixels: tuple[Array, Array], some: Integers, size: int) -> list[Integers]:
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
        ours = 4.0 * np.square((r[..., 0] * d[..., 1] - r[..., 1] * d[..., 0]).astype(np.float64))
        most = float(width * width) * length2.astype(np.float64)
        inside = np.where(between, ours <= most, inside)
        for i, j in np.argwhere(between & (np.abs(ours - most) <= 1e-9 * most)):
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


def _hidden(
    q: Floats, depth: Floats, xy: Integers, w: Floats, edge: Integers, face: Integers, own: Integers, settings: Settings
) -> Bools:
    """Return which points q (K, 2) at `depth` (K,) of edges (K,) triangles (T, 3, 2) with w (T, 3) of faces (T,) hide.
    own: pairs of edge and face, edge + face each."""
    found = np.zeros(len(q), bool)
    turn = np.sign(signed_area(xy))
    area = np.abs(signed_area(xy)).astype(np.float64)
    step = max(1, BATCH // max(1, len(q)))
    for start in range(0, len(xy), step):
        some = slice(start, start + step)
        ahead = slope_x = slope_y = np.zeros(())
        covers = np.ones((len(q), len(area[some])), bool)
        for k in range(3):
            i, j = xy[some, (k + 1) % 3], xy[some, (k + 2) % 3]
            a, b = ((i[:, 1] - j[:, 1]) * turn[some]).astype(float), ((j[:, 0] - i[:, 0]) * turn[some]).astype(float)
            e = a * (q[:, None, 0] - i[:, 0]) + b * (q[:, None, 1] - i[:, 1])
            covers &= ~(e < -((np.abs(a) + np.abs(b)) * SLACK))
            nearer = w[some, k] - depth[:, None]
            ahead, slope_x, slope_y = ahead + e * nearer, slope_x + a * nearer, slope_y + b * nearer
        if settings.visibility == "painter":
            before = w[some, 0] > depth[:, None]
        else:
            least = (np.abs(slope_x) + np.abs(slope_y)) * ROUNDED_TWICE + (EQUAL * np.abs(depth[:, None])) * area[some]
            before = ahead - least > 0.0
        at, triangle = np.nonzero(covers & before)
        foreign = ~np.isin(edge[at] + face[some][triangle], own)
        found[at[foreign]] = True
    return found
