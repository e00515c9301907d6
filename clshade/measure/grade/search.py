"""Which mistakes explain an image: alone, then in pairs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ...base.arrays import Bools, Floats, Integers
from .drawing import Canvas, Drawing, Edit, as_codes
from .mistakes import MISTAKES
from .mistakes.mistake import Mistake

_SINGLES, _PAIRS = 1500, 400  # pixels on which single mistakes, and pairs, are compared
_BEAM = 5  # single mistakes that are tried with all others
_MOVED = 12  # how good a single mistake in the places of pixels must be to be tried with those in the scene
_ENOUGH = 0.97  # a single mistake that explains as much is not paired
_CLAIMED = 0.8  # what an explanation must explain to be claimed
_WORTH_NAMING = 0.1  # what an explanation must explain to be listed
_SEED = 0


@dataclass(frozen=True, eq=False)
class Change:
    """One variant of a mistake."""

    mistake: Mistake
    words: str
    edit: Edit

    @property
    def label(self) -> str:
        return f"{self.mistake.name} ({self.words})" if self.words else self.mistake.name


def _label(changes: Sequence[Change]) -> str:
    return " + ".join(change.label for change in changes)


@dataclass(frozen=True, eq=False)
class Explanation:
    """One mistake, or two in the order in which they are made.

    removed: share of the difference that it removes, as the sum of what is beyond one code. fixed: share of the pixels that
    differ which it makes right within one code. same: others that give the same image here.
    """

    changes: tuple[Change, ...]
    removed: float
    fixed: float
    same: tuple[tuple[Change, ...], ...] = ()

    @property
    def score(self) -> float:
        return 0.5 * (self.removed + self.fixed)

    @property
    def claimed(self) -> bool:
        return self.score >= _CLAIMED

    @property
    def label(self) -> str:
        return _label(self.changes)

    def facts(self) -> dict[str, Any]:
        """Return the explanation as plain values."""
        return {
            "mistake": self.label,
            "difference_removed": self.removed,
            "pixels_made_right": self.fixed,
            "same_image": "; ".join(map(_label, self.same)),
            "advice": " ".join(change.mistake.advice for change in self.changes),
        }


def applied(drawing: Drawing, changes: Sequence[Change]) -> Drawing:
    """Return the drawing with mistakes, made one after another."""
    for change in changes:
        drawing = change.edit(drawing)
    return drawing


def changes_of(drawing: Drawing) -> list[Change]:
    """Return all variants of the mistakes that the right drawing can have."""
    return [Change(mistake, *variant) for mistake in MISTAKES for variant in mistake.variants(drawing).items()]


def wrong(codes: Floats, expected: Floats) -> Bools:
    """Return (K,) bool: which pixels differ by more than one code in any channel."""
    return np.asarray((np.abs(codes - expected) > 1.0 + 1e-9).any(axis=-1))


def sample(image: Floats, linear: Floats, doubtful: Bools, count: int) -> tuple[Integers, Floats]:
    """Choose pixels of the image, codes (M, N, 3): half of those that differ from the right linear colors, and half of the
    others, at random, but all of a half that has no more; none that are doubtful, (M, N). Also the brightest right one, on
    which maxima depend. Return their indices in reading order, and the number of pixels that each stands for, (K,)."""
    generator = np.random.default_rng(_SEED)
    differ = wrong(image, np.rint(as_codes(linear))).reshape(-1)
    chosen, weights = [np.array([linear.max(axis=2).argmax()])], [np.zeros(1)]
    sure = ~doubtful.reshape(-1)
    for half in (np.flatnonzero(differ & sure), np.flatnonzero(~differ & sure)):
        some = half if len(half) <= count // 2 else generator.choice(half, count // 2, replace=False)
        chosen.append(some)
        weights.append(np.full(len(some), len(half) / max(len(some), 1)))
    return np.concatenate(chosen), np.concatenate(weights)


class Search:
    """The search for what explains a sample of an image's pixels, see `explain`."""

    def __init__(self, right: Drawing, image: Floats, linear: Floats, doubtful: Bools, count: int) -> None:
        index, self._weights = sample(image, linear, doubtful, count)
        rows, columns = np.divmod(index, image.shape[1])
        self._right, self._codes = right, image[rows, columns]
        self._changes = changes_of(right)
        self._canvas = Canvas(rows, columns)
        self._before = self._left(self._canvas.codes(right))
        self._linear: dict[tuple[object, ...], Floats] = {}

    def _left(self, codes: Floats) -> tuple[float, float]:
        """Return what is left of the difference: the sum beyond one code, and the number of pixels."""
        written = np.rint(codes) if (self._codes == np.rint(self._codes)).all() else codes
        apart = np.maximum(np.abs(written - self._codes) - 1.0, 0.0).sum(axis=1)
        return float(self._weights @ apart), float(self._weights @ wrong(written, self._codes))

    def explained(self, *changes: Change) -> Explanation:
        """Return how much these mistakes, in this order, explain."""
        sums, counts = zip(self._before, self._left(self._drawn(changes)), strict=True)
        removed, fixed = (1.0 - after / before if before else 0.0 for before, after in (sums, counts))
        return Explanation(changes, removed, fixed)

    def _drawn(self, changes: Sequence[Change]) -> Floats:
        """Return the codes of the pixels. Linear colors are kept, which mistakes in the finished image share."""
        drawing = applied(self._right, changes)
        key = (*(change for change in changes if change.mistake.early), drawing.place)
        if key not in self._linear:
            self._linear[key] = self._canvas.linear(drawing)
        return self._canvas.codes(drawing, self._linear[key])

    def singles(self) -> list[Explanation]:
        """Return all single mistakes, the one that explains most first; equals in the table's order."""
        return _ranked(self.explained(change) for change in self._changes)

    def pairs(self, singles: Sequence[Explanation]) -> list[Explanation]:
        """Return pairs of mistakes, the one that explains most first: each with those in the finished image, and the best of
        `singles` with all."""
        best, moved = ({single.label for single in singles[:count]} for count in (_BEAM, _MOVED))
        tried = [change for change in self._changes if not change.mistake.moves or change.label in moved]
        return _ranked(self.explained(*pair) for pair in _ordered_pairs(tried, best))

    def together(self, ranked: Sequence[Explanation]) -> Explanation:
        """Return the first of ranked explanations, with those that give the same image within one code at all pixels."""
        first, *others = ranked
        codes = self._drawn(first.changes)
        near = [candidate for candidate in others if candidate.score > first.score - 0.01]
        same = [explanation.changes for explanation in near if not wrong(self._drawn(explanation.changes), codes).any()]
        return replace(first, same=tuple(same))


