"""A whole frame: the owner of each pixel, then the colors of the owned ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from ..base.arrays import Array, Bools, Floats, Integers, UInt32s
from ..scene.model import Scene, Settings
from ..scene.scalar_colors import without_colors
from . import coverage, sampling, shade, transform
from .clip import Pieces, pieces
from .corners import Corners, alpha_passes, gather
from .lines import LINE, MARKED, samples_with_lines
from .pixels import Shaded, shade_pixels

BATCH = 1 << 15  # pixels shaded at a time

# From pieces (K,) with edge functions (K, 3) at a pixel to (K,) bool: which are opaque there.
Opaque = Callable[[Integers, Integers], Bools]
# From triangles (T, 3, 2) with boxes (T, 4) to indices of triangle and covered pixel, (S,), and edge functions (S, 3).
Drawn = Callable[[Integers, Integers], Iterator[tuple[Integers, Integers, Integers]]]


@dataclass(frozen=True, eq=False)
class OracleFrame:
    """The image and the measures of its error. Leading axes (M, N), row 0 at the TOP; float64 unless stated.

    rgb: (M, N, 3) linear, over the background. alpha: (M, N) fraction of the samples covered.
    id: (M, N) uint32, 0 = background, k+1 = face k. Z: (M, N) depth, +inf = background.
    budget: (M, N, 3) the light budget B that errors are relative to; without light max(color, 1), of the background
        its own absolute value.
    conditions: (M, N, 4) the terms of kappa, see `shade.conditions`; 1 where nothing is lit.
    kappa: (M, N) condition number of the light's geometry: how far it amplifies rounding errors.
    jump: (M, N, 3) how much highlights that rounding may open or close (see `shade.jumps`), and colors of a color map that
        it may exchange, can change the color.
    exponent: (M, N) the material's n; 1 without light.
    For gouraud and nolight the measures are those of the worst corner of the triangle. Of several samples id and Z are
    those of the sample nearest the center, kappa, its terms and the exponent the worst of all, budget and jump the mean.
    """

    rgb: Floats
    alpha: Floats
    id: UInt32s
    Z: Floats
    budget: Floats
    conditions: Floats
    jump: Floats
    exponent: Floats

    @property
    def kappa(self) -> Floats:
        return shade.condition_number(self.conditions)

    @property
    def gate(self) -> Bools:
        """(M, N) bool: where rounding may open or close a highlight."""
        return np.asarray((self.jump > 0.0).any(axis=-1))


@dataclass(frozen=True, eq=False)
class Prepared:
    """Geometry of a scene in the image: corners of all faces, their depths z (F, 3), and the pieces to draw."""

    corners: Corners
    z: Floats
    pieces: Pieces
    setup: coverage.Setup


def prepare(scene: Scene, settings: Settings) -> Prepared:
    """Run the stages before the pixels: placement, camera, clipping, projection, snapping, setup."""
    camera = scene.camera
    corners = gather(scene, None if settings.scalars is None else settings.scalars.name)
    axes = transform.camera_frame(camera.eye, camera.lookat, camera.up)
    points = transform.to_camera(corners.world, camera.eye, axes)
    near = transform.near_distance(corners.world.reshape(-1, 3), camera.eye, camera.lookat, settings.near)
    cut = pieces(points, near, transform.lens_of(camera))
    return Prepared(corners, points[:, :, 2], cut, _set_up(scene, settings, corners, cut))


def _set_up(scene: Scene, settings: Settings, corners: Corners, cut: Pieces) -> coverage.Setup:
    setup = coverage.setup(cut.xy, *scene.camera.resolution, settings.cull)
    front_only = _front_only(scene, corners)[cut.face]
    return setup._replace(culled=setup.culled | (front_only & (setup.area < 0)))


def _front_only(scene: Scene, corners: Corners) -> Bools:
    """Return (F,) bool: the faces whose material is drawn from the front only."""
    return np.array([mesh.material.sides == "front" for mesh in scene.meshes], bool)[corners.mesh]


def _lines(scene: Scene, settings: Settings, center: Prepared, columns: Integers, upward: Integers) -> Integers | None:
    """Return what lines the samples of pixels show, (S, K) as of `samples_with_lines`; None if no edges are drawn."""
    if settings.edges is None:
        return None
    front_only = _front_only(scene, center.corners) | settings.cull
    pixels = columns, upward
    return samples_with_lines(scene, settings, center.corners.world, center.pieces, center.z, front_only, pixels)


def samples_of(scene: Scene, settings: Settings, prepared: Prepared) -> list[Prepared]:
    """Return the scene as each sample of the pixels sees it, nearest to the center first: a sample off the center sees
    what the center sees of the scene shifted the other way."""
    views = []
    for place in sampling.places(settings.samples):
        cut = replace(prepared.pieces, xy=prepared.pieces.xy + (coverage.HALF - place))
        views.append(replace(prepared, pieces=cut, setup=_set_up(scene, settings, prepared.corners, cut)))
    return views


def owners(
    prepared: Prepared,
    visibility: str,
    resolution: tuple[int, int],
    opaque: Opaque | None = None,
    orthographic: bool = False,
) -> Integers:
    """Return the piece visible at each pixel, -1 for none: (M, N), row 0 at the BOTTOM.

    `painter`: the first in painter's order of the faces. `depth`: the nearest at the pixel, of equals the later.
    opaque: from pieces (K,) with edge functions (K, 3) at a pixel to (K,) bool, which are opaque there; None: all.
    """
    columns, rows = resolution

    def drawn(xy: Integers, boxes: Integers) -> Iterator[tuple[Integers, Integers, Integers]]:
        for k, column, row, edges in coverage.samples(xy, boxes):
            yield k, row * columns + column, edges

    return _first(prepared, visibility, columns * rows, drawn, opaque, orthographic).reshape(rows, columns)


def owners_at(
    prepared: Prepared,
    visibility: str,
    column: Integers,
    row: Integers,
    opaque: Opaque | None = None,
    orthographic: bool = False,
) -> Integers:
    """Return the same at pixels (column, row from the BOTTOM), (Q,) each: (Q,)."""

    def drawn(xy: Integers, boxes: Integers) -> Iterator[tuple[Integers, Integers, Integers]]:
        return coverage.samples_at(xy, boxes, column, row)

    return _first(prepared, visibility, len(column), drawn, opaque, orthographic)


def _first(
    prepared: Prepared, visibility: str, count: int, drawn: Drawn, opaque: Opaque | None, orthographic: bool
) -> Integers:
    """Return the piece visible at each of `count` pixels. drawn: which piece covers which pixel."""
    cut, alive = prepared.pieces, ~prepared.setup.culled
    if visibility == "painter":
        order = coverage.painter_order(prepared.z[cut.face], alive)
        rank = np.full(count, len(order))
        for k, pixel, edges in drawn(cut.xy[order], prepared.setup.box[order]):
            seen = slice(None) if opaque is None else opaque(order[k], edges)
            np.minimum.at(rank, pixel[seen], k[seen])
        first: Integers = np.append(order, -1)[rank]
        return first
    order = np.flatnonzero(alive)
    owner, nearest = np.full(count, -1), np.full(count, np.inf)
    for k, pixel, edges in drawn(cut.xy[order], prepared.setup.box[order]):
        seen = slice(None) if opaque is None else opaque(order[k], edges)
        k, pixel, edges = k[seen], pixel[seen], edges[seen]
        z = shade.depth(edges, cut.z[order[k]], orthographic)
        np.minimum.at(nearest, pixel, z)
        equal = z == nearest[pixel]  # a later batch holds later pieces only, so the later owner is right
        np.maximum.at(owner, pixel[equal], order[k[equal]])
    return owner


def passes_alpha(scene: Scene, settings: Settings, prepared: Prepared, piece: Integers, edges: Integers) -> Bools:
    """Return (K,) bool: where pixels of pieces (K,), with edge functions (K, 3), pass their material's alpha test."""
    cut = prepared.pieces
    weights = face_weights(scene, settings, prepared, piece, edges)
    return alpha_passes(scene, prepared.corners, cut.face[piece], weights)


