"""A whole frame: the owner of each pixel, then the colors of the owned ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from ..base.arrays import Bools, Floats, Integers, UInt32s
from ..scene.model import Scene, Settings
from ..scene.scalar_colors import without_colors
from . import backdrop, coverage, sampling, shade, transform
from .clip import Pieces, pieces
from .corners import Corners, gather
from .lights import shape_of
from .lines import LINE, MARKED, samples_with_lines
from .pixels import Shaded, shade_pixels
from .transparency import DOUBT, ROUNDINGS, Fragments, alphas, ordered, passes, transparent_faces

BATCH = 1 << 15  # pixels shaded at a time

# From pieces (K,) with edge functions (K, 3) at a pixel to (K,) bool: which are opaque there.
Opaque = Callable[[Integers, Integers], Bools]
# What `coverage.samples_at` is.
Covered = Callable[[Integers, Integers, Integers, Integers], Iterator[tuple[Integers, Integers, Integers]]]


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
    alpha_error: (M, N) how much rounding can change alpha, in the units of colors; 0 where alpha is exact.
    unsure: (M, N) bool, where rounding may change the order of transparent surfaces, or which of them layers show.
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
    alpha_error: Floats
    unsure: Bools

    @property
    def kappa(self) -> Floats:
        return shade.condition_number(self.conditions)

    @property
    def gate(self) -> Bools:
        """(M, N) bool: where rounding may open or close a highlight."""
        return np.asarray((self.jump > 0.0).any(axis=-1))


@dataclass(frozen=True, eq=False)
class Prepared:
    """Geometry of a scene in the image: corners of all faces, their depths z (F, 3), and the pieces to draw. place: of the
    sample that sees it so, 1/256 px from the pixel's lower left corner."""

    corners: Corners
    z: Floats
    pieces: Pieces
    setup: coverage.Setup
    place: Integers


def prepare(scene: Scene, settings: Settings) -> Prepared:
    """Run the stages before the pixels: placement, camera, clipping, projection, snapping, setup."""
    camera = scene.camera
    named = None if settings.scalars is None else settings.scalars.name
    corners = gather(scene, named, bent=settings.shadows)
    axes = transform.camera_frame(camera.eye, camera.lookat, camera.up)
    points = transform.to_camera(corners.world, camera.eye, axes)
    near = transform.near_distance(corners.world.reshape(-1, 3), camera.eye, camera.lookat, settings.near)
    cut = pieces(points, near, transform.lens_of(camera))
    return Prepared(corners, points[:, :, 2], cut, set_up(scene, settings, corners, cut), sampling.places(1)[0])


def set_up(scene: Scene, settings: Settings, corners: Corners, cut: Pieces) -> coverage.Setup:
    """Return the setup of pieces, without those that are culled, or whose material is drawn from the front only."""
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