def _ranked(explanations: Iterable[Explanation]) -> list[Explanation]:
    return sorted(explanations, key=lambda explanation: -round(explanation.score, 3))


def _ordered_pairs(changes: Sequence[Change], best: set[str]) -> Iterator[tuple[Change, Change]]:
    """Yield pairs of different mistakes: those in the scene before those in the image, two in the image in both orders."""
    for one, other in combinations(sorted(changes, key=lambda change: not change.mistake.early), 2):
        if one.mistake is other.mistake or (other.mistake.early and not {one.label, other.label} & best):
            continue
        yield one, other
        if not one.mistake.early:
            yield other, one


def explain(right: Drawing, image: Floats, linear: Floats, doubtful: Bools) -> list[Explanation]:
    """Return what explains an image, codes (M, N, 3), that differs from the right linear colors elsewhere than at doubtful
    pixels, (M, N): the best first, at most three; one alone if it explains nearly all."""
    search = Search(right, image, linear, doubtful, _SINGLES)
    singles = search.singles()
    best = search.together(singles)
    explanations = [
        explanation
        for explanation in (best, *singles[1:])
        if explanation.changes not in best.same and explanation.score > _WORTH_NAMING
    ]
    if best.score >= _ENOUGH:
        return explanations[:1]
    likely = Search(right, image, linear, doubtful, _PAIRS).pairs(singles)[:24]
    pair = search.together(_ranked(search.explained(*explanation.changes) for explanation in likely))
    if 1.0 - pair.score < 0.5 * (1.0 - best.score):
        explanations = [pair, *explanations]
    return explanations[:3]