def face_weights(scene: Scene, settings: Settings, prepared: Prepared, piece: Integers, edges: Integers) -> Floats:
    """Return weights (K, 3) of the original corners at pixels of pieces (K,) with edge functions (K, 3)."""
    cut = prepared.pieces
    interpolation = "affine" if scene.camera.orthographic else settings.interpolation
    on_piece = shade.barycentrics(edges, cut.z[piece], interpolation)
    weights: Floats = (on_piece[:, :, None] * cut.weights[piece]).sum(axis=1)
    return weights


def weight_condition(prepared: Prepared, piece: Integers, reach: Floats, orthographic: bool) -> Floats:
    """Return how much rounding of camera-space positions in float64 is amplified in barycentric coordinates, (K,), at least
    1. reach: (K,) the largest coordinate of each face's corners.

    A depth is accurate to 2^-53 of that, and so 1/z to reach/z of itself. Where an edge crosses the near plane is a
    quotient by the difference of its depths.
    """
    depths, corner_depths = prepared.pieces.z[piece], prepared.z[prepared.pieces.face[piece]]
    nearest = depths.min(axis=1)
    found = np.ones(len(reach)) if orthographic else np.fmax(reach / nearest, 1.0)
    clipped = (prepared.pieces.weights[piece] != np.eye(3)).any(axis=(1, 2))
    for a, b in zip(corner_depths.T, np.roll(corner_depths, -1, axis=1).T, strict=True):
        crosses = clipped & ((a < nearest) != (b < nearest))
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.where(crosses, np.fmax(found, reach / np.abs(a - b)), found)
    return found


