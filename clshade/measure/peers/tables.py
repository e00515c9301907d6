"""The results of `report --peers` as tables and sentences: where a peer is better than clshade."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ...base import text_tables
from ...base.text_tables import digits
from ..timing import FEWEST, ratio_interval
from . import OURS, PEERS
from .drawing import SAMPLES
from .measure import Failure, Found, Result

ONE, MANY = SAMPLES
HEADER = (
    *("scene", "renderer", "wrong", "depth", "largest", "color", "ms"),
    *(f"alpha {MANY}", f"color {MANY}", f"ms {MANY}", "bits"),
)
NOTE = (
    "wrong: pixels of wrong coverage, or that show another surface, with one sample at the pixels' centers; depth, largest: "
    "RMS and largest error of the depth, in scene units; color: RMSE of the linear color; ms: median of a frame with the "
    f"scene resident, in turns; {MANY}: with as many samples a pixel, against 256; bits: same in two runs, and in one "
    "thread and all, or what changed them. Exact answers are float64, of the vertices as they are."
)
APART = 1.1  # times: errors that differ by less count as equal


class _Measure(NamedTuple):
    """A figure in which renderers are compared; value: None where it was not measured."""

    what: str
    samples: int
    value: Callable[[Result], float | None]


MEASURES = (
    _Measure("wrong pixels", ONE, lambda each: _wrong(each)),
    _Measure("RMS error of depth", ONE, lambda each: each.errors.depth),
    _Measure("RMSE of color", ONE, lambda each: each.errors.color),
    _Measure("milliseconds", ONE, lambda each: each.ms.median),
    _Measure("RMSE of coverage", MANY, lambda each: each.errors.alpha),
    _Measure("RMSE of color", MANY, lambda each: each.errors.color),
    _Measure("milliseconds", MANY, lambda each: each.ms.median),
)


def _wrong(each: Result) -> int:
    return (each.errors.wrong or 0) + (each.errors.other or 0)


def results(found: Found) -> list[Result]:
    return [each for each in found if isinstance(each, Result)]


def rows(found: Found) -> list[text_tables.Row]:
    """Return a row for each scene and renderer, in the order of the scenes and of PEERS."""
    drawn = {(each.scene, each.renderer, each.samples): each for each in results(found)}
    scenes = dict.fromkeys(each.scene for each in results(found))
    pairs = [(scene, name) for scene in scenes for name in PEERS]
    every = [(pair, drawn.get((*pair, ONE)), drawn.get((*pair, MANY))) for pair in pairs]
    return [_row(*pair, one, many) for pair, one, many in every if one or many]


def _row(scene: str, renderer: str, one: Result | None, many: Result | None) -> text_tables.Row:
    first, last = ["-"] * 5, ["-"] * 3
    if one:
        errors = one.errors
        reals = (digits(value, 2) for value in (errors.depth, errors.depth_largest, errors.color))
        first = [str(_wrong(one)), *reals, _milliseconds(one)]
    if many:
        last = [digits(many.errors.alpha, 2), digits(many.errors.color, 2), _milliseconds(many)]
    return (scene, renderer, *first, *last, _bits([each for each in (one, many) if each]))


def _milliseconds(each: Result) -> str:
    return _short(each.ms.median, 3)


def _short(value: float, count: int) -> str:
    """Return so many digits; large numbers without an exponent, which takes more room."""
    return digits(value, count) if value < 99.5 else f"{value:.0f}"


def _bits(both: Sequence[Result]) -> str:
    changed = [name for name in ("runs", "threads") if any(getattr(each, f"same_{name}") is False for each in both)]
    return ", ".join(changed) or "same"


def failures(found: Found) -> list[str]:
    """Return what could not be drawn, and why, once for the same scenes."""
    scenes: dict[str, list[str]] = {}
    for each in found:
        if isinstance(each, Failure) and each.scene not in scenes.setdefault(each.reason, []):
            scenes[each.reason].append(each.scene)
    return [f"not drawn: {', '.join(names)}: {reason}" for reason, names in scenes.items()]


def titles(found: Found) -> list[str]:
    named = {each.renderer: each.title for each in results(found)}
    return [f"{name}: {PEERS[name].about}: {title}" for name, title in named.items()]


def passed(found: Found) -> bool:
    """Return whether clshade could draw all that it was asked to."""
    return not any(isinstance(each, Failure) and each.renderer in OURS for each in found)


def better(found: Found) -> list[str]:
    """Return a sentence for each figure in which a peer is better than clshade in float32, with the scenes and peers."""
    sentences = []
    for measure in MEASURES:
        of_scenes = [
            _better_at(measure, scene, found) for scene in dict.fromkeys(each.scene for each in results(found))
        ]
        places = [each for each in of_scenes if each]
        if places:
            plural = "s" * (measure.samples > 1)
            head = f"A peer is better in {measure.what} at {measure.samples} sample{plural}"
            sentences.append(f"{head} on {len(places)} of {len(of_scenes)} scenes: {'; '.join(places)}.")
    return sentences


def _better_at(measure: _Measure, scene: str, found: Found) -> str:
    """Return the peers that are better on a scene, best first; "" if none is."""
    here = [each for each in results(found) if each.scene == scene and each.samples == measure.samples]
    ours = next((each for each in here if each.renderer == OURS[0]), None)
    mine = None if ours is None else measure.value(ours)
    if ours is None or mine is None:
        return ""
    ahead: dict[str, float] = {}
    for peer in here:
        value = measure.value(peer)
        if peer.renderer not in OURS and value is not None and _ahead(measure, value, mine, peer, ours):
            ahead[peer.renderer] = value
    if not ahead:
        return ""
    best, *others = sorted(ahead, key=lambda name: ahead[name])
    also = f", also {', '.join(others)}" if others else ""
    return f"{scene} ({best} {_short(ahead[best], 2)}, clshade {_short(mine, 2)}{also})"


def _ahead(measure: _Measure, value: float, mine: float, peer: Result, ours: Result) -> bool:
    """Return whether a peer is better, beyond noise: by APART in errors; in times, if the 95 % interval of their ratio
    lies below 1, of FEWEST rounds or more: with fewer it may be a point."""
    if measure.what == "milliseconds":
        rounds = min(len(peer.times), len(ours.times))
        return rounds >= FEWEST and ratio_interval(peer.times[:rounds], ours.times[:rounds])[1] < 1.0
    if measure.what == "wrong pixels":
        return value < mine
    return value * APART < mine


def stats(found: Found, resolution: tuple[int, int], machine: str) -> dict[str, Any]:
    """Return the figures for JSON."""
    return {
        "machine": machine,
        "resolution": resolution,
        "results": [each.stats() for each in results(found)],
        "failures": failures(found),
        "better": better(found),
    }