def moved(xy: Integers, place: Integers) -> Integers:
    """Return corners (..., 3, 2) as a sample at a place (..., 2), 1/256 px from its pixel's lower left corner, sees them:
    moved the other way, so that it is at the center."""
    return xy + (coverage.HALF - place * (transform.SUBPIXELS // transform.SAMPLE_STEPS))


def edge_functions_clamped(xy: Integers, column: Integers, row: Integers) -> Integers:
    """Return edge functions (K, 3), clamped to 0: the mean of samples in a line, rounded, may lie beside their triangle."""
    return np.maximum(coverage.edge_functions(xy, column, row), 0)


def samples_of(scene: Scene, settings: Settings, prepared: Prepared) -> list[Prepared]:
    """Return the scene as each sample of the pixels sees it, nearest to the center first: a sample off the center sees
    what the center sees of the scene shifted the other way."""
    views = []
    for place in sampling.places(settings.samples):
        cut = replace(prepared.pieces, xy=moved(prepared.pieces.xy, place))
        views.append(replace(prepared, pieces=cut, setup=set_up(scene, settings, prepared.corners, cut), place=place))
    return views


def owners(
    prepared: Prepared,
    visibility: str,
    column: Integers,
    row: Integers,
    opaque: Opaque | None = None,
    orthographic: bool = False,
    covered: Covered = coverage.samples_at,
) -> Integers:
    """Return the piece visible at each of the pixels (column, row from the BOTTOM), (Q,) each, -1 for none: (Q,).

    `painter`: the first in painter's order of the faces. `depth`: the nearest at the pixel, of equals the later.
    opaque: from pieces (K,) with edge functions (K, 3) at a pixel to (K,) bool, which are opaque there; None: all.
    """
    cut, alive = prepared.pieces, ~prepared.setup.culled
    if visibility == "painter":
        order = coverage.painter_order(prepared.z[cut.face], alive)
        rank = np.full(len(column), len(order))
        for k, pixel, edges in covered(cut.xy[order], prepared.setup.box[order], column, row):
            seen = slice(None) if opaque is None else opaque(order[k], edges)
            np.minimum.at(rank, pixel[seen], k[seen])
        first: Integers = np.append(order, -1)[rank]
        return first
    order = np.flatnonzero(alive)
    owner, nearest = np.full(len(column), -1), np.full(len(column), np.inf)
    for k, pixel, edges in covered(cut.xy[order], prepared.setup.box[order], column, row):
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
    return passes(scene, prepared.corners, cut.face[piece], weights)


def owns_pixels(scene: Scene, settings: Settings, prepared: Prepared, piece: Integers, edges: Integers) -> Bools:
    """Return (K,) bool: the same for opaque faces; transparent ones own no pixels."""
    opaque = ~transparent_faces(scene, prepared.corners)[prepared.pieces.face[piece]]
    opaque[opaque] = passes_alpha(scene, settings, prepared, piece[opaque], edges[opaque])
    return opaque


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
    scene: Scene, settings: Settings, cut: Pieces, piece: Integers, xy: Integers, column: Integers, row: Integers
) -> tuple[Floats, Floats]:
    """Return the derivatives of `face_weights` to the right and up, (K, 3) each, at pixels (column, row from the
    bottom) on their pieces, (K,) each, whose corners are xy (K, 3, 2)."""
    interpolation = "affine" if scene.camera.orthographic else settings.interpolation
    edges = coverage.edge_functions(xy, column, row)
    found = []
    for columns, rows in ((1, 0), (0, 1)):
        # Edge functions are linear: the next pixel's differ from this one's by their derivative.
        change = coverage.edge_functions(xy, column + columns, row + rows) - edges
        on_piece = shade.barycentric_steps(np.maximum(edges, 0), change, cut.z[piece], interpolation)
        found.append((on_piece[:, :, None] * cut.weights[piece]).sum(axis=1))
    return found[0], found[1]


def render(scene: Scene, settings: Settings) -> OracleFrame:
    """Render the frame of a scene's own camera."""
    columns, rows = scene.camera.resolution
    flat = sample(scene, settings, *np.divmod(np.arange(rows * columns), columns))
    return OracleFrame(*(each.reshape(rows, columns, *each.shape[1:]) for each in vars(flat).values()))


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
        found.append(owners(view, settings.visibility, columns, upward, opaque, camera.orthographic))
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
    if any(mesh.blends for mesh in scene.meshes):
        return _composited(scene, settings, center, views, owner, (columns, upward), lines)
    nearest = _shaded(scene, settings, center, owner[0], columns, upward, views[0].place)
    if len(views) == 1:
        if lines is None:
            return nearest
        return _with_lines(settings, nearest, lines[0], _background(scene, settings, columns, upward, views[0].place))
    total = _background(scene, settings, columns, upward, views[0].place)
    if lines is not None:
        owner = np.where((lines > 0) | settings.edges.only, -1, owner)  # type: ignore[union-attr]
    empty = owner < 0 if lines is None else (owner < 0) & (lines == 0)
    parts: list[tuple[Integers, Integers, OracleFrame]] = [(np.arange(owner.shape[1]), empty.sum(axis=0), total)]
    if settings.background == "environment":
        parts = []
        for view, open_ in zip(views, empty, strict=True):
            mine = np.flatnonzero(open_)
            behind = _background(scene, settings, columns[mine], upward[mine], view.place)
            parts.append((mine, np.ones(len(mine), np.int64), behind))
    if lines is not None:
        for kind, color in _line_colors(settings):
            share = (lines == kind).sum(axis=0)
            seen: Integers = np.flatnonzero(share)
            parts.append((seen, share[seen], _plain(color, len(seen))))
    light = _lit_samples(scene, settings, center, owner, (columns, upward))
    parts += [(lit, samples.sum(axis=0), part) for lit, samples, part in light]
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
    return replace(total, rgb=rgb, alpha=alpha, id=nearest.id, Z=nearest.Z, **measures)


def _lit_samples(
    scene: Scene, settings: Settings, center: Prepared, owner: Integers, pixels: tuple[Integers, Integers]
) -> list[tuple[Integers, Bools, OracleFrame]]:
    """Light the owners (S, K), -1 for none, of pixels' samples: each once in a pixel, at the mean of its samples there, or
    with sample_shading at each of them. Return indices of pixels (L,), the samples that share the light there (S, L), and
    that light."""
    samples = np.arange(len(owner))[:, None]
    group = samples + np.zeros_like(owner) if settings.sample_shading else sampling.first_of(owner)
    parts = []
    for s in range(len(owner)):
        lit: Integers = np.flatnonzero((group[s] == s) & (owner[s] >= 0))
        share = group[:, lit] == s
        at = pixels[0][lit], pixels[1][lit], sampling.mean_place(share)
        parts.append((lit, share, _shaded(scene, settings, center, owner[s, lit], *at)))
    return parts


def fragments_at(
    scene: Scene, settings: Settings, view: Prepared, owner: Integers, pixels: tuple[Integers, Integers]
) -> Fragments:
    """Return the transparent fragments of pixels (columns, rows from the BOTTOM), (K,) each, before their owners."""
    cut, camera = view.pieces, scene.camera
    seen = np.flatnonzero(~view.setup.culled & transparent_faces(scene, view.corners)[cut.face])
    drawn: list[tuple[Integers, Integers, Integers]] = []
    for k, pixel, edges in coverage.samples_at(cut.xy[seen], view.setup.box[seen], *pixels):
        passed = passes_alpha(scene, settings, view, seen[k], edges)
        drawn.append((pixel[passed], seen[k[passed]], edges[passed]))
    none = np.zeros(0, np.int64)
    pixel, piece, edges = (
        np.concatenate([empty, *part])
        for empty, part in zip(
            (none, none, np.zeros((0, 3), np.int64)), zip(*drawn, strict=True) if drawn else ((), (), ()), strict=True
        )
    )
    painter = coverage.painter_order(view.z[cut.face], ~view.setup.culled)
    return ordered(settings, cut, painter, owner, (pixel, piece, edges), pixels, camera.orthographic)


@dataclass(frozen=True, eq=False)
class _Lit:
    """Fragments as they are lit: colors and measures, and alphas as of `transparency.alphas`."""

    shaded: Shaded
    alpha: Floats
    most: Floats
    varies: Bools


def _light_fragments(
    scene: Scene,
    settings: Settings,
    center: Prepared,
    views: list[Prepared],
    s: int,
    found: Fragments,
    pixels: tuple[Integers, Integers],
) -> _Lit:
    """Light the fragments of sample s: at the mean of the samples that their pieces cover in a pixel; with sample_shading at
    s."""
    column, row = pixels[0][found.pixel], pixels[1][found.pixel]
    lit = np.zeros((len(views), len(found.piece)), bool)
    lit[s] = True
    if not settings.sample_shading:
        for covers, view in zip(lit, views, strict=True):
            xy = view.pieces.xy[found.piece]
            covers[:] = coverage.covered(xy, coverage.edge_functions(xy, column, row))
    place, count = sampling.mean_place(lit), len(found.piece)
    shaded = Shaded(*(np.zeros((count, *shape)) for shape in ((3,), (3,), (4,), (3,), ())))
    alpha, most, varies = np.zeros(count), np.zeros(count), np.zeros(count, bool)
    size = batch_size(scene, settings)
    for start in range(0, count, size):
        some = slice(start, start + size)
        piece, at = found.piece[some], (column[some], row[some])
        part, _ = _shade_batch(scene, settings, center, piece, *at, place[some])
        for f in fields(Shaded):
            getattr(shaded, f.name)[some] = getattr(part, f.name)
        edges = edge_functions_clamped(moved(center.pieces.xy[piece], place[some, None]), *at)
        weights = face_weights(scene, settings, center, piece, edges)
        alpha[some], most[some], varies[some] = alphas(scene, center.corners, center.pieces.face[piece], weights)
    return _Lit(shaded, np.clip(alpha, 0.0, 1.0), most, varies)


def _over(base: OracleFrame, found: Fragments, lit: _Lit) -> None:
    """Composite fragments over pixels of one sample, in place, the farthest first.

    An error of an alpha changes the color by as much of the difference between the fragment and what lies behind.
    """
    count = np.bincount(found.pixel, minlength=len(base.alpha))
    error, total = np.zeros(len(base.alpha)), np.abs(base.rgb)
    for place in range(int(count.max(initial=0)) - 1, -1, -1):
        k = np.flatnonzero(found.place == place)
        at, alpha, most = found.pixel[k], lit.alpha[k, None], lit.most[k, None]
        color, behind = lit.shaded.rgb[k], base.rgb[at].copy()
        base.budget[at] = (
            alpha * lit.shaded.budget[k]
            + (1.0 - alpha) * base.budget[at]
            + most * lit.varies[k, None] * (np.abs(color) + np.abs(behind))
        )
        base.jump[at] = alpha * lit.shaded.jump[k] + (1.0 - alpha) * base.jump[at]
        base.rgb[at] = alpha * color + (1.0 - alpha) * behind
        total[at] = alpha * np.abs(color) + (1.0 - alpha) * total[at]
        error[at] = lit.most[k] + (1.0 - lit.alpha[k]) * error[at]
        base.alpha[at] = lit.alpha[k] + (1.0 - lit.alpha[k]) * base.alpha[at]
        worse = shade.condition_number(lit.shaded.conditions[k]) > shade.condition_number(base.conditions[at])
        base.conditions[at[worse]] = lit.shaded.conditions[k[worse]]
        base.exponent[at] = np.maximum(base.exponent[at], lit.shaded.exponent[k])
    rounded = np.where(count > 0, 2.0 * count + 2.0, 0.0) * ROUNDINGS
    base.budget[:] += rounded[:, None] * total
    base.alpha_error[:] = np.where(count > 0, error + rounded, 0.0)


def shown_owners(settings: Settings, owner: Integers, found: Fragments, lit: _Lit) -> tuple[Integers, Bools]:
    """Return the pieces that layers show at pixels with these owners (K,), and where rounding may change them."""
    shown, unsure = owner.copy(), np.zeros(len(owner), bool)
    enough = np.flatnonzero(lit.alpha >= settings.layer_alpha)[::-1]  # the nearest is assigned last
    shown[found.pixel[enough]] = found.piece[enough]
    close = lit.varies & (np.abs(lit.alpha - settings.layer_alpha) <= DOUBT)
    unsure[found.pixel[close]] = True
    return shown, unsure


def layer_owners(
    scene: Scene, settings: Settings, owner: Integers, pixels: tuple[Integers, Integers]
) -> tuple[Integers, Bools]:
    """Return the same for pixels (columns, rows from the BOTTOM), (K,) each. owner: the opaque owners of their samples
    nearest the center."""
    if not any(mesh.blends for mesh in scene.meshes):
        return owner, np.zeros(len(owner), bool)
    center = prepare(scene, settings)
    views = samples_of(scene, settings, center)
    found = fragments_at(scene, settings, views[0], owner, pixels)
    return shown_owners(settings, owner, found, _light_fragments(scene, settings, center, views, 0, found, pixels))


def _composited(
    scene: Scene,
    settings: Settings,
    center: Prepared,
    views: list[Prepared],
    owner: Integers,
    pixels: tuple[Integers, Integers],
    lines: Integers | None,
) -> OracleFrame:
    """Resolve pixels of a scene with transparent surfaces, sample by sample. Arguments as of `_resolved`."""
    taken = np.zeros_like(owner) if lines is None else lines
    only = settings.edges is not None and settings.edges.only
    opaque = owner if len(views) == 1 else np.where((taken > 0) | only, -1, owner)
    light = _lit_samples(scene, settings, center, opaque, pixels)
    samples, unsure = [], np.zeros(owner.shape[1], bool)
    for s, view in enumerate(views):
        found = fragments_at(scene, settings, view, owner[s], pixels)
        lit = _light_fragments(scene, settings, center, views, s, found, pixels)
        unsure |= found.unsure
        frame = _background(scene, settings, *pixels, view.place)
        for mine, share, part in light:
            seen = mine[share[s]]
            for name in ("rgb", "alpha", "budget", "conditions", "jump", "exponent"):
                getattr(frame, name)[seen] = getattr(part, name)[share[s]]
        _over(frame, found, lit)
        if s == 0:
            shown, doubtful = shown_owners(settings, owner[0], found, lit)
            unsure |= doubtful
            nearest = _shaded(scene, settings, center, shown, *pixels, view.place)
        frame = replace(frame, id=nearest.id, Z=nearest.Z)
        if lines is not None:
            frame = _with_lines(settings, frame, taken[s], _background(scene, settings, *pixels, view.place))
        samples.append(frame)
    if len(samples) == 1:
        return replace(samples[0], unsure=unsure)
    return replace(_mean(scene, settings, samples), id=nearest.id, Z=nearest.Z, unsure=unsure)


def _mean(scene: Scene, settings: Settings, samples: list[OracleFrame]) -> OracleFrame:
    """Return the pixels of samples, but not their id, Z and unsure."""
    over_nothing = settings.resolve == "weighted" and scene.background is None
    weights = np.array([sampling.weight(part.rgb, settings.resolve) for part in samples]) / len(samples)
    alpha: Floats = np.mean([part.alpha for part in samples], axis=0)
    whole = weights.sum(axis=0)
    if over_nothing:  # what is covered counts, and the mean is premultiplied
        seen = sum(weight * part.alpha for weight, part in zip(weights, samples, strict=True))
        whole = np.where(alpha > 0.0, seen / np.where(alpha > 0.0, alpha, 1.0), 1.0)
    rgb = sum(weight[:, None] * part.rgb for weight, part in zip(weights, samples, strict=True)) / whole[:, None]
    every = np.arange(len(alpha))
    shared = [(every, weight / whole, part) for weight, part in zip(weights, samples, strict=True)]
    budget, jump = _mean_budgets(shared, rgb, settings.resolve)
    worst = np.argmax([part.kappa for part in samples], axis=0)
    alpha_error = np.mean([part.alpha_error for part in samples], axis=0)
    return replace(
        samples[0],
        rgb=rgb,
        alpha=alpha,
        budget=budget,
        jump=jump,
        conditions=np.array([part.conditions for part in samples])[worst, every],
        exponent=np.max([part.exponent for part in samples], axis=0),
        # The sum over samples rounds to its own size, also where a few of them are transparent.
        alpha_error=np.where(alpha_error > 0.0, np.maximum(alpha_error, alpha), 0.0),
    )


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
    """Return which pieces may own pixels, None if all may: without an alpha test and transparency."""
    tested = any(mesh.tests_alpha or mesh.blends for mesh in scene.meshes)
    return partial(owns_pixels, scene, settings, prepared) if tested else None


def _shaded(
    scene: Scene,
    settings: Settings,
    center: Prepared,
    owner: Integers,
    columns: Integers,
    upward: Integers,
    place: Integers,
) -> OracleFrame:
    """Shade pixels (columns, upward: rows from the bottom) of pieces `owner`, -1 for none, (K,) each, at a place in each,
    (K, 2), or in all, (2,)."""
    frame = _background(scene, settings, columns, upward, place)
    drawn, place = np.flatnonzero(owner >= 0), np.broadcast_to(place, (len(owner), 2))
    size = batch_size(scene, settings)
    for start in range(0, len(drawn), size):
        batch = drawn[start : start + size]
        at = columns[batch], upward[batch], place[batch]
        shaded, z = _shade_batch(scene, settings, center, owner[batch], *at)
        frame.alpha[batch] = 1.0
        frame.id[batch] = center.pieces.face[owner[batch]] + 1
        frame.Z[batch] = z
        for f in fields(Shaded):
            getattr(frame, f.name)[batch] = getattr(shaded, f.name)
    return frame


def _line_colors(settings: Settings) -> tuple[tuple[int, Floats], ...]:
    edges = settings.edges
    assert edges is not None
    return (LINE, np.array(edges.color)), (MARKED, np.array(edges.nonmanifold_color))


def _with_lines(settings: Settings, frame: OracleFrame, lines: Integers, empty: OracleFrame) -> OracleFrame:
    """Put lines (K,) over pixels (K,) of a single sample; id and Z stay those of the surface. empty: the background."""
    if settings.edges is not None and settings.edges.only:
        frame = replace(empty, id=frame.id, Z=frame.Z)
    for kind, color in _line_colors(settings):
        mine = lines == kind
        line = _plain(color, int(mine.sum()))
        frame.alpha[mine] = 1.0
        frame.alpha_error[mine] = 0.0
        for name in ("rgb", "budget", "conditions", "jump", "exponent"):
            getattr(frame, name)[mine] = getattr(line, name)
    return frame


def _background(scene: Scene, settings: Settings, columns: Integers, upward: Integers, place: Integers) -> OracleFrame:
    """Return what is behind the surfaces at a place of pixels (columns, upward: rows from the bottom), (K,)."""
    frame = _plain(np.zeros(3) if scene.background is None else scene.background, len(columns))
    if settings.background != "environment" or scene.environment is None:
        return frame
    x, y = transform.SAMPLE_STEPS * np.stack([columns, upward]) + place.T.reshape(2, -1)
    rgb, budget = backdrop.seen(scene.environment, backdrop.rays(scene.camera, x, y), settings.precision)
    return replace(frame, rgb=rgb, budget=budget)


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
        alpha_error=np.zeros(count),
        unsure=np.zeros(count, bool),
    )