def face_weight_steps(
    scene: Scene, settings: Settings, prepared: Prepared, piece: Integers, column: Integers, row: Integers
) -> tuple[Floats, Floats]:
    """Return the derivatives of `face_weights` to the right and up, (K, 3) each, at pixels (column, row from the
    bottom) on their pieces, (K,) each."""
    cut = prepared.pieces
    interpolation = "affine" if scene.camera.orthographic else settings.interpolation
    edges = coverage.edge_functions(cut.xy[piece], column, row)
    found = []
    for columns, rows in ((1, 0), (0, 1)):
        # Edge functions are linear: the next pixel's differ from this one's by their derivative.
        change = coverage.edge_functions(cut.xy[piece], column + columns, row + rows) - edges
        on_piece = shade.barycentric_steps(edges, change, cut.z[piece], interpolation)
        found.append((on_piece[:, :, None] * cut.weights[piece]).sum(axis=1))
    return found[0], found[1]


def render(scene: Scene, settings: Settings) -> OracleFrame:
    """Render the frame of a scene's own camera."""
    scene = without_colors(scene, settings.scalars)
    camera = scene.camera
    columns, rows = camera.resolution
    center = prepare(scene, settings)
    views = samples_of(scene, settings, center)
    grid_rows, grid_columns = np.divmod(np.arange(rows * columns), columns)
    upward = rows - 1 - grid_rows
    found = []
    for view in views:
        opaque = opaque_test(scene, settings, view)
        owner = owners(view, settings.visibility, camera.resolution, opaque, camera.orthographic)
        found.append(owner[upward, grid_columns])
    flat = _resolved(scene, settings, center, views, np.array(found), grid_columns, upward)
    return OracleFrame(*(_grid(getattr(flat, f.name), rows, columns) for f in fields(OracleFrame)))


def _grid(values: Array, rows: int, columns: int) -> Array:
    return values.reshape(rows, columns, *values.shape[1:])


def sample(scene: Scene, settings: Settings, rows: Integers, columns: Integers) -> OracleFrame:
    """Render some pixels only: rows (from the TOP) and columns, both (K,); leading axis (K,).

    Takes the time of these pixels, and of setting up the scene's triangles.
    """
    scene = without_colors(scene, settings.scalars)
    camera = scene.camera
    columns = np.asarray(columns, np.int64)
    upward = camera.resolution[1] - 1 - np.asarray(rows, np.int64)
    center = prepare(scene, settings)
    views = samples_of(scene, settings, center)
    found = []
    for view in views:
        opaque = opaque_test(scene, settings, view)
        found.append(owners_at(view, settings.visibility, columns, upward, opaque, camera.orthographic))
    return _resolved(scene, settings, center, views, np.array(found), columns, upward)


