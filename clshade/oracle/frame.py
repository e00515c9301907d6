"""A whole frame: the owner of each pixel, then the colors of the owned ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from ..base.arrays import Bools, Floats, Integers, UInt32s
from ..scene.model import Scene, Settings
from ..scene.scalar_colors import without_colors
from . import coverage, environment, shade, transform
from .lights import shape_of
from .lines import LINE, MARKED, samples_with_lines
from .pixels import Shaded, shade_pixels
from .shot import Hits, Shot, prepare
from .transparency import DOUBT, ROUNDINGS, Fragments, alphas, fragments_at, passes

BATCH = 1 << 15  # pixels shaded at a time
MAX_SAMPLES = 1 << 20  # resolved at a time; some 150 bytes each

Covered = Callable[[Integers, Integers, Integers, Integers], Iterator[tuple[Integers, Integers, Integers]]]
_Drawn = TypeVar("_Drawn")


@dataclass(frozen=True, eq=False)
class OracleFrame(Shaded):
    """The image and the measures of its error: (M, N) and the components, row 0 at the TOP.

    rgb is over the background. For gouraud and nolight the measures are those of the worst corner of the triangle. Of
    several samples id and Z are those of the sample nearest the center, kappa, its terms and the exponent the worst of all,
    budget and jump the mean.
    """

    alpha: Floats  # fraction of the samples covered
    id: UInt32s  # 0 = background, k+1 = face k
    Z: Floats  # depth, +inf = background
    alpha_error: Floats  # how much rounding can change alpha, in the units of colors; 0 where alpha is exact
    unsure: Bools  # where rounding may change the order of transparent surfaces, or which of them layers show

    @property
    def gate(self) -> Bools:
        """(M, N) bool: where rounding may open or close a highlight."""
        return np.asarray((self.jump > 0.0).any(axis=-1))


def plain(color: Floats, count: int, alpha: float = 0.0) -> OracleFrame:
    """Return pixels of one color without a surface."""
    return OracleFrame(
        rgb=np.tile(color, (count, 1)),
        alpha=np.full(count, alpha),
        id=np.zeros(count, np.uint32),
        Z=np.full(count, np.inf),
        budget=np.tile(np.abs(color), (count, 1)),
        conditions=np.ones((count, 4)),
        jump=np.zeros((count, 3)),
        exponent=np.ones(count),
        alpha_error=np.zeros(count),
        unsure=np.zeros(count, bool),
    )


def owners(
    shot: Shot, column: Integers, row: Integers, covered: Covered = coverage.samples_at, see_through: bool = True
) -> Integers:
    """Return the piece visible at each of the pixels (column, row from the BOTTOM), (Q,) each, -1 for none: (Q,).

    `painter`: the first in painter's order of the faces. `depth`: the nearest at the pixel, of equals the later.
    see_through: whether transparent pieces own no pixels, nor those that fail their material's alpha test.
    """
    cut, painter = shot.pieces, shot.settings.visibility == "painter"
    order = coverage.painter_order(shot.z[cut.face], ~shot.setup.culled) if painter else shot.drawn
    tested = see_through and any(mesh.tests_alpha or mesh.blends for mesh in shot.scene.meshes)
    owner, nearest = np.full(len(column), -1 if not painter else len(order)), np.full(len(column), np.inf)
    for k, pixel, edges in covered(cut.xy[order], shot.setup.box[order], column, row):
        visible = opaque(shot, order[k], edges) if tested else slice(None)
        k, pixel, edges = k[visible], pixel[visible], edges[visible]
        if painter:
            np.minimum.at(owner, pixel, k)
            continue
        z = shade.depth(edges, cut.z[order[k]], shot.scene.camera.orthographic)
        np.minimum.at(nearest, pixel, z)
        equal = z == nearest[pixel]  # a later batch holds later pieces only, so the later owner is right
        np.maximum.at(owner, pixel[equal], order[k[equal]])
    return np.append(order, -1)[owner] if painter else owner


def opaque(shot: Shot, piece: Integers, edges: Integers) -> Bools:
    """Return (K,) bool: which pieces own pixels, with edge functions (K, 3), that they cover."""
    owns = ~shot.corners.of_meshes(lambda mesh: mesh.blends)[shot.pieces.face[piece]]
    owns[owns] = passes(shot, piece[owns], edges[owns])
    return owns


def render(
    scene: Scene, settings: Settings, rows: Integers | None = None, columns: Integers | None = None
) -> OracleFrame:
    """Render pixels: rows (from the TOP) and columns, both (K,), with leading axis (K,); by default all pixels, (M, N).

    Takes the time of these pixels, and of setting up the scene's triangles.
    """
    if rows is None or columns is None:
        return whole_image(scene, settings, render)
    pixels = Pixels.of(scene, settings, rows, columns)
    size = max(MAX_SAMPLES // len(pixels.shot.samples), 1)
    starts = range(0, max(len(pixels.column), 1), size)
    parts = [
        replace(pixels, column=pixels.column[i : i + size], row=pixels.row[i : i + size]).resolved() for i in starts
    ]
    return OracleFrame(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def whole_image(scene: Scene, settings: Settings, draw: Callable[..., _Drawn]) -> _Drawn:
    """Draw all pixels of an image, and return the result with leading axes (M, N) in place of (K,)."""
    columns, rows = scene.camera.resolution
    flat: Any = draw(scene, settings, *np.divmod(np.arange(rows * columns), columns))
    shaped = {name: values.reshape(rows, columns, *values.shape[1:]) for name, values in vars(flat).items()}
    image: _Drawn = replace(flat, **shaped)
    return image


@dataclass(frozen=True, eq=False)
class _Lit(Fragments):
    """Fragments with their colors and measures, and alphas, see `transparency.alphas`."""

    shaded: Shaded
    alpha: Floats
    magnitude: Floats
    varies: Bools


@dataclass(frozen=True, eq=False)
class Pixels:
    """K pixels of an image, columns and rows from the BOTTOM. shot: the scene as their centers see it."""

    shot: Shot
    column: Integers
    row: Integers

    @classmethod
    def of(cls, scene: Scene, settings: Settings, rows: Integers, columns: Integers) -> Pixels:
        """Return pixels by rows from the TOP and columns."""
        upward = scene.camera.resolution[1] - 1 - np.asarray(rows, np.int64)
        shot = prepare(without_colors(scene, settings.scalars), settings)
        return cls(shot, np.asarray(columns, np.int64), upward)

    @cached_property
    def owner(self) -> Integers:
        """(S, K) the piece that owns each sample, -1 for none."""
        return np.array([owners(view, self.column, self.row) for view in self.shot.samples])

    @cached_property
    def lines(self) -> Integers:
        """(S, K) the kinds of lines that the samples show, see `lines`; 0 for none."""
        if self.shot.settings.edges is None:
            return np.zeros_like(self.owner)
        return samples_with_lines(self.shot, self.column, self.row)

    @cached_property
    def blends(self) -> bool:
        return any(mesh.blends for mesh in self.shot.scene.meshes)

    @property
    def lines_alone(self) -> bool:
        edges = self.shot.settings.edges
        return edges is not None and edges.only

    def background(self, place: Integers) -> OracleFrame:
        """Return the background at a place in the pixels, (2,)."""
        scene = self.shot.scene
        frame = plain(np.zeros(3) if scene.background is None else scene.background, len(self.column))
        if self.shot.settings.background != "environment" or scene.environment is None:
            return frame
        x, y = transform.SAMPLE_STEPS * np.stack([self.column, self.row]) + place[:, None]
        rays = environment.rays(scene.camera, x, y)
        rgb, budget = environment.seen(scene.environment, rays, self.shot.settings.precision)
        return replace(frame, rgb=rgb, budget=budget)

    def hits(self, some: Integers, piece: Integers, place: Integers) -> Iterator[tuple[slice, Hits]]:
        """Yield where some pixels (L,) meet pieces (L,) at places (L, 2), in batches, and their slices of these."""
        size, settings = BATCH, self.shot.settings
        if any(shape_of(light).points for light in self.shot.scene.lights):
            size //= settings.light_samples  # many points of lights are kept for each
        for start in range(0, len(some), size):
            part = slice(start, start + size)
            at = self.column[some[part]], self.row[some[part]], place[part]
            yield part, Hits.at(self.shot, piece[part], *at)

    def central_hits(self, some: Integers, piece: Integers) -> Hits:
        """Return where some pixels (L,) meet their pieces, of those (K,) of all, at the sample nearest the center."""
        place = np.broadcast_to(self.shot.samples[0].place, (len(some), 2))
        return Hits.at(self.shot, piece[some], self.column[some], self.row[some], place)

    def light(self, frames: list[OracleFrame], owner: Integers) -> None:
        """Light the owners (S, K), -1 for none, in frames of the samples: each once in a pixel, at the mean of its samples
        there, or with sample_shading at each of them."""
        count = len(owner)
        first = np.arange(count)[:, None] + np.zeros_like(owner)  # the sample that is lit
        if not self.shot.settings.sample_shading:
            first = np.array([np.argmax(owner[: s + 1] == owner[s], axis=0) for s in range(count)])
        for s in range(count):
            some: Integers = np.flatnonzero((first[s] == s) & (owner[s] >= 0))
            share = first[:, some] == s
            for part, hits in self.hits(some, owner[s, some], coverage.mean_place(share)):
                shaded = vars(shade_pixels(hits))
                for frame, mine in zip(frames, share[:, part], strict=True):
                    at = some[part][mine]
                    frame.alpha[at] = 1.0
                    for name, values in shaded.items():
                        getattr(frame, name)[at] = values[mine]

    def resolved(self) -> OracleFrame:
        """Resolve the pixels, sample by sample."""
        frames = [self.background(view.place) for view in self.shot.samples]
        self.light(frames, np.where((self.lines > 0) | self.lines_alone, -1, self.owner))
        owner, unsure = self.owner[0], np.zeros(len(self.column), bool)
        for s, frame in enumerate(frames):
            if self.blends:
                fragments = self.fragments(s)
                composite(frame, fragments)
                unsure |= fragments.unsure
                if s == 0:
                    owner, doubtful = self.shown(fragments)
                    unsure |= doubtful
            if self.lines_alone:
                frame = frames[s] = self.background(self.shot.samples[s].place)
            self.put_lines(frame, self.lines[s])
        number, depth = np.zeros(len(owner), np.uint32), np.full(len(owner), np.inf)
        covered = np.flatnonzero(owner >= 0)
        hits = self.central_hits(covered, owner)
        number[covered], depth[covered] = hits.face + 1, hits.depth
        return replace(mean(self.shot, frames), id=number, Z=depth, unsure=unsure)

    def put_lines(self, frame: OracleFrame, lines: Integers) -> None:
        """Put lines (K,) over a sample of the pixels, in place."""
        for kind, color in ((LINE, "color"), (MARKED, "nonmanifold_color")):
            pixels = np.flatnonzero(lines == kind)
            if len(pixels):
                line = plain(np.array(getattr(self.shot.settings.edges, color)), len(pixels), alpha=1.0)
                for name in ("rgb", "alpha", "alpha_error", "budget", "conditions", "jump", "exponent"):
                    getattr(frame, name)[pixels] = getattr(line, name)

    def fragments(self, s: int) -> _Lit:
        """Return the transparent fragments of sample s, lit at the mean of the samples that their pieces cover in a pixel;
        with sample_shading at s."""
        fragments = fragments_at(self.shot.samples[s], self.owner[s], self.column, self.row)
        lit = np.zeros((len(self.shot.samples), len(fragments.piece)), bool)
        lit[s] = True
        if not self.shot.settings.sample_shading:
            for covers, view in zip(lit, self.shot.samples, strict=True):
                xy = view.pieces.xy[fragments.piece]
                edges = coverage.edge_functions(xy, self.column[fragments.pixel], self.row[fragments.pixel])
                covers[:] = coverage.covered(xy, edges)
        count = len(fragments.piece)
        shaded = Shaded(*(np.zeros((count, *shape)) for shape in ((3,), (3,), (4,), (3,), ())))
        alpha, magnitude, varies = np.zeros(count), np.zeros(count), np.zeros(count, bool)
        for some, hits in self.hits(fragments.pixel, fragments.piece, coverage.mean_place(lit)):
            for name, values in vars(shade_pixels(hits)).items():
                getattr(shaded, name)[some] = values
            alpha[some], magnitude[some], varies[some] = alphas(self.shot.corners, hits.face, hits.weights)
        return _Lit(
            **vars(fragments), shaded=shaded, alpha=np.clip(alpha, 0.0, 1.0), magnitude=magnitude, varies=varies
        )

    def layer_owner(self) -> tuple[Integers, Bools]:
        """Return the pieces that layers show, (K,), -1 for none, and where rounding may change them."""
        owner = self.owner[0]
        return self.shown(self.fragments(0)) if self.blends else (owner, np.zeros(len(owner), bool))

    def shown(self, fragments: _Lit) -> tuple[Integers, Bools]:
        """Return the pieces that layers show, (K,), -1 for none, and where rounding may change them, from the fragments of
        the sample nearest the center."""
        owner, limit = self.owner[0].copy(), self.shot.settings.layer_alpha
        enough = np.flatnonzero(fragments.alpha >= limit)[::-1]  # the nearest is assigned last
        owner[fragments.pixel[enough]] = fragments.piece[enough]
        unsure = np.zeros(len(owner), bool)
        unsure[fragments.pixel[fragments.varies & (np.abs(fragments.alpha - limit) <= DOUBT)]] = True
        return owner, unsure


def mean(shot: Shot, samples: list[OracleFrame]) -> OracleFrame:
    """Return the weighted means of samples, with the worst of their condition numbers and exponents."""
    if len(samples) == 1:
        return samples[0]
    resolve, count = shot.settings.resolve, len(samples)
    weight = [weights(sample.rgb, resolve) / count for sample in samples]
    alpha, alpha_error = (np.mean([getattr(s, name) for s in samples], axis=0) for name in ("alpha", "alpha_error"))
    total: Floats = np.sum(weight, axis=0)
    # Without a background uncovered samples do not count, and the mean is premultiplied.
    if resolve == "weighted" and shot.scene.background is None:
        seen = np.sum([part * sample.alpha for part, sample in zip(weight, samples, strict=True)], axis=0)
        total = np.where(alpha > 0.0, seen / np.where(alpha > 0.0, alpha, 1.0), 1.0)
    share = [(part / total)[:, None] for part in weight]
    rgb = sum(part[:, None] * sample.rgb for part, sample in zip(weight, samples, strict=True)) / total[:, None]
    budget, jump = np.zeros_like(rgb), np.zeros_like(rgb)
    for part, sample in zip(share, samples, strict=True):
        bound = sample.budget
        if resolve == "weighted":  # an error of a color changes its weight too
            apart = (np.abs(sample.rgb) + np.abs(rgb)) * weights(sample.rgb, resolve)[:, None]
            bound = bound + apart * bound.max(axis=-1, keepdims=True)
        budget += part * bound
        jump += part * sample.jump
    if resolve == "weighted":  # a jump changes the weights too, and not by little
        jump = np.where((jump > 0.0).any(axis=-1, keepdims=True), budget, 0.0)
    worst = np.argmax([sample.kappa for sample in samples], axis=0)
    return replace(
        samples[0],
        rgb=rgb,
        alpha=alpha,
        budget=budget,
        jump=jump,
        conditions=np.array([sample.conditions for sample in samples])[worst, np.arange(len(worst))],
        exponent=np.stack([sample.exponent for sample in samples]).max(axis=0),
        # The sum over samples rounds to its own size, also where a few of them are transparent.
        alpha_error=np.where(alpha_error > 0.0, np.maximum(alpha_error, alpha), 0.0),
    )


def weights(rgb: Floats, resolve: str) -> Floats:
    """Return the weights of colors (K, 3) in the mean, (K,): 1, or with `weighted` 1/(1 + luminance), luminance clamped
    to 2^96."""
    if resolve == "mean":
        return np.ones(len(rgb))
    return 1.0 / (1.0 + np.clip(rgb @ [0.2126, 0.7152, 0.0722], 0.0, 2.0**96))


def composite(base: OracleFrame, lit: _Lit) -> None:
    """Composite fragments over pixels of one sample, in place, the farthest first.

    An error of an alpha changes the color by as much of the difference between the fragment and its background.
    """
    count = np.bincount(lit.pixel, minlength=len(base.alpha))
    error, total = np.zeros(len(base.alpha)), np.abs(base.rgb)
    for rank in range(int(count.max(initial=0)) - 1, -1, -1):
        k = np.flatnonzero(lit.rank == rank)
        at, alpha, magnitude = lit.pixel[k], lit.alpha[k, None], lit.magnitude[k, None]
        color, behind = lit.shaded.rgb[k], base.rgb[at].copy()
        base.budget[at] = (
            alpha * lit.shaded.budget[k]
            + (1.0 - alpha) * base.budget[at]
            + magnitude * lit.varies[k, None] * (np.abs(color) + np.abs(behind))
        )
        base.jump[at] = alpha * lit.shaded.jump[k] + (1.0 - alpha) * base.jump[at]
        base.rgb[at] = alpha * color + (1.0 - alpha) * behind
        total[at] = alpha * np.abs(color) + (1.0 - alpha) * total[at]
        error[at] = lit.magnitude[k] + (1.0 - lit.alpha[k]) * error[at]
        base.alpha[at] = lit.alpha[k] + (1.0 - lit.alpha[k]) * base.alpha[at]
        worse = lit.shaded.kappa[k] > base.kappa[at]
        base.conditions[at[worse]] = lit.shaded.conditions[k[worse]]
        base.exponent[at] = np.maximum(base.exponent[at], lit.shaded.exponent[k])
    rounded = np.where(count > 0, 2.0 * count + 2.0, 0.0) * ROUNDINGS
    base.budget[:] += rounded[:, None] * total
    base.alpha_error[:] = np.where(count > 0, error + rounded, 0.0)


def depth_at(scene: Scene, settings: Settings, face: Integers, row: Integers, column: Integers) -> Floats:
    """Return the depth of faces at pixels' sample nearest the center, (K,): +inf where the face does not cover it (or
    is -1).

    face: indices in the scene's face order. row: from the TOP. All broadcast to (K,).
    """
    face, row, column = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, np.int64)) for a in (face, row, column)))
    shot = prepare(scene, settings).samples[0]
    cut, depth = shot.pieces, np.full(len(face), np.inf)
    first, last = np.searchsorted(cut.face, face, "left"), np.searchsorted(cut.face, face, "right")
    query = np.repeat(np.arange(len(face)), last - first)
    piece = np.arange(len(query)) + np.repeat(last - np.cumsum(last - first), last - first)
    edges = coverage.edge_functions(cut.xy[piece], column[query], scene.camera.resolution[1] - 1 - row[query])
    hit = coverage.covered(cut.xy[piece], edges) & ~shot.setup.culled[piece]
    np.minimum.at(depth, query[hit], shade.depth(edges[hit], cut.z[piece[hit]], scene.camera.orthographic))
    return depth


def nearest_depths(scene: Scene, settings: Settings, rows: Integers, columns: Integers) -> Floats:
    """Return the depths of the two nearest pieces at each sample of pixels, rows (from the TOP) and columns (K,): (S,
    2, K), +inf where there is none."""
    columns, upward = np.asarray(columns, np.int64), scene.camera.resolution[1] - 1 - np.asarray(rows, np.int64)
    depths = np.full((settings.samples, 2, len(columns)), np.inf)
    for (nearest, second), shot in zip(depths, prepare(scene, settings).samples, strict=True):
        xy, boxes = shot.pieces.xy[shot.drawn], shot.setup.box[shot.drawn]
        for k, pixel, edges in coverage.samples_at(xy, boxes, columns, upward):
            piece = shot.drawn[k]
            z = shade.depth(edges, shot.pieces.z[piece], scene.camera.orthographic)
            z = np.where(opaque(shot, piece, edges), z, np.inf)
            for at, depth in zip(pixel.tolist(), z.tolist(), strict=True):
                nearest[at], second[at] = sorted((nearest[at], second[at], depth))[:2]
    return depths