def batch_size(scene: Scene, settings: Settings) -> int:
    """Return how many pixels are shaded at a time: fewer where many points of lights are kept for each."""
    sized = any(shape_of(light).points for light in scene.lights)
    return BATCH // settings.light_samples if sized else BATCH


def _shade_batch(
    scene: Scene,
    settings: Settings,
    center: Prepared,
    piece: Integers,
    column: Integers,
    row: Integers,
    place: Integers,
) -> tuple[Shaded, Floats]:
    """Shade pixels (column, row from the bottom) on their pieces, (K,) each, at their places (K, 2); return also their
    depths (K,)."""
    cut = center.pieces
    xy = moved(cut.xy[piece], place[:, None])
    edges = edge_functions_clamped(xy, column, row)
    weights = face_weights(scene, settings, center, piece, edges)
    behind = center.setup.area[piece] < 0
    steps = None
    if settings.texture_filter == "trilinear":
        steps = face_weight_steps(scene, settings, cut, piece, xy, column, row)
    reach = np.abs(center.corners.world[cut.face[piece]] - scene.camera.eye).max(axis=(1, 2))
    condition = weight_condition(center, piece, reach, scene.camera.orthographic)
    at = transform.SAMPLE_STEPS * column + place[:, 0], transform.SAMPLE_STEPS * row + place[:, 1]
    shaded = shade_pixels(scene, settings, center.corners, cut.face[piece], weights, behind, steps, condition, at)
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