def _resolved(
    scene: Scene,
    settings: Settings,
    center: Prepared,
    views: list[Prepared],
    owner: Integers,
    columns: Integers,
    upward: Integers,
) -> OracleFrame:
    """Resolve pixels (columns, upward: rows from the bottom), (K,), from the owners of their samples, (S, K), -1 for none.

    center, views: the scene as the pixels' center sees it, and as their samples do.
    """
    lines = _lines(scene, settings, center, columns, upward)
    nearest = _shaded(scene, settings, views[0], owner[0], columns, upward)
    if len(views) == 1:
        return nearest if lines is None else _with_lines(scene, settings, nearest, lines[0])
    total = _background(scene, owner.shape[1])
    if lines is not None:
        owner = np.where((lines > 0) | settings.edges.only, -1, owner)  # type: ignore[union-attr]
    where = sampling.lit_at(owner, settings.sample_shading)
    empty = owner < 0 if lines is None else (owner < 0) & (lines == 0)
    parts: list[tuple[Integers, Integers, OracleFrame]] = [(np.arange(owner.shape[1]), empty.sum(axis=0), total)]
    if lines is not None:
        for kind, color in _line_colors(settings):
            share = (lines == kind).sum(axis=0)
            seen: Integers = np.flatnonzero(share)
            parts.append((seen, share[seen], _plain(color, len(seen))))
    for s, view in enumerate([*views, center]):
        share = ((where == s) & (owner >= 0)).sum(axis=0)
        lit: Integers = np.flatnonzero(share)
        parts.append(
            (lit, share[lit], _shaded(scene, settings, view, owner[s % len(views), lit], columns[lit], upward[lit]))
        )
    weights = [share / len(views) * sampling.weight(part.rgb, settings.resolve) for _, share, part in parts]
    if settings.resolve == "weighted" and scene.background is None:
        weights[0] = np.zeros_like(weights[0])  # without a background only covered samples have a color to weigh
    whole, rgb = np.zeros(len(total.Z)), np.zeros_like(total.rgb)
    for (lit, _, part), weight in zip(parts, weights, strict=True):
        whole[lit] += weight
        rgb[lit] += weight[:, None] * part.rgb
    alpha = (~empty).sum(axis=0) / len(views)
    if settings.resolve == "weighted" and scene.background is None:
        whole = np.where(alpha > 0.0, whole / np.maximum(alpha, 1e-9), 1.0)  # premultiplied
    rgb /= whole[:, None]
    shared = [(lit, weight / whole[lit], part) for (lit, _, part), weight in zip(parts, weights, strict=True)]
    budget, jump = _mean_budgets(shared, rgb, settings.resolve)
    conditions, exponent = total.conditions.copy(), total.exponent.copy()
    for lit, _, part in parts:
        worse = part.kappa > shade.condition_number(conditions[lit])
        conditions[lit[worse]] = part.conditions[worse]
        exponent[lit] = np.maximum(exponent[lit], part.exponent)
    measures = {"budget": budget, "conditions": conditions, "jump": jump, "exponent": exponent}
    return OracleFrame(rgb=rgb, alpha=alpha, id=nearest.id, Z=nearest.Z, **measures)


def _mean_budgets(
    parts: Sequence[tuple[Integers, Floats, OracleFrame]], rgb: Floats, resolve: str
) -> tuple[Floats, Floats]:
    """Return budget and jump, (K, 3) each, of pixels with colors rgb (K, 3).

    parts: which pixels some samples belong to, the weight of these samples in each pixel, and what they see.
    """
    budget, jump = np.zeros_like(rgb), np.zeros_like(rgb)
    for lit, share, part in parts:
        most = part.budget
        if resolve == "weighted":  # an error of a color changes its weight too
            apart = (np.abs(part.rgb) + np.abs(rgb[lit])) * sampling.weight(part.rgb, resolve)[:, None]
            most = most + apart * most.max(axis=-1, keepdims=True)
        budget[lit] += share[:, None] * most
        jump[lit] += share[:, None] * part.jump
    if resolve == "weighted":  # a jump changes the weights too, and not by little
        jump = np.where((jump > 0.0).any(axis=-1, keepdims=True), budget, 0.0)
    return budget, jump


def opaque_test(scene: Scene, settings: Settings, prepared: Prepared) -> Opaque | None:
    """Return the alpha test of a scene, None if no material has one."""
    tested = any(mesh.material.alpha_cutoff is not None for mesh in scene.meshes)
    return partial(passes_alpha, scene, settings, prepared) if tested else None


def _shaded(
    scene: Scene, settings: Settings, prepared: Prepared, owner: Integers, columns: Integers, upward: Integers
) -> OracleFrame:
    """Shade pixels (columns, upward: rows from the bottom) of pieces `owner`, -1 for none; (K,) each."""
    frame = _background(scene, len(owner))
    drawn = np.flatnonzero(owner >= 0)
    for start in range(0, len(drawn), BATCH):
        batch = drawn[start : start + BATCH]
        shaded, z = _shade_batch(scene, settings, prepared, owner[batch], columns[batch], upward[batch])
        frame.alpha[batch] = 1.0
        frame.id[batch] = prepared.pieces.face[owner[batch]] + 1
        frame.Z[batch] = z
        for f in fields(Shaded):
            getattr(frame, f.name)[batch] = getattr(shaded, f.name)
    return frame


def _line_colors(settings: Settings) -> tuple[tuple[int, Floats], ...]:
    edges = settings.edges
    assert edges is not None
    return (LINE, np.array(edges.color)), (MARKED, np.array(edges.nonmanifold_color))


def _with_lines(scene: Scene, settings: Settings, frame: OracleFrame, lines: Integers) -> OracleFrame:
    """Put lines (K,) over pixels (K,) of a single sample; id and Z stay those of the surface."""
    if settings.edges is not None and settings.edges.only:
        frame = replace(_background(scene, len(frame.Z)), id=frame.id, Z=frame.Z)
    for kind, color in _line_colors(settings):
        mine = lines == kind
        line = _plain(color, int(mine.sum()))
        frame.alpha[mine] = 1.0
        for name in ("rgb", "budget", "conditions", "jump", "exponent"):
            getattr(frame, name)[mine] = getattr(line, name)
    return frame


def _background(scene: Scene, count: int) -> OracleFrame:
    return _plain(np.zeros(3) if scene.background is None else scene.background, count)


def _plain(color: Floats, count: int) -> OracleFrame:
    """Return pixels of one color that nothing covers."""
    return OracleFrame(
        rgb=np.tile(color, (count, 1)),
        alpha=np.zeros(count),
        id=np.zeros(count, np.uint32),
        Z=np.full(count, np.inf),
        budget=np.tile(np.abs(color), (count, 1)),
        conditions=np.ones((count, 4)),
        jump=np.zeros((count, 3)),
        exponent=np.ones(count),
    )


def _shade_batch(
    scene: Scene, settings: Settings, prepared: Prepared, piece: Integers, column: Integers, row: Integers
) -> tuple[Shaded, Floats]:
    """Shade pixels (column, row from the bottom) on their pieces, (K,) each; return also their depths (K,)."""
    cut = prepared.pieces
    edges = coverage.edge_functions(cut.xy[piece], column, row)
    weights = face_weights(scene, settings, prepared, piece, edges)
    behind = prepared.setup.area[piece] < 0
    steps = None
    if settings.texture_filter == "trilinear":
        steps = face_weight_steps(scene, settings, prepared, piece, column, row)
    reach = np.abs(prepared.corners.world[cut.face[piece]] - scene.camera.eye).max(axis=(1, 2))
    condition = weight_condition(prepared, piece, reach, scene.camera.orthographic)
    shaded = shade_pixels(scene, settings, prepared.corners, cut.face[piece], weights, behind, steps, condition)
    return shaded, shade.depth(edges, cut.z[piece], scene.camera.orthographic)


def depth_at(scene: Scene, settings: Settings, face: Integers, row: Integers, column: Integers) -> Floats:
    """Return the depth of faces at pixels' sample nearest the center, (K,): +inf where the face does not cover it (or
    is -1).

    face: indices in the scene's face order. row: from the TOP. All broadcast to (K,).
    """
    face, row, column = (np.atleast_1d(np.asarray(a, dtype=np.int64)) for a in (face, row, column))
    face, row, column = np.broadcast_arrays(face, row, column)
    prepared = samples_of(scene, settings, prepare(scene, settings))[0]
    cut = prepared.pieces
    first, last = np.searchsorted(cut.face, face, "left"), np.searchsorted(cut.face, face, "right")
    result = np.full(len(face), np.inf)
    for step in range(int((last - first).max(initial=0))):
        query = np.flatnonzero(first + step < last)
        piece = first[query] + step
        edges = coverage.edge_functions(cut.xy[piece], column[query], scene.camera.resolution[1] - 1 - row[query])
        hit = coverage.covered(cut.xy[piece], edges) & ~prepared.setup.culled[piece]
        result[query[hit]] = np.minimum(
            result[query[hit]], shade.depth(edges[hit], cut.z[piece[hit]], scene.camera.orthographic)
        )
    return result


def nearest_depths(scene: Scene, settings: Settings, rows: Integers, columns: Integers) -> Floats:
    """Return the depths of the two nearest pieces at each sample of pixels, rows (from the TOP) and columns (K,): (S,
    2, K), +inf where there is none."""
    camera = scene.camera
    columns, upward = np.asarray(columns, np.int64), camera.resolution[1] - 1 - np.asarray(rows, np.int64)
    found = np.full((settings.samples, 2, len(columns)), np.inf)
    for (nearest, second), view in zip(found, samples_of(scene, settings, prepare(scene, settings)), strict=True):
        opaque = opaque_test(scene, settings, view)
        alive = np.flatnonzero(~view.setup.culled)
        xy, boxes = view.pieces.xy[alive], view.setup.box[alive]
        for k, pixel, edges in coverage.samples_at(xy, boxes, columns, upward):
            z = shade.depth(edges, view.pieces.z[alive[k]], camera.orthographic)
            if opaque is not None:
                z = np.where(opaque(alive[k], edges), z, np.inf)
            for at, depth in zip(pixel.tolist(), z.tolist(), strict=True):
                nearest[at], second[at] = sorted((nearest[at], second[at], depth))[:2]
    return found
